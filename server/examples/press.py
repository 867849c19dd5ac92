"""`python -m server.examples.press`: press down on a box with 15 N, and see that the hand does so without a force sensor."""

from pathlib import Path

import numpy as np

from server.client import Console
from server.examples.picture import COMMANDED, ESTIMATED, TRUE, figure, run_example

PRESS_N = 15.0
DURATION_S = 3.0
SAMPLE_TICKS = 20


def press(console: Console, picture: Path) -> None:
    """Press the lid of a box, tick by tick, and draw commanded, estimated and true force."""
    with console.lease("press example"):
        console.select(scene="box", controller="policy", estimator="hybrid")
        console.pause()
        console.reset(seed=1)
        console.command(mask=[0, 0, 1], force_n=[0, 0, PRESS_N])
        states = [console.step(SAMPLE_TICKS) for _ in range(round(DURATION_S / (0.002 * SAMPLE_TICKS)))]
    time_s = [state.time_s for state in states]
    with figure(picture, f"Pressing a box with {PRESS_N:g} N") as (axes,):
        for label, color, force in (
            ("commanded", COMMANDED, [state.force_commanded_n for state in states]),
            ("true", TRUE, [state.force_true_n for state in states]),
            ("estimated", ESTIMATED, [state.force_estimated_n for state in states]),
        ):
            axes.plot(time_s, np.array(force)[:, 2], color=color, label=label)
        axes.set_ylabel("force on the hand, z [N]")


if __name__ == "__main__":
    run_example(press)
