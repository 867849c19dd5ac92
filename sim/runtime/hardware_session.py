"""The session of a real robot: the same pipeline, estimators and snapshots; what only a simulation can do is refused.

Before POLICY the pipeline watches: estimates are shown, its commands go nowhere. When the drives' state machine enters
POLICY the pipeline starts afresh from the measured posture, so that nothing of the time before jumps into the motors.
"""

from typing import Any, NoReturn, cast

import numpy as np

from control.pipeline import PipelineOutput
from control.types import Command
from sim.backends.hardware.backend import HardwareBackend
from sim.backends.hardware.config import HardwareConfig
from sim.backends.hardware.states import REQUEST_NAMES, DriveState, Request
from sim.backends.simulation.applied_wrenches import ActiveWrench
from sim.backends.simulation.mujoco_backend import MujocoBackend
from sim.runtime.session import Session, SessionConfig, SessionError
from sim.runtime.snapshot import Mode


class HardwareSession(Session):
    """A Session around HardwareBackend.

    Args:
        config: its pipeline is used; scene, seed and sensors belong to the simulation.
        hardware: the robot; a dry run by default.
        backend: instead of one made from `hardware`, for tests.

    Raises:
        BackendError: the robot cannot be reached; the message names the cure.
    """

    def __init__(
        self,
        config: SessionConfig | None = None,
        hardware: HardwareConfig | None = None,
        backend: HardwareBackend | None = None,
    ) -> None:
        self.hardware = backend or HardwareBackend(hardware)
        self._drive_state = DriveState.DISCONNECTED
        super().__init__(config)

    def _open_backend(self) -> MujocoBackend:
        self.hardware.open()
        # The base class drives whatever reads and writes; what only MujocoBackend has is overridden below.
        return cast(MujocoBackend, self.hardware)

    @property
    def mode(self) -> Mode:
        """ESTOP while the e-stop is latched here, FAULT while the drives are in FAULT, otherwise RUNNING."""
        if self.pipeline.estop_latched:
            return Mode.ESTOP
        return Mode.FAULT if self.hardware.state == DriveState.FAULT else Mode.RUNNING

    def tick(self, command: Command, command_age_s: float = 0.0) -> PipelineOutput:
        """One 2 ms tick on the newest state. The operator's age goes to the I/O process, which damps when it grows."""
        self.hardware.operator_silent_s = command_age_s
        state = self.hardware.state
        if state != self._drive_state and state == DriveState.POLICY:
            self._reset_pipeline()
        self._drive_state = state
        return super().tick(command, command_age_s)

    def drive(self, request: str) -> int:
        """Ask for a change of the drives' state, by the name of a Request in lower case; returns its sequence number.

        Raises:
            ValueError: no such request.
            SessionError: the e-stop is latched.
        """
        if request not in REQUEST_NAMES:
            raise ValueError(f"request must be one of {', '.join(REQUEST_NAMES)}")
        if self.pipeline.estop_latched:
            raise SessionError("the e-stop is latched; POST /api/v1/estop/clear first")
        return self.hardware.request(Request[request.upper()])

    def estop(self) -> None:
        """Latch the e-stop here and in the I/O process."""
        self.hardware.estop()
        super().estop()

    def clear_estop(self) -> None:
        """Clear the e-stop here; the drives' FAULT is cleared too if the robot is at rest, and then needs STAND."""
        super().clear_estop()
        self.hardware.request(Request.CLEAR)

    def reset(self, seed: int | None = None, keyframe: str = "stand") -> NoReturn:
        """Raises SessionError: a robot cannot be put back."""
        raise _simulation_only("reset")

    def set_scene(self, name: str) -> NoReturn:
        """Raises SessionError: a robot is where it is."""
        raise _simulation_only("the scene")

    def set_mismatch(self, mass_scale: float, per_link: dict[str, float] | None = None) -> NoReturn:
        """Raises SessionError: a robot weighs what it weighs."""
        raise _simulation_only("mismatch")

    def add_wrench(self, **spec: Any) -> NoReturn:
        """Raises SessionError: a robot is pushed by hand."""
        raise _simulation_only("wrenches")

    def list_wrenches(self) -> tuple[ActiveWrench, ...]:
        """None."""
        return ()

    def remove_wrench(self, key: int) -> NoReturn:
        """Raises KeyError: there are none."""
        raise KeyError(f"no wrench {key}")

    def _set_drag(self, target_in_world: np.ndarray | None) -> None:
        """A robot is dragged by hand."""

    def _fill_simulation(self, record: np.void) -> None:
        hardware = self.hardware
        record["drive_state"], record["drive_faults"] = hardware.state, int(hardware.faults)
        record["dry_run"] = hardware.config.dry_run
        if hardware.state != DriveState.POLICY:
            record["faults"] = 0  # of a pipeline that only watches
        for name in ("mass_scale_true", "drag_target_in_world", "drag_force_n"):
            record[name] = np.nan
        record["drag_active"] = False


def _simulation_only(what: str) -> SessionError:
    return SessionError(f"{what}: simulation only; PUT /api/v1/backend with 'simulation' first")
