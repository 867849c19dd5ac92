"""A ConsoleSink that keeps what it was told."""

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from typing import Any

from control.command.limits import CommandLimits
from sim.backends.hardware.status import HardwareStatus
from sim.backends.simulation.mismatch import Mismatch
from sim.tasks.task import SITE_OPTIONS

PATIENCE_S = 20.0


class RecordingTasks:
    """A TaskSink: one task, which is always at work on `answer`."""

    def __init__(self, calls: list[tuple[str, Any]]) -> None:
        self._calls = calls
        self.answer: dict[str, Any] = {}

    def kinds(self) -> list[dict[str, Any]]:
        number = {"default": 1.0, "minimum": 0.0, "maximum": 2.0, "unit": "N"}
        site = dict.fromkeys(SITE_OPTIONS, number)
        return [
            {"name": name, "scene": "box", "description": "does", "options": {key: number, **site}}
            for name, key in (("push", "force_n"), ("pull", "time_s"))
        ]

    def start(self, name: str, options: Mapping[str, float]) -> None:
        self._calls.append(("start_task", (name, dict(options))))

    def get(self) -> dict[str, Any]:
        return self.answer

    def abort(self) -> None:
        self._calls.append(("abort_task", None))


def until(condition: Callable[[], object]) -> None:
    """Wait until a condition holds."""
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, "it never happened"
        time.sleep(0.005)


class RecordingPast:
    """A PastSink that shows 12.5 s."""

    def __init__(self, calls: list[tuple[str, Any]]) -> None:
        self._calls = calls

    def seek(self, time_s: float) -> None:
        self._calls.append(("seek", time_s))

    def branch(self, **changes: Any) -> None:
        self._calls.append(("branch", changes))

    def replay(self) -> dict[str, Any]:
        return {"time_s": 0.0, "duration_s": 12.5, "state": "playing", "speed": 1.0}

    def change_replay(self, **changes: Any) -> None:
        self._calls.append(("replay", changes))


class RecordingRecordings:
    """A RecordingsSink with two."""

    def __init__(self, calls: list[tuple[str, Any]]) -> None:
        self._calls = calls

    def start(self, name: str) -> None:
        self._calls.append(("start_recording", name))

    def stop(self) -> None:
        self._calls.append(("stop_recording", None))

    def ids(self) -> list[str]:
        return ["20261128-b", "20261128-a"]


class RecordingEstimates:
    """An EstimatesSink whose estimator is done at the second question."""

    def __init__(self, calls: list[tuple[str, Any]]) -> None:
        self._calls = calls
        self._asked = 0
        self.shown: str | None = None

    def again(self, estimator: str, gains: tuple[float, float] | None) -> int:
        self._calls.append(("again", (estimator, gains)))
        self._asked = 0
        return 7

    def result(self, recording: str, key: int) -> dict[str, Any]:
        assert (recording, key) == (self.shown, 7)
        self._asked += 1
        if self._asked == 1:
            return {"state": "running"}
        forces = [[float(index), 0.0, -2.0] for index in range(100)]
        numbers = {"difference_rms_n": 1.5, "error_rms_n": 0.5, "error_then_rms_n": 2.0}
        named = {"state": "done", "estimator": "adaptive", "gains": {"k1": 12.0, "k2": 80.0}, "message": None}
        return {**named, **numbers, "time_s": [0.02 * index for index in range(100)], "force_n": forces}


class RecordingSink:
    """Records every call as (method, argument) in `calls`, and raises `refusal` where there is one."""

    limits = CommandLimits()

    def __init__(self) -> None:
        self.calls: list[tuple[str, Any]] = []
        self.status: HardwareStatus | None = None
        self.tasks = RecordingTasks(self.calls)
        self.chosen_mismatch = Mismatch()
        self.wrenches: list[dict[str, Any]] = []
        self.refusal: Exception | None = None
        self.past = RecordingPast(self.calls)
        self.recordings = RecordingRecordings(self.calls)
        self.estimates = RecordingEstimates(self.calls)

    def available(self) -> dict[str, Any]:
        return {
            "controllers": ["model_based"],
            "estimators": ["gmo_pi", "adaptive"],
            "scenes": ["free", "box"],
            "backends": [
                {"name": "simulation", "available": True, "reason": None},
                {"name": "hardware", "available": False, "reason": "no robot <answers>"},
            ],
        }

    def _call(self, name: str, argument: Any) -> None:
        self.calls.append((name, argument))
        if self.refusal is not None:
            raise self.refusal

    def wait_for(self, name: str) -> Any:
        """The argument of the newest call of a method, which a panel makes in its own time."""
        until(lambda: any(called == name for called, _ in self.calls))
        return next(argument for called, argument in reversed(self.calls) if called == name)

    def patch_command(self, **fields: Any) -> None:
        self._call("patch_command", fields)

    def set_drag(self, target_in_world: tuple[float, float, float] | None) -> None:
        self._call("set_drag", target_in_world)

    def select_controller(self, name: str) -> None:
        self._call("select_controller", name)

    def select_estimator(self, name: str) -> None:
        self._call("select_estimator", name)

    def mismatch(self) -> Mismatch:
        return self.chosen_mismatch

    def set_mismatch(self, **fields: Any) -> None:
        self._call("set_mismatch", fields)

    def tare(self) -> None:
        self._call("tare", None)

    def clear_tare(self) -> None:
        self._call("clear_tare", None)

    def set_tool(self, mass_kg: float, center_of_mass_m: Sequence[float]) -> None:
        self._call("set_tool", (mass_kg, tuple(center_of_mass_m)))

    def identify_tool(self) -> None:
        self._call("identify_tool", None)

    def add_wrench(self, **fields: Any) -> int:
        self._call("add_wrench", fields)
        return 1

    def list_wrenches(self) -> "Future[list[dict[str, Any]]]":
        listed: Future[list[dict[str, Any]]] = Future()
        listed.set_result(self.wrenches)
        return listed

    def remove_wrench(self, key: int) -> None:
        self._call("remove_wrench", key)

    def set_scene(self, name: str) -> None:
        self._call("set_scene", name)

    def set_parameters(self, values: Mapping[str, float]) -> None:
        self._call("set_parameters", dict(values))

    def set_backend(self, name: str, **options: Any) -> None:
        self._call("set_backend", (name, options))

    def drive(self, request: str) -> None:
        self._call("drive", request)

    def hardware_status(self) -> HardwareStatus | None:
        return self.status

    def set_run(self, state: str | None, speed: float | None) -> None:
        self._call("set_run", (state, speed))
