"""What a control process drives: the simulation, one robot, or a recording, which it only shows."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, cast

from server.answers.selection import BackendName, RobotOptions
from server.errors import InvalidFieldError
from sim.backends.hardware.backend import HardwareBackend
from sim.backends.hardware.config import HardwareConfig
from sim.backends.protocol import Backend
from sim.backends.unitree.dds import RobotNetworkError
from sim.runtime.replay_session import ReplaySession
from sim.runtime.robot_session import RobotSession
from sim.runtime.session import Session
from sim.runtime.simulation import Simulation, SimulationConfig


@dataclass(frozen=True, slots=True)
class BackendChoice:
    """The simulation, or with `hardware` a robot, or with `recording` a file that is shown again."""

    hardware: HardwareConfig | None = None
    recording: Path | None = None

    @property
    def name(self) -> BackendName:
        """As in REST."""
        if self.recording is not None:
            return "replay"
        return "simulation" if self.hardware is None else "hardware"

    def launch(self, *, paused: bool) -> dict[str, Any]:
        """Fields of ControlLaunch. A robot's time cannot be paused."""
        if self.recording is not None:
            return {"make_session": partial(_replay_session, path=self.recording), "paused": paused}
        if self.hardware is None:
            return {"make_session": Simulation, "paused": paused}
        return {"make_session": partial(_robot_session, hardware=self.hardware), "paused": False}

    def options(self) -> RobotOptions:
        """As in REST."""
        if self.recording is not None:
            return {"recording": self.recording.stem}
        if self.hardware is None:
            return {}
        base, arm = self.hardware.base, self.hardware.arm
        return {
            "dry_run": self.hardware.dry_run,
            "allow_robot": base.allow_robot,
            "domain": base.domain,
            "interface": base.interface,
            "arm_host": arm.host,
            "arm_port": arm.command_port,
        }


def _robot_session(config: SimulationConfig, hardware: HardwareConfig) -> RobotSession:
    return RobotSession(HardwareBackend(hardware), config.pipeline)


def _replay_session(_: SimulationConfig, path: Path) -> Session[Backend]:
    return cast(Session[Backend], ReplaySession(path))


def with_options(config: HardwareConfig, options: Mapping[str, Any]) -> HardwareConfig:
    """`config` with some of BackendChoice.options changed. The arm answers on the port after the one it listens on.

    Raises:
        InvalidFieldError: a network that may hold a robot, without consent; or one that cannot be.
    """
    base = {name: options[name] for name in ("domain", "interface", "allow_robot") if name in options}
    port = options.get("arm_port", config.arm.command_port)
    host = options.get("arm_host", config.arm.host)
    try:
        return replace(
            config,
            base=replace(config.base, **base),
            arm=replace(config.arm, host=host, command_port=port, state_port=port + 1),
            dry_run=options.get("dry_run", config.dry_run),
        )
    except RobotNetworkError as error:
        raise InvalidFieldError(
            "options.allow_robot", f"is not given: {error}", "true, if a real robot is meant and --allow-robot permits it"
        ) from None
    except ValueError as error:
        raise InvalidFieldError("options", f"are refused: {error}", "see the message") from None
