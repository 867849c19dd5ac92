"""A ConsoleSink that keeps what it was told."""

from typing import Any

from control.command.limits import CommandLimits
from sim.backends.hardware.status import HardwareStatus


class RecordingSink:
    """Records every call as (method, argument) in `calls`."""

    limits = CommandLimits()

    def __init__(self) -> None:
        self.calls: list[tuple[str, Any]] = []
        self.status: HardwareStatus | None = None

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

    def seek(self, time_s: float) -> None:
        self._call("seek", time_s)

    def branch(self, **changes: Any) -> None:
        self._call("branch", changes)

    def start_recording(self, name: str) -> None:
        self._call("start_recording", name)

    def stop_recording(self) -> None:
        self._call("stop_recording", None)

    def recording_ids(self) -> list[str]:
        return ["20261128-b", "20261128-a"]

    def replay(self, **changes: Any) -> dict[str, Any]:
        self._call("replay", changes)
        return {"time_s": 0.0, "duration_s": 12.5, "state": "playing", "speed": 1.0}

    def set_backend(self, name: str, **options: Any) -> None:
        self._call("set_backend", (name, options))

    def drive(self, request: str) -> None:
        self._call("drive", request)

    def hardware_status(self) -> HardwareStatus | None:
        return self.status

    def set_run(self, state: str | None, speed: float | None) -> None:
        self._call("set_run", (state, speed))
