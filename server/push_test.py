"""A push test: pulls at the hand of the live simulation, one after the other, by the recipe of sim.trials.pull.

The operator's own calls drive it, so whatever else is asked for meanwhile ends it: an e-stop, a scene, a reset, a command.
"""

import contextlib
import math
import threading
from contextvars import copy_context
from dataclasses import replace
from typing import Any

import numpy as np

from control.types import Command
from server.errors import InvalidFieldError, RefusedError, ServerError
from server.operator import Operator
from sim.runtime.snapshot import Mode, on_hardware
from sim.trials.pull import AFTER_S, DIRECTIONS, MODES, PULL_S, SETTLE_S, Pull
from sim.trials.trial import FALLEN_HEIGHT_M, FALLEN_UP_COSINE, TrialSetup
from web.push_test import PullOutcome, PushTestStatus

FORCE_RANGE_N = (1.0, 60.0)
RAMP_S = 0.3
LOOK_S = 0.02
"""Between two looks at the robot, wall-clock."""

ALL_AROUND = tuple((float(x), float(y), float(z)) for x, y, z in DIRECTIONS)
CHOICES = {8: tuple(d for d in ALL_AROUND if d[2] == 0.0), 26: ALL_AROUND}


class _EndedError(Exception):
    """Something came between; the message says what."""


class PushTest:
    """One push test at a time. See web.push_test.PushTests."""

    def __init__(self, operator: Operator) -> None:
        self._operator = operator
        self._lock = threading.Lock()
        self._status = PushTestStatus()
        self._cancelled = threading.Event()

    def start(self, mode: str, force_n: float, directions: int) -> None:
        """Begin.

        Args:
            mode: of sim.trials.pull.MODES: how the robot yields.
            force_n: N, of every pull.
            directions: how many, of CHOICES.

        Raises:
            InvalidFieldError: names the argument and what is allowed.
            RefusedError: a test runs already, or the simulation does not.
        """
        if mode not in MODES:
            raise InvalidFieldError("mode", f"{mode!r} does not exist", ", ".join(MODES))
        if not FORCE_RANGE_N[0] <= force_n <= FORCE_RANGE_N[1]:
            raise InvalidFieldError("force_n", "is outside the allowed range", "{:g} to {:g} N".format(*FORCE_RANGE_N))
        if directions not in CHOICES:
            raise InvalidFieldError("directions", "is no choice", ", ".join(map(str, CHOICES)))
        self._operator.client.require_alive()
        snapshot = self._operator.client.require_snapshot()
        if on_hardware(snapshot):
            raise RefusedError("the push test: simulation only; choose the backend 'simulation' first")
        if snapshot["mode"] == Mode.ESTOP or snapshot["mode"] == Mode.PAUSED:
            raise RefusedError("the simulation does not run; clear the e-stop, or run it")
        plans = [Pull(TrialSetup(), mode, force_n, each, RAMP_S, False, i) for i, each in enumerate(CHOICES[directions])]
        with self._lock:
            if self._status.running:
                raise RefusedError("a push test runs already; cancel it first")
            self._status = PushTestStatus(running=True, planned=len(plans))
            self._cancelled.clear()
        scene = bytes(snapshot["scene"])
        context = copy_context()  # whoever asks for it
        threading.Thread(target=context.run, args=(self._run, plans, scene), name="push-test", daemon=True).start()

    def cancel(self) -> None:
        """End it soon."""
        self._cancelled.set()

    def status(self) -> PushTestStatus:
        """How far it is, or how it ended."""
        with self._lock:
            return self._status

    def _run(self, plans: list[Pull], scene: bytes) -> None:
        before, _ = self._operator.command()
        watch = _Watch(self._operator, scene, self._cancelled)
        message = "The test failed; the console's log tells more."
        try:
            for plan in plans:
                outcome = watch.pull(plan)
                with self._lock:
                    self._status = replace(self._status, done=(*self._status.done, outcome))
            self._operator.reset()
            watch.commanded = self._operator.command()[1]
            message = "The test is done."
        except _EndedError as end:
            message = f"The test ended: {end}."
        except ServerError as error:
            message = f"The test ended: {error}"
        finally:
            watch.let_go()
            # What somebody else has commanded stays; while the e-stop is latched nothing is taken.
            if self._operator.command()[1] == watch.commanded:
                with contextlib.suppress(ServerError):
                    self._operator.patch_command(**_fields(replace(before, base_velocity=np.zeros(3))))
            with self._lock:
                self._status = replace(self._status, running=False, message=message)


class _Watch:
    """Pulls, and ends with _EndedError when something comes between.

    Attributes:
        commanded: number of the newest command that is the test's own.
    """

    def __init__(self, operator: Operator, scene: bytes, cancelled: threading.Event) -> None:
        self._operator, self._scene, self._cancelled = operator, scene, cancelled
        self._seen_s = -math.inf
        self._wrenches: list[int] = []
        self.commanded = operator.command()[1]

    def pull(self, plan: Pull) -> PullOutcome:
        """Reset, let the robot settle and then yield, pull, and watch until a second after."""
        self._operator.reset(plan.seed)
        self.commanded, self._seen_s = self._operator.command()[1], -math.inf
        self._until(self._took_effect() + SETTLE_S)
        _, self.commanded = self._operator.patch_command(**_fields(MODES[plan.mode]))
        begin_s = self._took_effect() + SETTLE_S
        start = self._until(begin_s)["end_effector_position"].copy()
        pulses = list(plan.pulses())
        tilt, excursion, fell, elapsed = 0.0, 0.0, False, 0.0
        while not fell and elapsed < PULL_S + AFTER_S:
            snapshot = self._look()
            elapsed = float(snapshot["time_s"]) - begin_s
            while pulses and pulses[0][0] <= elapsed:
                pulse = pulses.pop(0)[1]
                force = pulse.force_n.tolist()
                add = self._operator.add_wrench
                self._wrenches.append(add(force_n=force, duration_s=pulse.duration_s, frame=pulse.frame, ramp_s=pulse.ramp_s))
            w, x, y, z = snapshot["base_orientation_wxyz"]
            up = float(np.clip(w * w - x * x - y * y + z * z, -1.0, 1.0))
            tilt = max(tilt, math.degrees(math.acos(up)))
            excursion = max(excursion, float(np.linalg.norm(snapshot["end_effector_position"] - start)))
            lies = up < FALLEN_UP_COSINE or snapshot["base_position"][2] < FALLEN_HEIGHT_M
            fell = bool(lies or snapshot["mode"] == Mode.FAULT)
        self.let_go()
        return PullOutcome(plan.direction, fell, tilt, excursion)

    def let_go(self) -> None:
        """End the pulls that still act."""
        for key in self._wrenches:
            with contextlib.suppress(ServerError):  # most have expired
                self._operator.remove_wrench(key)
        self._wrenches.clear()

    def _until(self, time_s: float) -> np.void:
        while (snapshot := self._look())["time_s"] < time_s:
            pass
        return snapshot

    def _took_effect(self) -> float:
        """Simulated time at which the robot follows the newest command."""
        while int((snapshot := self._look(new=True))["command_sequence"]) != self.commanded:
            pass
        self._seen_s = float(snapshot["time_s"])
        return self._seen_s

    def _look(self, *, new: bool = False) -> np.void:
        """The next snapshot; `new`: it may still be one from before a reset."""
        if self._cancelled.wait(LOOK_S):
            raise _EndedError("it was cancelled")
        snapshot = self._operator.client.live_snapshot()
        if snapshot is None:
            raise _EndedError("the control process does not answer")
        if snapshot["mode"] == Mode.ESTOP or self._operator.client.estops.pending:
            raise _EndedError("the e-stop was pressed")
        if on_hardware(snapshot) or bytes(snapshot["scene"]) != self._scene:
            raise _EndedError("another scene or robot was chosen")
        if self._operator.command()[1] != self.commanded:
            raise _EndedError("something else was commanded, or the simulation was reset")
        if not new:
            if snapshot["time_s"] < self._seen_s:
                raise _EndedError("the simulation was reset")
            self._seen_s = float(snapshot["time_s"])
        return snapshot


def _fields(command: Command) -> dict[str, Any]:
    """A command as a patch of all its fields."""
    return {
        "mask": [int(each) for each in command.mask],
        "force_n": command.force_n,
        "position_m": command.position_m,
        "orientation_wxyz": command.orientation_wxyz,
        "base_velocity": command.base_velocity,
        "guidance": bool(command.guidance),
    }
