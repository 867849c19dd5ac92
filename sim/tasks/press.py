"""A press from above on something flat: how box and board are come down on, held, and left."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from control.types import Command
from sim.tasks.task import CONTACT_S, Lasting, Phase, reached, zeroing
from sim.tasks.view import TaskView

TOUCH_N = 3.0
SETTLE_S = 2.0
LIFT_M = 0.03
LOST_SHARE = 0.3


@dataclass(frozen=True, slots=True)
class Press:
    """A force along z, with the hand tilted, and the phases around it.

    Attributes:
        what: that is pressed on, in a word.
        above_m: (3,) m, site frame, where the hand waits before it comes down.
        pitch_rad: of the hand.
        force_n: of the press.
    """

    what: str
    above_m: np.ndarray
    pitch_rad: float
    force_n: float

    def command(self, view: TaskView, force_n: float) -> Command:
        """Press with `force_n` where the hand came down."""
        return view.command(self.above_m, pitch_rad=self.pitch_rad, mask=(0, 0, 1), force_n=(0.0, 0.0, force_n))

    def lost(self, view: TaskView) -> str | None:
        """Reason to end: the estimate feels the press no more."""
        return "the contact is lost" if view.force_n[2] < LOST_SHARE * self.force_n else None

    def come_down(self) -> Iterator[Phase]:
        """Approach, zero, touch gently, press."""
        touching = Lasting(CONTACT_S)

        def wait(view: TaskView) -> Command:
            return view.command(self.above_m, pitch_rad=self.pitch_rad)

        yield Phase(
            "approach",
            wait,
            lambda view: view.phase_s > 1.5 and reached(view, self.above_m),
            limit_s=6.0,
            late=f"the hand does not come above the {self.what}",
            until=0.08,
        )
        yield zeroing(wait, until=0.1)
        yield Phase(
            "touch",
            lambda view: self.command(view, TOUCH_N),
            lambda view: touching(view, view.force_n[2] > 2.0),
            limit_s=5.0,
            late=f"no {self.what} is met",
            until=0.15,
        )
        yield Phase("press", lambda view: self.command(view, self.force_n), lambda _: False, limit_s=SETTLE_S, until=0.2)

    def lift(self) -> Iterator[Phase]:
        """Leave upwards from where the hand is."""
        lifted = Lasting(0.5)
        height = float(self.above_m[2]) + LIFT_M
        yield Phase(
            "lift",
            lambda view: view.command(np.array([*view.hand_m[:2], height]), pitch_rad=self.pitch_rad),
            lambda view: lifted(view, abs(float(view.force_n[2])) < 2.0 and view.phase_s > 0.5),
            limit_s=4.0,
            late=f"the hand does not come off the {self.what}",
        )
