"""What the control process tells a recorder: every tick, snapshots, and events, through shared memory that nobody waits on."""

import json
import logging
from typing import Any, NamedTuple

import numpy as np

from control.joints import JOINT_COUNT
from control.timing import MOST_ESTIMATORS, SLOT_COUNT
from sim.processes.anonymous_memory import AnonymousMemory
from sim.recording.ring import Ring
from sim.runtime.snapshot import COMMAND, SNAPSHOT

_log = logging.getLogger(__name__)

TICK = np.dtype(
    [
        ("time_s", "f8"),  # of the session, after the tick
        ("sensor_time_s", "f8"),
        ("orientation_wxyz", "f8", 4),
        ("angular_velocity", "f8", 3),
        ("linear_acceleration", "f8", 3),
        ("joint_position", "f8", JOINT_COUNT),
        ("joint_velocity", "f8", JOINT_COUNT),
        ("joint_torque", "f8", JOINT_COUNT),
        ("command", COMMAND),  # as it went into the pipeline
        ("command_age_s", "f8"),
        ("applied_mask", "f8", 3),  # of the command as applied, which the next tick's estimators read
        ("estimates_n", "f8", (MOST_ESTIMATORS, 3)),  # in the order of the pipeline's estimators, NaN where there is none
        ("sigma_n", "f8", 3),
        ("target_position", "f8", JOINT_COUNT),  # to the drives
        ("target_velocity", "f8", JOINT_COUNT),
    ]
)
"""One tick. Units SI; forces in heading, of the environment on the robot."""

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

_HEADER = np.dtype([("active", "u8"), ("stop", "u8"), ("first", "u8"), ("size_bytes", "u8"), ("missed", "u8"), ("id", "S64")])
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
        view = memoryview(memory)
        self._header = np.frombuffer(view[: _HEADER.itemsize], _HEADER)[0:1]
        rings = []
        start = _HEADER_BYTES
        for (dtype, slots), size in zip(_SLOTS, _SIZES, strict=True):
            rings.append(Ring(view[start : start + size], dtype, slots))
            start += _aligned(size)
        self.ticks, self.moments, self.events, self.keyframes = rings
        self._active = self._header["active"]
        self._record = np.zeros(1, TICK)[0]
        self._moment = np.zeros(1, MOMENT)[0]
        self._event = np.zeros(1, EVENT)[0]
        self._keyframe = np.zeros(1, KEYFRAME)[0]

    @property
    def active(self) -> bool:
        """Whether the control process writes."""
        return self._active[0] != 0

    def start(self, name: str) -> None:
        """The next tick is the first of the recording `name`. Called in the control process."""
        header = self._header
        header["first"], header["size_bytes"], header["missed"], header["stop"] = self.ticks.head, 0, 0, 0
        header["id"] = name.encode()
        header["active"] = 1

    def stop(self) -> None:
        """No more ticks; the recorder finishes."""
        self._header["active"] = 0
        self._header["stop"] = 1

    @property
    def stopped(self) -> bool:
        """Whether `stop` was called since `start`."""
        return bool(self._header["stop"][0])

    @property
    def name(self) -> str:
        """Of the recording under way, or of the last one."""
        return bytes(self._header["id"][0]).decode()

    @property
    def first(self) -> int:
        """Index in `ticks` of the recording's first tick."""
        return int(self._header["first"][0])

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
        return int(self._header["size_bytes"][0])

    @property
    def missed(self) -> int:
        """Ticks that the recorder came too late for."""
        return int(self._header["missed"][0])

    def report(self, size_bytes: int, missed: int) -> None:
        """Called in the recorder."""
        self._header["size_bytes"], self._header["missed"] = size_bytes, missed

    def put_tick(self, session: Any) -> None:
        """Append the last tick of a session (sim.runtime.session.Session)."""
        record, output, sensor = self._record, session.output, session.sensor
        record["time_s"] = session.time_s
        record["sensor_time_s"] = sensor.time_s
        record["orientation_wxyz"] = sensor.orientation_wxyz
        record["angular_velocity"] = sensor.angular_velocity
        record["linear_acceleration"] = sensor.linear_acceleration
        record["joint_position"] = sensor.joint_position
        record["joint_velocity"] = sensor.joint_velocity
        record["joint_torque"] = sensor.joint_torque
        session.write_command(record["command"])
        record["command_age_s"] = session.command_age_s
        record["applied_mask"] = output.applied_command.mask
        estimates, out = output.estimates, record["estimates_n"]
        for index, name in enumerate(session.pipeline.estimator_names):
            estimate = estimates.get(name)
            out[index] = np.nan if estimate is None else estimate.force_estimated_n
        chosen = estimates.get(session.pipeline.estimator_name)
        record["sigma_n"] = np.nan if chosen is None or chosen.sigma_n is None else chosen.sigma_n
        record["target_position"] = output.joint_command.position
        record["target_velocity"] = output.joint_command.velocity
        self.ticks.put(record)

    def put_moment(self, snapshot: np.void) -> None:
        """Append a SNAPSHOT record of the last tick."""
        self._moment["tick"] = self.count
        self._moment["snapshot"] = snapshot
        self.moments.put(self._moment)

    def put_event(self, name: str, arguments: dict[str, Any]) -> None:
        """Append something done before the next tick."""
        self._event["tick"] = self.count
        text = json.dumps({"name": name, "arguments": arguments}, default=_plain).encode()
        if len(text) > EVENT["text"].itemsize:  # masses of many links, which no pipeline is told
            text = json.dumps({"name": name, "arguments": {}}).encode()
        self._event["text"] = text
        self.events.put(self._event)

    def put_keyframe(self, tick: int, data: bytes) -> None:
        """Append the packed state of the pipeline before a tick of the recording's count."""
        if len(data) > KEYFRAME["data"].itemsize:
            _log.warning("the pipeline's state of %d kB is too large to be recorded", len(data) // 1000)
            return
        keyframe = self._keyframe
        keyframe["tick"], keyframe["size"] = tick, len(data)
        keyframe["data"][: len(data)] = np.frombuffer(data, np.uint8)
        self.keyframes.put(keyframe)


PER_PERIOD = SLOT_COUNT
"""Ticks between two states, transforms and arrows of a file."""


def _aligned(size: int) -> int:
    return size + -size % 64


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)
