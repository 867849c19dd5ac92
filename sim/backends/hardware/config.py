"""What the hardware backend and its I/O process are started with."""

import json
from dataclasses import asdict, dataclass, field
from typing import Any

from sim.backends.hardware.io.motions import MotionConfig
from sim.backends.hardware.limits import HardwareLimits
from sim.backends.unitree.dds import DdsConfig, RobotNetworkError
from sim.backends.z1.driver import Z1Config


@dataclass(frozen=True, slots=True)
class HardwareConfig:
    """One robot.

    Attributes:
        base: DDS network of the base.
        arm: UDP address of the arm.
        limits: every threshold.
        motion: postures and gains of standing up and sitting down.
        dry_run: compute everything and send nothing that could move the robot. The default.
        echo_tick: answer every state with its tick in a spare word, for the emulator's lockstep and round-trip times. Not
            for a robot.
    """

    base: DdsConfig = field(default_factory=DdsConfig)
    arm: Z1Config = field(default_factory=Z1Config)
    limits: HardwareLimits = field(default_factory=HardwareLimits)
    motion: MotionConfig = field(default_factory=MotionConfig)
    dry_run: bool = True
    echo_tick: bool = False

    def __post_init__(self) -> None:
        if not self.arm.is_loopback and not self.base.allow_robot:
            raise RobotNetworkError(f"the arm at {self.arm.host!r} may be real; say so explicitly (allow_robot, --allow-robot)")

    def to_json(self) -> str:
        """Text for the I/O process's command line."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> "HardwareConfig":
        """Inverse of `to_json`."""
        fields: dict[str, Any] = json.loads(text)
        return cls(
            base=DdsConfig(**fields.pop("base")),
            arm=Z1Config(**fields.pop("arm")),
            limits=HardwareLimits(**fields.pop("limits")),
            motion=MotionConfig(**fields.pop("motion")),
            **fields,
        )
