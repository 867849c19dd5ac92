"""`python -m server.examples.lead`: lead the robot by its hand, as a person would, and see where it goes."""

from pathlib import Path

import numpy as np

from server.client import Console
from server.examples.picture import AXES, ESTIMATED, TRUE, figure, run_example

PULL_N = (10.0, 0.0, 0.0)
PULL_S = 2.0
SAMPLE_TICKS, SAMPLES = 25, 60


def lead(console: Console, picture: Path) -> None:
    """Switch on guidance, pull ahead for two seconds, and draw the force and the way that base and hand have made."""
    console.select(scene="free")
    console.pause()
    console.reset(seed=3)
    console.command(guidance=True)
    console.step(100)
    console.push(PULL_N, PULL_S, ramp_s=0.3)
    states = [console.step(SAMPLE_TICKS) for _ in range(SAMPLES)]
    console.command(guidance=False)

    time_s = [state.time_s for state in states]
    base = np.array([state.base_position_m for state in states])
    hand = np.array([state.hand_position_m for state in states])
    with figure(picture, f"Led by the hand with {PULL_N[0]:g} N", rows=2) as (force, way):
        force.plot(time_s, [state.force_true_n[0] for state in states], color=TRUE, label="true")
        force.plot(time_s, [state.force_estimated_n[0] for state in states], color=ESTIMATED, label="estimated")
        force.set_ylabel("force, x [N]")
        way.plot(time_s, base[:, 0] - base[0, 0], label="base, world x")
        for axis, name in enumerate(AXES):
            way.plot(time_s, hand[:, axis] - hand[0, axis], "--", linewidth=1, label=f"hand beside the base, {name}")
        way.set_ylabel("way [m]")


if __name__ == "__main__":
    run_example(lead)
