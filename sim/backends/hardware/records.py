"""What the I/O process and the control process tell each other, and the file of shared memory that holds it.

Each direction is a SharedRecord with one writer. The e-stop is one byte that anybody may set and only the I/O process clears.

The memory is a file with a name, because the I/O process outlives the process that started it and the next one must find it.
It lies in a folder of its user alone.
"""

import contextlib
import mmap
import os
import stat
from enum import IntEnum
from io import FileIO
from pathlib import Path

import numpy as np

from control.joints import JOINT_COUNT
from sim.backends.hardware.config import HardwareConfig
from sim.backends.hardware.robot import SENSOR_COUNT
from sim.backends.protocol import BackendError
from sim.processes.private_folder import UnsafeFolderError, open_private_folder
from sim.processes.shared_record import SharedRecord, size_of

IO_TICK = np.dtype(
    [
        ("sequence", "u8"),
        ("time_s", "f8"),  # monotonic, of the tick
        ("control_heard_s", "f8"),  # monotonic, newest sign of life of a control process
        ("base_received_s", "f8"),  # monotonic
        ("arm_received_s", "f8"),
        ("request_sequence", "u8"),  # of the last request that was handled
        ("tick_work_ms", "f4"),
        ("worst_period_ms", "f4"),  # of the last second
        ("faults", "u4"),  # Trip bits
        ("fault_joints", "u4"),  # states.joint_bits
        ("state", "u1"),  # DriveState
        ("engaging", "?"),
        ("refused", "?"),  # the last request was; message says why
        ("has_frame", "?"),
        ("ending", "?"),  # it was told to end, and damps until the robot is at rest
        ("realtime_scheduling", "?"),
    ]
)
"""What is new at every tick, in the order in which IoLoop fills it."""

IO_STATE = np.dtype(
    [
        ("sensors", "f8", SENSOR_COUNT),  # sim.backends.hardware.robot.sensor_frame; NaN until heard. First: so it is aligned
        *IO_TICK.descr,
        ("pid", "u4"),
        ("dry_run", "?"),
        ("warnings", "u4"),
        ("message", "S400"),
        ("progress", "f4"),
        ("temperature", "f4", JOINT_COUNT),  # NaN until heard, as battery
        ("lost", "u4", 16),
        ("battery_percent", "f4"),
        ("battery_v", "f4"),
        ("arm_mode", "u1"),
        ("states_received", "u8"),
        ("states_missed", "u8"),
        ("bad_messages", "u8"),
        ("frames_sent", "u8"),
        ("foreign_writers", "u2"),
    ]
)

IO_COMMAND = np.dtype(
    [
        ("targets", "f8", (5, JOINT_COUNT)),  # position, velocity, stiffness, damping, torque; first: so they are aligned
        ("sequence", "u8"),  # counts joint commands
        ("time_s", "f8"),  # monotonic, of the joint command
        ("alive_s", "f8"),  # monotonic, of the newest sign of life
        ("operator_silent_s", "f8"),
        ("request", "u1"),  # Request
        ("request_sequence", "u8"),
    ]
)

_ESTOP_BYTES = 64
READ_ATTEMPTS = 3
"""Whoever ticks at 500 Hz does not wait for a writer: the last record holds for one tick more."""


class EstopSource(IntEnum):
    """Who set the e-stop byte; zero is nobody."""

    NONE = 0
    OPERATOR = 1


def _aligned(dtype: np.dtype) -> int:
    return -(-size_of(dtype) // 64) * 64


class IoMemory:
    """Both records and the e-stop byte.

    Args:
        path: from `memory_path`.
        create: make it anew, as the I/O process does; otherwise it must exist.

    Raises:
        BackendError: it does not exist, is of another version, or its folder is not this user's alone.
    """

    def __init__(self, path: Path, create: bool = False) -> None:
        size = _ESTOP_BYTES + _aligned(IO_STATE) + _aligned(IO_COMMAND)
        self._file = _open(path, size if create else None)
        status = os.fstat(self._file.fileno())
        if status.st_size != size or not stat.S_ISREG(status.st_mode):
            self._file.close()
            raise BackendError(f"{path} belongs to another version; end its I/O process and delete it")
        self._map = mmap.mmap(self._file.fileno(), size)
        view = np.frombuffer(self._map, np.uint8)
        self._estop = view[:1]
        command = _ESTOP_BYTES + _aligned(IO_STATE)
        self.state = SharedRecord(view[_ESTOP_BYTES : _ESTOP_BYTES + size_of(IO_STATE)], IO_STATE)
        self.command = SharedRecord(view[command : command + size_of(IO_COMMAND)], IO_COMMAND)

    @property
    def has_name(self) -> bool:
        """Whether anybody can still find it."""
        return os.fstat(self._file.fileno()).st_nlink > 0

    @property
    def estop(self) -> bool:
        """Whether somebody has asked for an e-stop that the I/O process has not taken yet."""
        return bool(self._estop[0])

    @estop.setter
    def estop(self, asked: bool) -> None:
        self._estop[0] = EstopSource.OPERATOR if asked else EstopSource.NONE


def _open(path: Path, new_size: int | None) -> FileIO:
    """The file, made anew with `new_size` bytes unless that is None."""
    try:
        folder = open_private_folder(path.parent)
    except UnsafeFolderError as error:
        raise BackendError(str(error)) from None
    except OSError as error:
        raise BackendError(f"the hardware backend keeps shared memory in {path.parent}: {error.strerror}") from None
    flags = os.O_RDWR | os.O_NOFOLLOW
    try:
        if new_size is None:
            return FileIO(os.open(path.name, flags, dir_fd=folder), "r+")
        with contextlib.suppress(FileNotFoundError):
            os.unlink(path.name, dir_fd=folder)
        file = FileIO(os.open(path.name, flags | os.O_CREAT | os.O_EXCL, 0o600, dir_fd=folder), "r+")
        file.truncate(new_size)
        return file
    except FileNotFoundError:
        raise BackendError(f"no I/O process has made {path}; open the hardware backend first") from None
    except OSError as error:
        raise BackendError(f"shared memory {path} cannot be opened: {error.strerror}") from None
    finally:
        os.close(folder)


def memory_path(config: HardwareConfig) -> Path:
    """Where the shared memory of a robot's I/O process is, per user and network."""
    return Path(f"/dev/shm/forcelens-{os.geteuid()}") / f"{config.base.interface}-{config.base.domain}"
