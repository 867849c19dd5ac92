"""Spring-loaded door (paper Sec. IV.C): press the lever, push, redirect the force from pushing to tangential, drive through.

The tool is a ball on a stem. The stem lies on the lever and the ball on the leaf: two normal contacts, no hook and no friction.
Once the leaf has moved, the bolt lies outside its strike; the ball slides up the leaf over the lever and pushes on along its
arc, and the base follows the hand through the doorway.
"""

from collections.abc import Iterator, Mapping
from typing import ClassVar

import numpy as np

from control.command.limits import CommandLimits
from control.timing import CONTROL_PERIOD_S
from control.types import Command
from sim.scenes.door import HINGE_X_M, HINGE_Y_M, LEVER_HEIGHT_M, WIDTH_M
from sim.tasks.task import CONTACT_S, Lasting, Option, Phase, TaskRefusedError, reached, zeroing
from sim.tasks.view import TaskView

PITCH_RAD = 0.35
START_X_M = 0.10
FACE_X_M = HINGE_X_M - 0.02
BALL_M = 0.02
GRIP_Y_M = -0.128
"""Of the place on the lever: the tip of a pressed lever comes nearer to its axis, and the stem would slide off."""
NEARER_M, GRIPS = 0.035, 3
"""How much nearer to its axis the lever is pressed again once the hand has slid off its tip, and how often it is tried."""
BACK_M = 0.17
"""From the leaf to before the lever."""
SLID_OFF_Z_M = LEVER_HEIGHT_M - 0.13
"""Lower than any grip: no lever is under the stem."""
ON_GRIP_Z_M = LEVER_HEIGHT_M + 0.021 / np.cos(PITCH_RAD) - 0.04 * np.tan(PITCH_RAD)
"""Height of the ball when it touches the leaf and the stem lies on the level grip."""
FREE_Z_M = 0.63
PRESS_N = 14.0
TOUCH_N = 3.0
AJAR_RAD = 0.14
RADIUS_M, OUTER_RADIUS_M = 0.70, 0.74
ALONG_STIFFNESS, ALONG_LIMIT_N = 60.0, 8.0
OPEN_RAD, ENOUGH_RAD = 1.2, 1.4
"""Wide enough to drive on; a leaf beyond the other is pushed less, for its edge would come out of the arm's reach."""
HAND_AHEAD_M, HAND_NEAR_M = 0.60, 0.35
FOLLOW_MPS, THROUGH_MPS, FAST_MPS = 0.2, 0.15, 0.25
FAST_FROM_X_M, THROUGH_X_M, CLEAR_X_M = 1.10, 1.95, 2.25
"""The last one lies out of the way of the leaf that falls shut."""
BESIDE_M = 0.1
"""A hand that falls back beside the base comes to the end of the arm's turn, and then pushes as fast as the base drives."""
OFF_N, OFF_S = 10.0, 0.4
"""How the hand yields to the leaf that it slides off from."""
STALLED_S = 6.0
MOVED_RAD = 0.02
STANDS_S, GROWTH_NPS = 0.4, 8.0
"""A leaf that has stood for so long is pushed harder and harder."""


class Door:
    """Opens the door and drives through it."""

    NAME: ClassVar[str] = "door"
    SCENE: ClassVar[str] = "door"
    DESCRIPTION: ClassVar[str] = "Press the lever, push the door open along its arc and drive through"
    OPTIONS: ClassVar[Mapping[str, Option]] = {
        "push_n": Option(18.0, 10.0, 30.0, "N at the open door, to begin with"),
        "most_n": Option(28.5, 10.0, 35.0, "N, to which that grows where the door stands still"),
        "unlatch_n": Option(25.0, 10.0, 30.0, "N at most, until the door comes off its latch"),
    }

    def __init__(self, options: Mapping[str, float]) -> None:
        self._push, self._most, self._unlatch = options["push_n"], options["most_n"], options["unlatch_n"]
        self._pushing_n, self._widest_rad, self._moved_s = 0.0, 0.0, 0.0
        self._passed = self._slid_off = False
        self._closed_rad = 0.0
        self._grip_y_m = GRIP_Y_M

    def check(self, view: TaskView, limits: CommandLimits) -> None:
        """See Task."""
        ahead = np.array([START_X_M, 0.0]) - view.position_m
        if abs(view.yaw_rad) > 0.2 or abs(ahead[1]) > 0.1 or not -0.2 < ahead[0] < 1.0:
            raise TaskRefusedError("the robot does not stand before the door, facing it; drive it there, or reset the scene")

    def plan(self) -> np.ndarray:
        """The arc of the ball on the leaf, and on through the doorway."""
        angles = np.linspace(0.0, OPEN_RAD, 25)[:, None]
        hinge = np.array([HINGE_X_M, HINGE_Y_M, FREE_Z_M])
        arc = hinge + RADIUS_M * np.hstack([np.sin(angles), -np.cos(angles), np.zeros_like(angles)])
        return np.vstack([arc, [[THROUGH_X_M, 0.0, FREE_Z_M]]])

    def metrics(self) -> dict[str, float]:
        """How far the door was opened, by the hand's place, and whether the robot is through."""
        return {"opened_rad": self._widest_rad, "passed": float(self._passed)}

    def leaf(self, hand_m: np.ndarray) -> tuple[float, float]:
        """Angle of the leaf, rad, since it was touched, and distance from its hinge, m, at which the ball lies on it."""
        x, y = hand_m[0] - HINGE_X_M, hand_m[1] - HINGE_Y_M
        distance, off = float(np.hypot(x, y)), BALL_M + (HINGE_X_M - FACE_X_M)
        angle = float(np.arctan2(x, -y) + np.arcsin(min(1.0, off / max(distance, 1e-6))))
        return angle - self._closed_rad, float(np.sqrt(max(0.0, distance**2 - off**2)))

    def phases(self) -> Iterator[Phase]:
        """See Task."""
        ready = np.array([0.58, GRIP_Y_M, 0.66])
        touching, moved = Lasting(CONTACT_S), Lasting(CONTACT_S)

        def over() -> np.ndarray:
            return np.array([FACE_X_M - 0.045, self._grip_y_m, ON_GRIP_Z_M + 0.05])

        def low() -> np.ndarray:
            return np.array([FACE_X_M - BACK_M, self._grip_y_m, SLID_OFF_Z_M])

        def back(view: TaskView) -> Command:
            return view.command(low(), pitch_rad=PITCH_RAD)

        def reach(view: TaskView) -> Command:
            return view.command(over(), pitch_rad=PITCH_RAD)

        def above(view: TaskView) -> bool:
            return view.phase_s > 1.0 and reached(view, over(), 0.015)

        def approach(view: TaskView) -> Command:
            off = START_X_M - float(view.position_m[0])
            ahead = float(np.clip(off, -0.15, 0.15)) if abs(off) > 0.01 else 0.0
            hand = ready + [*view.position_m, 0.0] * np.array([1.0, 0.0, 0.0])
            return view.command(hand, pitch_rad=PITCH_RAD, velocity=(ahead, _steer(view, ahead)))

        def in_place(view: TaskView) -> bool:
            return view.phase_s > 2.0 and abs(START_X_M - view.position_m[0]) < 0.012 and abs(view.yaw_rad) < 0.06

        def press(view: TaskView) -> Command:
            down = min(PRESS_N, TOUCH_N + (PRESS_N - TOUCH_N) * max(0.0, view.phase_s - 0.6))
            self._pushing_n = TOUCH_N if view.phase_s < 1.6 else min(self._unlatch, 6.0 + 4.0 * (view.phase_s - 1.6))
            point = np.array([FACE_X_M - BALL_M, self._grip_y_m, ON_GRIP_Z_M])
            return view.command(point, pitch_rad=PITCH_RAD, mask=(1, 0, 1), force_n=(-self._pushing_n, 0.0, down))

        def unlatched(view: TaskView) -> bool:
            angle, _ = self.leaf(view.hand_m)
            self._moved_s = view.time_s
            return moved(view, angle > 0.08 and view.hand_m[2] < ON_GRIP_Z_M - 0.015)

        def slid_off(view: TaskView) -> bool:
            self._slid_off = bool(view.hand_m[2] < SLID_OFF_Z_M)
            return self._slid_off

        def touched(view: TaskView) -> bool:
            self._closed_rad += self.leaf(view.hand_m)[0]
            return touching(view, view.force_n[0] < -2.0)

        def push(view: TaskView) -> Command:
            angle, radius = self.leaf(view.hand_m)
            self._open(view, angle)
            if view.time_s - self._moved_s > STANDS_S:
                growth = GROWTH_NPS * CONTROL_PERIOD_S
                self._push = min(self._most, self._push + growth)
                self._pushing_n = min(self._most, self._pushing_n + growth)
            size = min(self._push, max(self._pushing_n, 6.0 + (self._push - 6.0) * max(0.0, angle)))
            force = _on_leaf(angle, size, radius, RADIUS_M)
            near = np.clip(HAND_AHEAD_M - 0.35 * (angle - 0.7), HAND_NEAR_M, HAND_AHEAD_M)
            ahead = float(np.clip(1.2 * (view.hand_in_heading_m[0] - near), -0.05, FOLLOW_MPS))
            over_lever = angle > AJAR_RAD
            point = np.array([*view.hand_m[:2], FREE_Z_M if over_lever else ON_GRIP_Z_M])
            if not over_lever:
                force = force + [0.0, 0.0, PRESS_N]
            return view.command(
                point,
                pitch_rad=PITCH_RAD,
                yaw_rad=float(np.clip(angle, 0.0, 1.1)),
                mask=(1, 1, 0) if over_lever else (1, 1, 1),
                force_n=force,
                velocity=(ahead, _steer(view, ahead)),
            )

        def stalled(view: TaskView) -> str | None:
            return "the door moves no more" if view.time_s - self._moved_s > STALLED_S else None

        def wide(view: TaskView) -> bool:
            return self.leaf(view.hand_m)[0] > OPEN_RAD and view.hand_in_heading_m[0] < 0.55

        def through(view: TaskView) -> Command:
            angle, radius = self.leaf(view.hand_m)
            self._open(view, angle)
            slow = view.position_m[0] < FAST_FROM_X_M or view.hand_in_heading_m[0] < BESIDE_M
            ahead = THROUGH_MPS if slow else FAST_MPS
            less = float(np.clip(1.0 - (angle - ENOUGH_RAD) / 0.5, 0.4, 1.0))
            return view.command(
                np.array([*view.hand_m[:2], FREE_Z_M]),
                pitch_rad=PITCH_RAD,
                yaw_rad=float(np.clip(angle, 0.0, 1.5)),
                mask=(1, 1, 0),
                force_n=_on_leaf(angle, self._push * less, radius, OUTER_RADIUS_M),
                velocity=(ahead, _steer(view, ahead)),
            )

        def behind(view: TaskView) -> bool:
            self._passed = bool(view.position_m[0] > THROUGH_X_M - 0.4)
            return view.position_m[0] > THROUGH_X_M or view.hand_in_heading_m[0] < -0.50 or self.leaf(view.hand_m)[1] > WIDTH_M

        def leave(view: TaskView) -> Command:
            sliding = view.phase_s < OFF_S
            ahead = THROUGH_MPS if sliding else FAST_MPS if view.position_m[0] < CLEAR_X_M else 0.0
            hand = np.array([0.5, 0.0, 0.62])
            command = view.command(
                np.zeros(3),
                pitch_rad=0.6,
                yaw_rad=view.yaw_rad,
                mask=(0, 1, 0) if sliding else (0, 0, 0),
                force_n=(0.0, -OFF_N, 0.0),
                velocity=(ahead, _steer(view, ahead)),
            )
            command.position_m[:] = hand
            return command

        yield Phase("approach", approach, in_place, limit_s=10.0, late="the robot does not come before the door", until=0.1)
        for grip in range(GRIPS):
            if grip:  # the place of the door is known less well than was thought
                self._grip_y_m -= NEARER_M
                yield Phase("back", back, lambda view: reached(view, low()), limit_s=3.0, until=0.1)
            late = "the hand does not come over the lever"
            yield Phase("reach", reach, above, limit_s=5.0, late=late, until=0.13)
            yield zeroing(reach, until=0.15)
            yield Phase(
                "touch",
                lambda view: view.command(over(), pitch_rad=PITCH_RAD, mask=(1, 0, 0), force_n=(-TOUCH_N, 0.0, 0.0)),
                touched,
                limit_s=5.0,
                late="no door is met",
                until=0.2,
            )
            late = "the door does not come off its latch"
            pressed = unlatched if grip + 1 == GRIPS else lambda view: slid_off(view) or unlatched(view)
            yield Phase("press", press, pressed, limit_s=9.0, late=late, until=0.35)
            if not self._slid_off:
                break
        yield Phase("push", push, wide, limit_s=25.0, late="the door is not wide enough", wrong=stalled, until=0.65)
        yield Phase("through", through, behind, limit_s=15.0, late="the robot does not come through", until=0.95)
        yield Phase(
            "leave",
            leave,
            lambda view: view.phase_s > 1.5 and view.position_m[0] > THROUGH_X_M - 0.02,
            limit_s=6.0,
            late="the robot does not come through",
        )

    def _open(self, view: TaskView, angle_rad: float) -> None:
        if angle_rad > self._widest_rad + MOVED_RAD or angle_rad > OPEN_RAD:
            self._moved_s = view.time_s
            self._widest_rad = max(self._widest_rad, angle_rad)


def _on_leaf(angle_rad: float, push_n: float, radius_m: float, wanted_m: float) -> np.ndarray:
    """Force (3,) N on the hand that pushes a leaf at an angle with a force and goes to a distance from the hinge."""
    normal = np.array([np.cos(angle_rad), np.sin(angle_rad), 0.0])
    along = np.array([np.sin(angle_rad), -np.cos(angle_rad), 0.0])
    slide = np.clip(ALONG_STIFFNESS * (wanted_m - radius_m), -ALONG_LIMIT_N, ALONG_LIMIT_N)
    return -(push_n * normal + slide * along)


def _steer(view: TaskView, ahead_mps: float) -> float:
    """Yaw rate, rad/s, that drives along the doorway's middle, or turns to face it."""
    wanted = float(np.clip(-1.5 * view.position_m[1], -0.25, 0.25))
    error = float(np.arctan2(np.sin(wanted - view.yaw_rad), np.cos(wanted - view.yaw_rad)))
    return float(np.clip(1.2 * error, -0.3, 0.3)) if abs(ahead_mps) > 0.01 or abs(error) > 0.05 else 0.0
