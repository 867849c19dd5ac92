"""Reads recordings: whole columns at once, or what was around one moment."""

import json
import re
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.reader import make_reader
from mcap.records import Attachment, ChunkIndex

from control.timing import TICK_S
from sim.recording import messages
from sim.recording.description import keyframe_name
from sim.recording.messages import INPUTS, SENSORS, STATE, TARGETS, TICK_NS, TRUTH, estimates_wire
from sim.recording.wire import Wire

_CACHED_CHUNKS = 4
_RECORD_HEAD_BYTES = 9
_KEYFRAME = re.compile(re.escape(keyframe_name("#")).replace(r"\#", r"(\d+)"))


class RecordingFormatError(ValueError):
    """A file that is no recording of this version; the message says what does not fit."""


@dataclass(frozen=True, slots=True)
class Event:
    """What was done before a tick of the recording's count."""

    tick: int
    name: str
    arguments: dict[str, Any]


class Recording:
    """One finished recording, or a part of it.

    Args:
        path: of the file.
        from_s: ticks and events begin with the last keyframe up to this time since the start.
        to_s: ticks end with this time.

    Attributes:
        path: see above.
        metadata: texts by name, see sim.recording.describe.
        estimators: names, in the order of columns of estimates.
        start_ns: time stamp of the first tick.
        duration_s: of the robot's time, of the whole recording.
        keyframes: ticks, in the recording's count, that there is a keyframe before.
        first_tick: the first of the part.

    Raises:
        RecordingFormatError: it is none, or of another version.
    """

    def __init__(self, path: Path, from_s: float = 0.0, to_s: float = np.inf) -> None:
        self.path = path
        self._file = path.open("rb")
        try:
            reader = make_reader(self._file)
            summary = reader.get_summary()
            assert summary is not None
            assert summary.statistics is not None
            self.metadata = next(each.metadata for each in reader.iter_metadata() if each.name == "forcelens")
            self._attachments = {each.name: each for each in summary.attachment_indexes}
        except Exception as error:
            self._file.close()
            raise RecordingFormatError(f"{path} is no recording of Forcelens: {error}") from error
        self._schemas = summary.schemas
        self._channels = {channel.topic: channel for channel in summary.channels.values()}
        self._chunks = sorted(summary.chunk_indexes, key=lambda chunk: chunk.chunk_start_offset)
        self._starts = np.array([chunk.message_start_time for chunk in self._chunks])
        self.estimators = tuple(self.metadata["estimators"].split(","))
        self.start_ns = summary.statistics.message_start_time
        self.duration_s = (summary.statistics.message_end_time - self.start_ns) / 1e9
        found = [_KEYFRAME.fullmatch(name) for name in self._attachments]
        self.keyframes = tuple(sorted(int(match[1]) for match in found if match))
        self.first_tick = max((tick for tick in self.keyframes if tick * TICK_S <= max(from_s, 0.0) + 0.5 * TICK_S), default=0)
        self._part_ns = self.start_ns + self.first_tick * TICK_NS, self.start_ns + round(1e9 * min(to_s, self.duration_s + 1.0))
        self._data = lru_cache(_CACHED_CHUNKS)(self._decompressed)
        self._states_of = lru_cache(_CACHED_CHUNKS)(self._chunk_states)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def attachment(self, name: str) -> bytes:
        """
        Raises:
            RecordingFormatError: there is none of that name.
        """
        if name not in self._attachments:
            raise RecordingFormatError(f"the recording has no attachment {name!r}")
        self._file.seek(self._attachments[name].offset + _RECORD_HEAD_BYTES)
        return Attachment.read(ReadDataStream(self._file)).data

    def keyframe(self) -> bytes:
        """Packed state of the pipeline before the first tick of the part.

        Raises:
            RecordingFormatError: there is none.
        """
        return zstandard.decompress(self.attachment(keyframe_name(self.first_tick)))

    def sensors(self) -> np.ndarray:
        """Messages (n,) of SENSORS.record, one per tick."""
        return self.column("/sensors", SENSORS)

    def inputs(self) -> np.ndarray:
        """Messages (n,) of INPUTS.record, one per tick."""
        return self.column("/inputs", INPUTS)

    def targets(self) -> np.ndarray:
        """Messages (n,) of TARGETS.record, one per tick."""
        return self.column("/targets", TARGETS)

    def estimates_n(self) -> np.ndarray:
        """(n, estimators, 3) N, one per tick; NaN where there was none."""
        bodies = self.column("/estimates", estimates_wire(self.estimators))["body"]
        return messages.read_estimates(bodies, self.estimators)[:, : len(self.estimators)]

    def truth(self) -> np.ndarray:
        """Messages (m,) of TRUTH.record; none without a simulator."""
        return self.column("/truth", TRUTH)

    def ticks(self, column: np.ndarray) -> np.ndarray:
        """(n,) numbers of the ticks of messages (n,), in the recording's count."""
        return np.round((column["log"] - np.uint64(self.start_ns)).astype(float) / (1e9 * TICK_S)).astype(int)

    def events(self) -> list[Event]:
        """All that were done in the part, in order."""
        self._file.seek(0)
        reader = make_reader(self._file)
        found = []
        for _, _, message in reader.iter_messages(topics=["/events"]):
            content = json.loads(message.data)
            tick = round((message.log_time - self.start_ns) / (1e9 * TICK_S))
            if self._part_ns[0] <= message.log_time < self._part_ns[1]:
                found.append(Event(tick, content["name"], content["arguments"]))
        return found

    def column(self, topic: str, wire: Wire) -> np.ndarray:
        """All messages (n,) of a topic in the part, `wire.record`."""
        self._require(topic, wire)
        start_ns, stop_ns = self._part_ns
        parts = [np.zeros(0, wire.record)]
        for index, chunk in enumerate(self._chunks):
            if start_ns <= chunk.message_end_time and chunk.message_start_time < stop_ns:
                rows = self._messages(index, topic, wire)
                parts.append(rows[(rows["log"] >= start_ns) & (rows["log"] < stop_ns)])
        return np.concatenate(parts)

    def snapshot(self, time_s: float) -> np.void | None:
        """The last SNAPSHOT record up to a time since the start; None before the first."""
        time_ns = self.start_ns + round(1e9 * time_s)
        index = int(np.searchsorted(self._starts, time_ns, side="right")) - 1
        while index >= 0:
            times, snapshots = self._states_of(index)
            row = int(np.searchsorted(times, time_ns, side="right")) - 1
            if row >= 0:
                return snapshots[row]
            index -= 1
        return None

    def _chunk_states(self, index: int) -> tuple[np.ndarray, np.ndarray]:
        self._require("/state", STATE)
        records = self._messages(index, "/state", STATE)
        return records["log"].copy(), messages.read_states(records["body"])

    def _require(self, topic: str, wire: Wire) -> None:
        channel = self._channels.get(topic)
        if channel is None:
            raise RecordingFormatError(f"the recording has no {topic}")
        if self._schemas[channel.schema_id].data != wire.descriptors:
            made = self.metadata.get("version.forcelens", "unknown")
            raise RecordingFormatError(f"{topic} of the recording has other fields; version {made} made it, and reads it")

    def _messages(self, index: int, topic: str, wire: Wire) -> np.ndarray:
        chunk = self._chunks[index]
        offset = chunk.message_index_offsets.get(self._channels[topic].id)
        if offset is None:
            return np.zeros(0, wire.record)
        self._file.seek(offset + 11)
        size = int.from_bytes(self._file.read(4), "little")
        offsets = np.frombuffer(self._file.read(size), "<u8").reshape(-1, 2)[:, 1].astype(int)
        data = np.frombuffer(self._data(index), np.uint8)
        rows = data[offsets[:, None] + np.arange(wire.record.itemsize)]
        return rows.view(wire.record)[:, 0]

    def _decompressed(self, index: int) -> bytes:
        chunk: ChunkIndex = self._chunks[index]
        self._file.seek(chunk.chunk_start_offset + chunk.chunk_length - chunk.compressed_size)
        return zstandard.ZstdDecompressor().decompress(
            self._file.read(chunk.compressed_size), max_output_size=chunk.uncompressed_size
        )
