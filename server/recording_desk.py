"""Starts and stops recordings: the control process is told to write, and a recorder is spawned that listens."""

import logging
import multiprocessing
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from multiprocessing.process import BaseProcess
from pathlib import Path

from control.timing import TICK_S
from server.control_client import SLOW_CALL_TIMEOUT_S, ControlClient
from server.errors import ControlTimeoutError, MissingError, RefusedError
from server.leadership import Leadership, needs_lease
from server.schemas import RecordingRequest
from server.validation import validated
from sim.processes.starting import deaf_children
from sim.recording.body_tree import BodyTree
from sim.recording.describe import provenance, standing_attachments
from sim.recording.folder import (
    RecordingError,
    RecordingFolder,
    RecordingRow,
    UnknownRecordingError,
    new_id,
    started_text,
)
from sim.recording.recorder import recorder_process
from sim.recording.tap import Tap

FINISH_PATIENCE_S = 10.0

_log = logging.getLogger(__name__)


class RecordingDesk:
    """One recording at a time. Any thread may call.

    Attributes:
        folder: where they lie.

    Args:
        client: handle on the control process.
        leadership: who may start, stop and remove.
        folder: see above; what a crash left in it is repaired.
    """

    def __init__(self, client: ControlClient, leadership: Leadership, folder: RecordingFolder) -> None:
        self.leadership = leadership
        self.folder = folder
        self._client = client
        self._tap = Tap(client.tap_memory)
        self._lock = threading.Lock()
        self._context = multiprocessing.get_context("spawn")
        self._recorder: BaseProcess | None = None
        self._row: RecordingRow | None = None
        folder.repair()

    def ids(self) -> list[str]:
        """Of those that are finished, newest first."""
        return [row.id for row in self.folder.list()]

    def list(self) -> list[RecordingRow]:
        """The one under way, and all that are finished, newest first."""
        self._notice_end()
        current = self.current
        return [*([] if current is None else [current]), *self.folder.list()]

    def get(self, key: str) -> RecordingRow:
        """One of `list`.

        Raises:
            MissingError: there is none.
        """
        found = next((row for row in self.list() if row.id == key), None)
        if found is None:
            raise MissingError(f"there is no recording {key!r}; GET /api/v1/recordings lists them")
        return found

    @property
    def current(self) -> RecordingRow | None:
        """The one under way."""
        row = self._row
        if row is None:
            return None
        tap = self._tap
        return replace(row, duration_s=TICK_S * tap.count, size_bytes=tap.size_bytes, gaps=int(tap.missed > 0))

    @property
    def recorder_pid(self) -> int | None:
        """Process id of the recorder while it runs."""
        recorder = self._recorder
        return None if recorder is None or not recorder.is_alive() else recorder.pid

    @property
    def lost_ticks(self) -> int:
        """That the recorder came too late for, of the recording under way or of the last one."""
        return self._tap.missed

    @needs_lease
    def start(self, name: str, note: str = "") -> RecordingRow:
        """Begin a recording with the next tick.

        Raises:
            InvalidFieldError: name or note is too long.
            RefusedError: one is under way, or there is no room.
        """
        validated(RecordingRequest, {"name": name, "note": note})
        with self._lock:
            self._notice_end_locked()
            if self._row is not None:
                raise RefusedError("a recording is under way; DELETE /api/v1/recordings/current first")
            with _refusals():
                room = self.folder.room_bytes()
            now = datetime.now(UTC)
            key = new_id(name, now)
            path = self.folder.new_file(key)
            described, heads = self._client.call("start_recording", SLOW_CALL_TIMEOUT_S, name=key)
            started = started_text(now)
            metadata = {**provenance(), **described.metadata, "name": name, "note": note, "started": started}
            description = replace(described, metadata=metadata, attachments=standing_attachments())
            arguments = (self._client.tap_memory, path, description, BodyTree.from_mjcf(), time.time_ns(), heads, room)
            self._recorder = self._context.Process(target=recorder_process, args=arguments, name="forcelens-recorder")
            with deaf_children():
                self._recorder.start()
            self._row = RecordingRow(key, name, note, started, 0.0, 0, described.metadata["scene"], False, 0)
            return self._row

    @needs_lease
    def stop(self) -> RecordingRow:
        """End the recording under way; it is finished then.

        Raises:
            MissingError: there is none.
        """
        with self._lock:
            self._notice_end_locked()
            row = self._row
            if row is None:
                raise MissingError("no recording is under way; POST /api/v1/recordings starts one")
            self._finish()
            with _refusals():
                return self.folder.get(row.id)

    def file(self, key: str) -> Path:
        """File of a finished one.

        Raises:
            MissingError: there is none.
        """
        with _refusals():
            return self.folder.file(key)

    @needs_lease
    def delete(self, key: str) -> None:
        """Remove a finished one.

        Raises:
            MissingError: there is none.
            RefusedError: it is under way.
        """
        if self._row is not None and self._row.id == key:
            raise RefusedError(f"recording {key!r} is under way; DELETE /api/v1/recordings/current first")
        with _refusals():
            self.folder.delete(key)

    def end(self) -> None:
        """End what is under way, if anything is, because the control process ends; never fails."""
        with self._lock:
            if self._row is not None:
                try:
                    self._finish()
                except ControlTimeoutError as error:
                    _log.warning("%s", error)

    def _notice_end(self) -> None:
        with self._lock:
            self._notice_end_locked()

    def _notice_end_locked(self) -> None:
        """The recorder may have ended by itself or been killed, or have nobody to listen to any more."""
        if self._row is None or self._recorder is None:
            return
        if not self._recorder.is_alive() or not self._client.alive or self._tap.stopped:
            self._finish()

    def _finish(self) -> None:
        self._tap.stop()
        recorder, self._recorder, self._row = self._recorder, None, None
        if recorder is None:
            return
        recorder.join(FINISH_PATIENCE_S)
        if recorder.is_alive():
            recorder.kill()
            recorder.join(FINISH_PATIENCE_S)
            self.folder.repair()
            raise ControlTimeoutError("the recorder did not end in time; what it had written is kept")
        self.folder.repair()


@contextmanager
def _refusals() -> Iterator[None]:
    try:
        yield
    except UnknownRecordingError as error:
        raise MissingError(str(error)) from None
    except RecordingError as error:
        raise RefusedError(str(error)) from None
