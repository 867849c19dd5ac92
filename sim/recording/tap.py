"""What the control process tells a recorder: every tick, snapshots, and events, through shared memory that nobody waits on."""

import json
import logging
import sys
from typing import Any, NamedTuple

import numpy as np

from control.timing import SLOT_COUNT
from sim.processes.anonymous_memory import AnonymousMemory
from sim.recording.ring import Ring, bytes_of
from sim.runtime.snapshot import SNAPSHOT
from sim.runtime.tick_layout import TICK

_log = logging.getLogger(__name__)

MOMENT = np.dtype([("tick", "u8"), ("snapshot", SNAPSHOT)])
"""A snapshot after as many ticks of the recording's count."""

KEYFRAME = np.dtype([("tick", "u8"), ("size", "u8"), ("data", "u1", 163840)])
"""The packed state (control.state.file) of the pipeline before a tick of the recording's count, padded."""

EVENT = np.dtype([("tick", "u8"), ("text", "S1000")])
"""JSON {name, arguments} of what was done before a tick of the recording's count."""

TICK_SLOTS = 8192
"""16 s at the robot's own speed."""

MOMENT_SLOTS = 1024
EVENT_SLOTS = 1024
KEYFRAME_SLOTS = 16

_SNAPSHOT_AT = 8  # in MOMENT
_ACTIVE, _STOP, _FIRST, _SIZE, _MISSED = range(5)  # words of the header
_NAME = slice(64, 128)  # of the header
_HEADER_BYTES = 256
_SLOTS = ((TICK, TICK_SLOTS), (MOMENT, MOMENT_SLOTS), (EVENT, EVENT_SLOTS), (KEYFRAME, KEYFRAME_SLOTS))
_SIZES = tuple(Ring.size_of(dtype, slots) for dtype, slots in _SLOTS)


class Heads(NamedTuple):
    """Where the rings of moments, events and keyframes stood when a recording started."""

    moments: int = 0
    events: int = 0
    keyframes: int = 0


def allocate() -> AnonymousMemory:
    """Zeroed memory for a tap, to be given to `Tap` here and, as a process argument, in spawned children."""
    return AnonymousMemory(_HEADER_BYTES + sum(_aligned(size) for size in _SIZES))


class Tap:
    """View of the shared memory in one process. The control process writes the rings, the web process starts and stops.

    Attributes:
        ticks, moments, events, keyframes: rings of TICK, MOMENT, EVENT and KEYFRAME.
    """

    def __init__(self, memory: Any) -> None:
        view = memoryview(memory).cast("B")
        self._header = view[:_HEADER_BYTES]
        self._words = self._header.cast("Q")
        rings = []
        start = _HEADER_BYTES
        for (dtype, slots), size in zip(_SLOTS, _SIZES, strict=True):
            rings.append(Ring(view[start : start + size], dtype, slots))
            start += _aligned(size)
        self.ticks, self.moments, self.events, self.keyframes = rings
        self._event, self._keyframe = np.zeros(1, EVENT), np.zeros(1, KEYFRAME)
        self._event_bytes, self._keyframe_bytes = map(bytes_of, (self._event, self._keyframe))

    @property
    def active(self) -> bool:
        """Whether the control process writes."""
        return self._words[_ACTIVE] != 0

    def start(self, name: str) -> None:
        """The next tick is the first of the recording `name`. Called in the control process."""
        words = self._words
        words[_FIRST], words[_SIZE], words[_MISSED], words[_STOP] = self.ticks.head, 0, 0, 0
        self._header[_NAME] = name.encode().ljust(64, b"\0")
        words[_ACTIVE] = 1

    def stop(self) -> None:
        """No more ticks; the recorder finishes."""
        self._words[_ACTIVE] = 0
        self._words[_STOP] = 1

    @property
    def stopped(self) -> bool:
        """Whether `stop` was called since `start`."""
        return self._words[_STOP] != 0

    @property
    def name(self) -> str:
        """Of the recording under way, or of the last one."""
        return bytes(self._header[_NAME]).rstrip(b"\0").decode()

    @property
    def first(self) -> int:
        """Index in `ticks` of the recording's first tick."""
        return self._words[_FIRST]

    @property
    def heads(self) -> Heads:
        """Where the other rings stand."""
        return Heads(self.moments.head, self.events.head, self.keyframes.head)

    @property
    def count(self) -> int:
        """Ticks since the recording started."""
        return self.ticks.head - self.first

    @property
    def size_bytes(self) -> int:
        """Of the file so far, as the recorder says."""
        return self._words[_SIZE]

    @property
    def missed(self) -> int:
        """Ticks that the recorder came too late for."""
        return self._words[_MISSED]

    def report(self, size_bytes: int, missed: int) -> None:
        """Called in the recorder."""
        self._words[_SIZE], self._words[_MISSED] = size_bytes, missed

    def put_tick(self, row: memoryview) -> None:
        """Append a tick, given as the bytes of a TICK record (sim.runtime.tick_row)."""
        self.ticks.put(row)

    def put_moment(self, snapshot: np.void) -> None:
        """Append a SNAPSHOT record of the last tick."""
        self.moments.put(self.count.to_bytes(_SNAPSHOT_AT, sys.byteorder) + snapshot.tobytes())  # not field by field

    def put_event(self, name: str, arguments: dict[str, Any]) -> None:
        """Append something done before the next tick."""
        self._event["tick"] = self.count
        text = json.dumps({"name": name, "arguments": arguments}, default=_plain).encode()
        if len(text) > EVENT["text"].itemsize:  # masses of many links, which no pipeline is told
            text = json.dumps({"name": name, "arguments": {}}).encode()
        self._event["text"] = text
        self.events.put(self._event_bytes)

    def put_keyframe(self, tick: int, data: bytes) -> None:
        """Append the packed state of the pipeline before a tick of the recording's count."""
        if len(data) > KEYFRAME["data"].itemsize:
            _log.warning("the pipeline's state of %d kB is too large to be recorded", len(data) // 1000)
            return
        keyframe = self._keyframe[0]
        keyframe["tick"], keyframe["size"] = tick, len(data)
        keyframe["data"][: len(data)] = np.frombuffer(data, np.uint8)
        self.keyframes.put(self._keyframe_bytes)


PER_PERIOD = SLOT_COUNT
"""Ticks between two states, transforms and arrows of a file."""


def _aligned(size: int) -> int:
    return size + -size % 64


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)
