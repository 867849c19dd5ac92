"""`python -m server.examples.watch`: follow a running robot by the stream while somebody, here a wrench, pulls at its hand."""

import itertools
from pathlib import Path

import numpy as np

from server.client import Console
from server.examples.picture import AXES, figure, run_example

RATE_HZ = 50.0
DURATION_S = 3.0
FIELDS = ("time_s", "wall_time_s", "end_effector", "loop")


def watch(console: Console, picture: Path) -> None:
    """Draw three seconds of the stream: the force that is felt, and how regularly the snapshots came."""
    console.select(scene="free")
    console.reset(seed=4)
    console.run(speed=1.0)
    console.wait_until(lambda state: state.time_s > 0.5)
    console.push([0.0, 12.0, 0.0], duration_s=1.5, ramp_s=0.2)
    with_end = console.stream(RATE_HZ, FIELDS)
    states = list(itertools.islice(with_end, round(RATE_HZ * DURATION_S)))
    with_end.close()

    time_s = np.array([state.time_s for state in states])
    wall_s = np.array([state["wall_time_s"] for state in states])
    with figure(picture, f"The stream at {RATE_HZ:g} Hz", rows=2) as (force, rate):
        for axis, name in enumerate(AXES):
            line = force.plot(time_s, [state.force_estimated_n[axis] for state in states], label=f"{name} estimated")[0]
            force.plot(
                time_s, [state.force_true_n[axis] for state in states], ":", color=line.get_color(), label=f"{name} true"
            )
        force.set_ylabel("force [N]")
        rate.plot(time_s[1:], 1e3 * np.diff(wall_s), ".", markersize=3, label="between snapshots, by their own clock")
        rate.set_ylabel("[ms]")
        rate.set_ylim(bottom=0.0)


if __name__ == "__main__":
    run_example(watch)
