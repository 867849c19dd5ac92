"""A ConsoleSink that keeps what it was told."""

from collections.abc import Mapping
from typing import Any

from control.command.limits import CommandLimits
from sim.backends.hardware.status import HardwareStatus
from sim.tasks.task import SITE_OPTIONS


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


class RecordingSink:
    """Records every call as (method, argument) in `calls`."""

    limits = CommandLimits()

    def __init__(self) -> None:
        self.calls: list[tuple[str, Any]] = []
        self.status: HardwareStatus | None = None
        self.tasks = RecordingTasks(self.calls)
        self.past = RecordingPast(self.calls)
        self.recordings = RecordingRecordings(self.calls)

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

    def patch_command(self, **fields: Any) -> None:
        self._call("patch_command", fields)

    def set_drag(self, target_in_world: tuple[float, float, float] | None) -> None:
        self._call("set_drag", target_in_world)

    def select_controller(self, name: str) -> None:
        self._call("select_controller", name)

    def select_estimator(self, name: str) -> None:
        self._call("select_estimator", name)

    def set_mismatch(self, mass_scale: float) -> None:
        self._call("set_mismatch", mass_scale)

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
