"""Valve rotation (paper Sec. IV.A): the hand in the handle's cup turns the wheel by a force along its circle, then also while
the base drives.

The cup is narrower than what is known of its place: the hand feels its way over the mouth until it drops in, and takes the
wheel's centre from where it then is.
"""

from collections.abc import Iterator, Mapping
from typing import ClassVar

import numpy as np

from control.command.limits import CommandLimits
from control.timing import CONTROL_PERIOD_S
from control.types import Command
from sim.scenes.valve import CENTER_HEIGHT_M, CUP_BOTTOM_X_M, HANDLE_RADIUS_M
from sim.tasks.task import CONTACT_S, Lasting, Option, Phase, TaskRefusedError, reached, require_reach, zeroing
from sim.tasks.view import TaskView

PITCH_RAD = 0.45
"""With less, the wrist comes to its end when the base is close and the hand low."""
PRESS_N = 5.0
TOUCH_N = 3.0
RAMP_S = 0.8
SEARCH_FROM_M, SEARCH_TO_M, SEARCH_PITCH_M, SEARCH_SPEED_MPS = 0.002, 0.032, 0.009, 0.05
DROP_M = 0.018
"""The hand has dropped into the cup when it is so much farther than where it first touched."""
CAUGHT_M = 0.012
"""Or when the cup's walls hold it so far from where the search wants it."""
BAND_M = 0.06
"""A hand so far off its circle, or so far out of its plane, has slipped."""
CENTER_RATE_PS = 0.5
STALLED_S = 6.0
SLOW_RPS, RATE_S, GROWTH_NPS = 0.48, 0.5, 2.0
"""A valve that turns more slowly, on average over RATE_S, is pushed harder and harder: a full turn shall take 15 s at most."""
FORWARD_PERIOD_S, TURN_PERIOD_S = 6.0, 9.0
BACK_FIRST_RAD = 0.93
"""Of the way to and fro: a fifth of it lies behind where it begins. Farther back the arm would stretch, farther ahead fold."""


class Valve:
    """Turns the wheel in place, then while driving."""

    NAME: ClassVar[str] = "valve"
    SCENE: ClassVar[str] = "valve"
    DESCRIPTION: ClassVar[str] = "Find the handle, turn the valve in place, then while the base drives"
    OPTIONS: ClassVar[Mapping[str, Option]] = {
        "force_n": Option(18.0, 8.0, 25.0, "N along the circle, to begin with"),
        "most_n": Option(24.0, 8.0, 30.0, "N, to which that grows where the valve turns slowly"),
        "direction": Option(1.0, -1.0, 1.0, "1 turns the top to the right, -1 to the left"),
        "place_s": Option(15.0, 0.0, 120.0, "s"),
        "drive_s": Option(20.0, 0.0, 120.0, "s"),
        "forward_mps": Option(0.135, 0.0, 0.15, "m/s to and fro while driving"),
        "turn_rps": Option(0.25, 0.0, 0.25, "rad/s to and fro while driving"),
    }

    def __init__(self, options: Mapping[str, float]) -> None:
        self._options = options
        self._force, self._rate_rps = options["force_n"], 0.0
        self._sign = 1.0 if options["direction"] >= 0.0 else -1.0
        self._center = np.array([CUP_BOTTOM_X_M - 0.02, 0.0, CENTER_HEIGHT_M])
        self._touched_x_m = self._center[0]
        self._angle_rad: float | None = None
        self._turned_rad, self._progressed_s, self._furthest_rad = 0.0, 0.0, 0.0
        self._turned = {"place": 0.0, "drive": 0.0}

    def check(self, view: TaskView, limits: CommandLimits) -> None:
        """See Task."""
        if self._options["direction"] == 0.0:
            raise TaskRefusedError("option 'direction' is 0; it must be 1 or -1")
        require_reach("the valve", self.plan(), view, limits)

    def plan(self) -> np.ndarray:
        """The handle's circle."""
        return self._center + HANDLE_RADIUS_M * np.array(
            [[0.0, -np.sin(angle), np.cos(angle)] for angle in np.linspace(0.0, 2.0 * np.pi, 49)]
        )

    def metrics(self) -> dict[str, float]:
        """How far the wheel was turned, by the hand's place."""
        return {"turned_place_rad": self._turned["place"], "turned_drive_rad": self._turned["drive"]}

    def phases(self) -> Iterator[Phase]:
        """See Task."""
        options, touching, inside = self._options, Lasting(CONTACT_S), Lasting(0.1)
        top = self._center + [0.0, 0.0, HANDLE_RADIUS_M]
        before = top - [0.07, 0.0, 0.0]

        def push(view: TaskView, point: np.ndarray) -> Command:
            return view.command(point, pitch_rad=PITCH_RAD, mask=(1, 0, 0), force_n=(-TOUCH_N, 0.0, 0.0))

        def touched(view: TaskView) -> bool:
            self._touched_x_m = float(view.hand_m[0])
            return touching(view, view.force_n[0] < -2.0)

        def search(view: TaskView) -> Command:
            return push(view, top + _spiral(view.phase_s))

        def dropped(view: TaskView) -> bool:
            off = float(np.linalg.norm((view.hand_m - top - _spiral(view.phase_s))[1:]))
            deep = view.hand_m[0] > self._touched_x_m + DROP_M
            caught = off > CAUGHT_M and view.phase_s > 1.0
            return inside(view, (deep or caught) and bool(view.force_n[0] < -1.5))

        def seated(view: TaskView) -> bool:
            if view.phase_s < 0.5:
                return False
            self._center = view.hand_m - [0.0, 0.0, HANDLE_RADIUS_M]
            self._progressed_s = view.time_s
            return True

        def turn(view: TaskView, name: str, begin_s: float) -> Command:
            offset = view.hand_m - self._center
            radius = max(float(np.hypot(offset[1], offset[2])), 1e-6)
            # The wheels creep aside under the load, which odometry does not see: the hand on its circle tells the centre.
            self._center[1:] += CENTER_RATE_PS * CONTROL_PERIOD_S * (1.0 - HANDLE_RADIUS_M / radius) * offset[1:]
            angle = float(np.arctan2(-offset[1], offset[2]))
            if self._angle_rad is not None:
                step = self._sign * float(np.angle(np.exp(1j * (angle - self._angle_rad))))
                self._turned[name] += step
                self._turned_rad += step
                self._rate_rps += (step - CONTROL_PERIOD_S * self._rate_rps) / RATE_S
            self._angle_rad = angle
            if self._turned_rad > self._furthest_rad + 0.05:
                self._furthest_rad, self._progressed_s = self._turned_rad, view.time_s
            if view.phase_s + begin_s > 4.0 * RATE_S and self._rate_rps < SLOW_RPS:
                self._force = min(options["most_n"], self._force + GROWTH_NPS * CONTROL_PERIOD_S)
            share = min(1.0, (view.phase_s + begin_s) / RAMP_S)
            along = self._sign * np.array([0.0, -np.cos(angle), -np.sin(angle)])
            force = -share * self._force * along - np.array([PRESS_N, 0.0, 0.0])
            velocity = (0.0, 0.0)
            if name == "drive":
                velocity = (
                    options["forward_mps"] * np.sin(2.0 * np.pi * view.phase_s / FORWARD_PERIOD_S - BACK_FIRST_RAD),
                    options["turn_rps"] * np.cos(2.0 * np.pi * view.phase_s / TURN_PERIOD_S),
                )
            return view.command(view.hand_m, pitch_rad=PITCH_RAD, mask=(1, 1, 1), force_n=force, velocity=velocity)

        def slipped(view: TaskView) -> str | None:
            offset = view.hand_m - self._center
            if abs(np.hypot(offset[1], offset[2]) - HANDLE_RADIUS_M) > BAND_M or offset[0] < -BAND_M:
                return "the hand has slipped off the handle"
            if view.time_s - self._progressed_s > STALLED_S:
                return "the valve turns no more"
            return None

        def wait(view: TaskView) -> Command:
            return view.command(before, pitch_rad=PITCH_RAD)

        yield Phase(
            "approach",
            wait,
            lambda view: view.phase_s > 1.5 and reached(view, before),
            limit_s=7.0,
            late="the hand does not come before the handle",
            until=0.06,
        )
        yield zeroing(wait, until=0.08)
        yield Phase("touch", lambda view: push(view, top), touched, limit_s=6.0, late="no handle is met", until=0.12)
        yield Phase("search", search, dropped, limit_s=_SEARCH_S, late="the handle's cup is not found", until=0.2)
        yield Phase(
            "seat",
            lambda view: view.command(view.hand_m, pitch_rad=PITCH_RAD, mask=(1, 0, 0), force_n=(-PRESS_N, 0.0, 0.0)),
            seated,
            limit_s=2.0,
            until=0.22,
        )
        for name, until in (("place", 0.55), ("drive", 0.92)):
            duration, begin_s = options[f"{name}_s"], 0.0 if name == "place" or options["place_s"] == 0.0 else RAMP_S
            if duration > 0.0:
                yield Phase(
                    name,
                    lambda view, name=name, begin_s=begin_s: turn(view, name, begin_s),
                    lambda _: False,
                    limit_s=duration,
                    wrong=slipped,
                    until=until,
                )
        out = Lasting(0.3)
        leaving: list[np.ndarray] = []

        def leave(view: TaskView) -> Command:
            leaving.append(view.hand_m) if not leaving else None
            return view.command(leaving[0] - [0.11, 0.0, 0.0], pitch_rad=PITCH_RAD)

        yield Phase(
            "leave",
            leave,
            lambda view: out(view, view.phase_s > 1.0 and bool(np.linalg.norm(view.force_n) < 2.5)),
            limit_s=5.0,
            late="the hand does not come off the handle",
        )


def _spiral(elapsed_s: float) -> np.ndarray:
    """(3,) m, offset across the wheel's plane after so long: it grows by the pitch per turn, at an even speed."""
    radius = min(np.sqrt(SEARCH_FROM_M**2 + SEARCH_SPEED_MPS * SEARCH_PITCH_M * max(0.0, elapsed_s) / np.pi), SEARCH_TO_M)
    angle = 2.0 * np.pi * radius / SEARCH_PITCH_M
    return radius * np.array([0.0, np.cos(angle), np.sin(angle)])


_SEARCH_S = np.pi * SEARCH_TO_M**2 / (SEARCH_SPEED_MPS * SEARCH_PITCH_M) + 1.0
