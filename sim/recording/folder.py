"""The folder with the recordings: what is in it, how much it may hold, and what a crash left behind in it."""

import fcntl
import logging
import os
import re
import shutil
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from mcap.reader import make_reader

from sim.recording.recorder import PART
from sim.recording.repair import REPAIRED, NoRecordingError, is_whole, repair

DEFAULT_BUDGET_BYTES = 20 * 10**9
RESERVE_BYTES = 10**9
"""Of the disk, left to others."""

LEAST_BYTES = 10 * 10**6
"""With less than this left, no recording starts."""

SUFFIX = ".mcap"
_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,62}")

_log = logging.getLogger(__name__)


class RecordingError(RuntimeError):
    """What is asked of the recordings cannot be; the message says what to do."""


class UnknownRecordingError(RecordingError):
    """There is no recording of that id."""


@dataclass(frozen=True, slots=True)
class RecordingRow:
    """What is known of a recording without reading it.

    Attributes:
        id: name of its file without the suffix.
        name, note: as given.
        started: when, ISO 8601, UTC.
        duration_s: of the robot's time.
        size_bytes: of the file.
        scene: of the simulation, "robot" on hardware.
        complete: it was ended in order; what was cut off lacks at most its last second.
        gaps: how often ticks are missing.
    """

    id: str
    name: str
    note: str
    started: str
    duration_s: float
    size_bytes: int
    scene: str
    complete: bool
    gaps: int


def default_folder() -> Path:
    """FORCELENS_DATA, or where XDG puts data, with "recordings" below it."""
    home = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(os.environ.get("FORCELENS_DATA") or Path(home) / "forcelens") / "recordings"


def new_id(name: str, now: datetime) -> str:
    """An id that sorts by time and tells the name."""
    words = re.sub(r"[^A-Za-z0-9]+", "-", name).strip("-").lower()[:30]
    return f"{now:%Y%m%d-%H%M%S}-{now.microsecond // 1000:03d}" + (f"-{words}" if words else "")


class RecordingFolder:
    """Any thread may call.

    Args:
        path: of the folder, which is made with the first recording.
        budget_bytes: what all recordings together may take.
    """

    def __init__(self, path: Path, budget_bytes: int = DEFAULT_BUDGET_BYTES) -> None:
        self.path = path
        self.budget_bytes = budget_bytes
        self._rows: dict[tuple[Path, int, int], RecordingRow] = {}

    def list(self) -> list[RecordingRow]:
        """All that are finished, newest first."""
        rows = (self._row(path) for path in sorted(self.path.glob(f"*{SUFFIX}"), reverse=True))
        return [row for row in rows if row is not None]

    def get(self, key: str) -> RecordingRow:
        """One that is finished.

        Raises:
            UnknownRecordingError: there is none.
        """
        row = self._row(self.file(key))
        if row is None:
            raise UnknownRecordingError(f"recording {key!r} cannot be read")
        return row

    def file(self, key: str) -> Path:
        """File of a recording that is finished.

        Raises:
            UnknownRecordingError: there is none.
        """
        path = self.path / f"{key}{SUFFIX}"
        if not _ID.fullmatch(key) or not path.is_file():
            raise UnknownRecordingError(f"there is no recording {key!r}; GET /api/v1/recordings lists them")
        return path

    def delete(self, key: str) -> None:
        """Remove one.

        Raises:
            UnknownRecordingError: there is none.
        """
        self.file(key).unlink()

    def new_file(self, key: str) -> Path:
        """Where a new recording goes."""
        self.path.mkdir(parents=True, exist_ok=True)
        return self.path / f"{key}{SUFFIX}"

    def room_bytes(self) -> int:
        """How large a new recording may become.

        Raises:
            RecordingError: there is no room.
        """
        self.path.mkdir(parents=True, exist_ok=True)
        used = sum(path.stat().st_size for path in self.path.glob(f"*{SUFFIX}*"))
        free = shutil.disk_usage(self.path).free
        room = min(self.budget_bytes - used, free - RESERVE_BYTES)
        if room < LEAST_BYTES:
            raise RecordingError(
                f"there is no room for a recording: {used / 1e9:.1f} of {self.budget_bytes / 1e9:g} GB are used, "
                f"{free / 1e9:.1f} GB of the disk are free; delete recordings, or allow more with --data-budget"
            )
        return room

    def repair(self) -> None:
        """Give every file that was cut off its end and its name; what holds nothing is removed."""
        for part in self.path.glob(f"*{SUFFIX}{PART}"):
            with part.open("rb") as file:
                try:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except BlockingIOError:
                    continue  # another console writes it
                self._mend(part)

    def _mend(self, part: Path) -> None:
        try:
            if not is_whole(part):
                repair(part)
        except (NoRecordingError, EOFError, OSError) as error:
            _log.warning("removing %s: %s", part, error)
            part.unlink()
            return
        part.replace(part.with_name(part.name.removesuffix(PART)))
        _log.warning("recording %s was cut off; it is repaired", part.name.removesuffix(SUFFIX + PART))

    def _row(self, path: Path) -> RecordingRow | None:
        try:
            status = path.stat()
            key = path, status.st_mtime_ns, status.st_size
            if key not in self._rows:
                self._rows[key] = _read_row(path, status.st_size)
            return self._rows[key]
        except Exception as error:  # whatever lies there under that name
            _log.warning("%s is no recording: %s", path, error)
            return None


def _read_row(path: Path, size_bytes: int) -> RecordingRow:
    with path.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert summary is not None
        statistics = summary.statistics
        assert statistics is not None
        described = {record.name: record.metadata for record in reader.iter_metadata()}
    run = described["forcelens"]
    topics = {channel.topic: number for number, channel in summary.channels.items()}
    duration_ns = statistics.message_end_time - statistics.message_start_time
    return RecordingRow(
        id=path.stem,
        name=run["name"],
        note=run["note"],
        started=run["started"],
        duration_s=duration_ns / 1e9,
        size_bytes=size_bytes,
        scene=run["scene"],
        complete=REPAIRED not in described,
        gaps=statistics.channel_message_counts.get(topics["/gaps"], 0),
    )


def started_text(now: datetime) -> str:
    """As `RecordingRow.started`."""
    return now.astimezone(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
