"""`python -m server.examples.two_operators`: one drives, the other watches, takes over, and anyone stops the robot."""

import time
from pathlib import Path

from server.client import Console, RefusedError
from server.examples.picture import COMMANDED, figure, run_example

PAUSE_S = 0.5


def two_operators(ada: Console, picture: Path) -> None:
    """Let Ada drive until Grace takes over, and Ada stop the robot; draw the base's velocity and who did what."""
    told: list[tuple[float, str]] = []
    driven: list[tuple[float, float, str]] = []

    def watch(words: str) -> None:
        told.append((ada.state().time_s, words))
        end_s = time.monotonic() + PAUSE_S
        while time.monotonic() < end_s:
            state = ada.state()
            driven.append((state.time_s, state["base"]["linear_velocity_mps"][0], state.mode))
            time.sleep(0.02)

    ada.select(scene="free")
    ada.reset(seed=5)
    ada.run(speed=1.0)
    ada.wait_until(lambda state: state.time_s > 0.5)
    with Console(ada.address) as grace, ada.lease("Ada"):
        ada.command(base_velocity=[0.3, 0.0, 0.0])
        watch("Ada drives")
        try:
            grace.command(base_velocity=[-0.3, 0.0, 0.0])
        except RefusedError as refusal:
            watch(f"Grace is refused: {str(refusal).partition(';')[0]}")
        with grace.lease("Grace", take_over=True):
            watch("Grace takes over, and the base stops")
            grace.command(base_velocity=[-0.2, 0.0, 0.0])
            watch("Grace drives back")
            ada.estop()
            watch("Ada presses the e-stop, which is anyone's")
            grace.clear_estop()
            watch("Grace clears it")
    with figure(picture, "Two operators") as (axes,):
        axes.plot([time_s for time_s, _, _ in driven], [velocity for _, velocity, _ in driven], color=COMMANDED)
        stopped = [time_s for time_s, _, mode in driven if mode == "estop"]
        axes.axvspan(stopped[0], stopped[-1], color="#c62b22", alpha=0.15)
        axes.set_ylabel("velocity ahead [m/s]")
        axes.margins(y=0.25)
        for index, (time_s, words) in enumerate(told):
            axes.axvline(time_s, color="0.6", linewidth=0.8)
            axes.annotate(words, (time_s, 1.0 - 0.075 * index), xycoords=("data", "axes fraction"), fontsize=7, va="top")


if __name__ == "__main__":
    run_example(two_operators)
