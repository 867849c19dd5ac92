"""What the server is started with."""

import ipaddress
from dataclasses import dataclass, field
from pathlib import Path

from server.access import LOOPBACK_NAMES
from server.logs import LogConfig
from sim.backends.hardware.config import HardwareConfig
from sim.recording.folder import RecordingFolder, default_folder
from sim.runtime.simulation import SimulationConfig


class ConfigError(ValueError):
    """Settings that do not go together; the message says which and the cure."""


@dataclass(frozen=True, slots=True)
class ServerConfig:
    """Settings of one server.

    Attributes:
        host: address to bind.
        port: TCP port; 0 lets the system choose.
        token: required of every request; None only on a loopback address.
        open_browser: open the page where a display exists.
        session: what the control process steps.
        hardware: the robot that the hardware backend drives unless told otherwise.
        log: what the console and its control process log.
        recordings: where they lie, and how much they may take.

    Raises:
        ConfigError: another address than loopback without a token.
    """

    host: str = "127.0.0.1"
    port: int = 8080
    token: str | None = None
    open_browser: bool = True
    session: SimulationConfig = field(default_factory=SimulationConfig)
    hardware: HardwareConfig = field(default_factory=HardwareConfig)
    log: LogConfig = field(default_factory=LogConfig)
    recordings: RecordingFolder = field(default_factory=lambda: RecordingFolder(default_folder()))

    def __post_init__(self) -> None:
        if self.token is None and not is_loopback(self.host):
            raise ConfigError(
                f"{self.host} can be reached by others: set a token with FORCELENS_TOKEN or --token-file, or bind 127.0.0.1"
            )
        if self.token is not None and len(self.token) < 8:
            raise ConfigError("the token is too short; use at least 8 characters")


def token_of_file(path: Path) -> str:
    """The token that a file holds, alone or with a line end.

    Raises:
        ConfigError: the file cannot be read.
    """
    try:
        return path.read_text(encoding="utf-8", errors="surrogateescape").rstrip("\r\n")
    except OSError as error:
        raise ConfigError(f"cannot read the token's file {path}: {error.strerror}") from None


def is_loopback(host: str) -> bool:
    """Whether an address can only be reached from this machine."""
    if host in LOOPBACK_NAMES:
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
