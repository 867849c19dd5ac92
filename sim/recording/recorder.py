"""The recorder: a process of its own that turns what the tap gives into a file, and needs nobody to end well.

It finishes when it is told to, when its parent has died, and when the file reaches its limit. The file grows by whole chunks of
half a second under the name NAME.mcap.part, and gets its name when it has its end.
"""

import json
import logging
import multiprocessing
import os
import signal
import time
from functools import cache
from pathlib import Path
from typing import Any, cast

import numpy as np
import zstandard
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from control.paths import ROBOT_MJCF
from sim.recording import messages
from sim.recording.body_tree import BodyTree
from sim.recording.description import STATE_TYPE, Description, keyframe_name
from sim.recording.drawing import TransformEncoder, arrows, descriptors_of, robot_meshes
from sim.recording.mcap_file import McapWriter
from sim.recording.messages import INPUTS, SENSORS, STATE, TARGETS, TICK_NS, TRUTH
from sim.recording.tap import KEYFRAME, PER_PERIOD, Heads, Tap
from sim.recording.wire import MESSAGE_OPCODE

POLL_S = 0.1
CHUNK_TICKS = 250
PART = ".part"
JSON_OBJECT = b'{"type": "object"}'

_log = logging.getLogger(__name__)


_NO_KEYFRAMES = np.zeros(0, KEYFRAME)


class RecordingWriter:
    """Writes one recording from batches of what the tap gives.

    Args:
        path: of the file.
        description: of the recording.
        tree: the robot's bodies.
        start_ns: s since 1970, times 1e9, of the first tick; later ones follow by TICK_S, however fast the robot's time ran.
    """

    def __init__(self, path: Path, description: Description, tree: BodyTree, start_ns: int) -> None:
        self._transforms = TransformEncoder(tree)
        self._start_ns = start_ns
        self._names = description.estimators
        self._file = file = McapWriter(path, "forcelens")
        file.describe("forcelens", description.metadata)
        for name, media_type, data in description.attachments:
            file.attach(name, media_type, data, start_ns)
        self._attach_keyframe(0, description.keyframe)
        self._estimates = messages.estimates_wire(self._names)
        wires = {
            "/sensors": SENSORS,
            "/inputs": INPUTS,
            "/targets": TARGETS,
            "/estimates": self._estimates,
            "/state": STATE,
            "/truth": TRUTH,
        }
        self._channels = {topic: file.channel(topic, wire.name, "protobuf", wire.descriptors) for topic, wire in wires.items()}
        for topic, kind in (("/tf", FrameTransforms), ("/scene", SceneUpdate)):
            self._channels[topic] = file.channel(topic, kind.DESCRIPTOR.full_name, "protobuf", descriptors_of(kind))
        for topic in ("/events", "/gaps"):
            self._channels[topic] = file.channel(topic, f"forcelens{topic.replace('/', '.')}", "jsonschema", JSON_OBJECT)
        visuals = Path(ROBOT_MJCF).parent / "visual"
        file.write_chunk([self._message("/scene", start_ns, robot_meshes(tree, visuals, start_ns))])
        self._last_state = -PER_PERIOD

    @property
    def size_bytes(self) -> int:
        """Of the file so far."""
        return self._file.size_bytes

    def time_ns(self, tick: int) -> int:
        """Time stamp of a tick of the recording's count."""
        return self._start_ns + tick * TICK_NS

    def write(
        self,
        first: int,
        ticks: np.ndarray,
        moments: np.ndarray,
        events: np.ndarray,
        missed: int = 0,
        keyframes: np.ndarray = _NO_KEYFRAMES,
    ) -> None:
        """Write one chunk.

        Args:
            first: number of the first of `ticks` in the recording's count.
            ticks: TICK records (n,).
            moments: MOMENT records (m,).
            events: EVENT records (k,).
            missed: ticks before `first` that are lost.
            keyframes: KEYFRAME records (l,), which come after the chunk.
        """
        times = self.time_ns(first) + TICK_NS * np.arange(len(ticks), dtype="u8")
        sensors, inputs, targets, estimates = (
            wire.batch(times, self._channels[topic])
            for topic, wire in (
                ("/sensors", SENSORS),
                ("/inputs", INPUTS),
                ("/targets", TARGETS),
                ("/estimates", self._estimates),
            )
        )
        messages.write_ticks(ticks, sensors["body"], inputs["body"], targets["body"])
        messages.write_estimates(ticks, self._names, estimates["body"])
        batches = [sensors, inputs, targets, estimates, *self._moments(moments)]
        batches += [self._message("/events", self.time_ns(int(each["tick"])), bytes(each["text"])) for each in events]
        if missed:
            gap = json.dumps({"first_tick": first - missed, "ticks": missed}).encode()
            batches.append(self._message("/gaps", self.time_ns(first), gap))
        self._file.write_chunk(batches)
        for tick, size, data in zip(keyframes["tick"].tolist(), keyframes["size"].tolist(), keyframes["data"], strict=True):
            self._attach_keyframe(tick, data[:size].tobytes())

    def close(self) -> None:
        """Give the file its end."""
        self._file.close()

    def abandon(self) -> None:
        """Leave the file as it is, without an end."""
        self._file.abandon()

    def _attach_keyframe(self, tick: int, state: bytes) -> None:
        self._file.attach(keyframe_name(tick), STATE_TYPE, zstandard.compress(state), self.time_ns(tick))

    def _moments(self, moments: np.ndarray) -> list[np.ndarray]:
        if not len(moments):
            return []
        times = self._start_ns + TICK_NS * moments["tick"]
        truth = TRUTH.batch(times, self._channels["/truth"])
        messages.write_truth(moments["snapshot"], truth["body"])
        known = np.isfinite(moments["snapshot"]["force_true_n"][:, 0])
        batches = [truth[known]]
        kept = []
        for index, tick in enumerate(moments["tick"].tolist()):
            if tick - self._last_state >= PER_PERIOD:
                kept.append(index)
                self._last_state = tick
        if not kept:
            return batches
        states = STATE.batch(times[kept], self._channels["/state"])
        messages.write_states(moments["snapshot"][kept], states["body"])
        batches.append(states)
        batches.append(self._messages("/tf", times[kept], self._transforms.batch(moments["snapshot"][kept], times[kept])))
        for index in kept:
            snapshot, time_ns = cast(np.void, moments["snapshot"][index]), int(times[index])
            batches.append(self._message("/scene", time_ns, arrows(snapshot, time_ns)))
        return batches

    def _message(self, topic: str, time_ns: int, data: bytes) -> np.ndarray:
        """One message record of any length, as an array (1,)."""
        return self._messages(topic, np.array([time_ns], "u8"), np.frombuffer(data, np.uint8)[None])

    def _messages(self, topic: str, times_ns: np.ndarray, bodies: np.ndarray) -> np.ndarray:
        """Message records (n,) at times (n,) of bodies (n, length), u1."""
        count, length = bodies.shape
        records = np.zeros(count, _message_dtype(length))
        records["opcode"], records["length"], records["channel"] = MESSAGE_OPCODE, 22 + length, self._channels[topic]
        records["log"] = records["publish"] = times_ns
        records["body"] = bodies
        return records


@cache
def _message_dtype(length: int) -> np.dtype:
    return np.dtype(
        [
            ("opcode", "u1"),
            ("length", "<u8"),
            ("channel", "<u2"),
            ("sequence", "<u4"),
            ("log", "<u8"),
            ("publish", "<u8"),
            ("body", "u1", (length,)),
        ]
    )


class Drain:
    """Moves what the tap has into a writer."""

    def __init__(self, tap: Tap, writer: RecordingWriter, heads: Heads) -> None:
        self._tap, self._writer = tap, writer
        self._tick = tap.first
        self._moment, self._event, self._keyframe = heads
        self._missed = 0

    def turn(self, *, least: int) -> bool:
        """Write a chunk if there are at least so many new ticks; whether there were."""
        tap = self._tap
        if tap.ticks.head - self._tick < max(least, 1):
            return False
        ticks, moments, events, keyframes = (
            tap.ticks.take(self._tick, CHUNK_TICKS),  # also of one that is late, so that what a cut costs is no more
            tap.moments.take(self._moment, CHUNK_TICKS),
            tap.events.take(self._event, CHUNK_TICKS),
            tap.keyframes.take(self._keyframe, CHUNK_TICKS),
        )
        self._tick = ticks.first + len(ticks.records)
        self._moment = moments.first + len(moments.records)
        self._event = events.first + len(events.records)
        self._keyframe = keyframes.first + len(keyframes.records)
        self._missed += ticks.missed
        taken = ticks.records, moments.records, events.records
        self._writer.write(ticks.first - tap.first, *taken, ticks.missed, keyframes.records)
        tap.report(self._writer.size_bytes, self._missed)
        return True


def recorder_process(
    memory: Any, path: Path, description: Description, tree: BodyTree, start_ns: int, heads: Heads, limit_bytes: int
) -> None:
    """Entry point of the spawned process.

    Args:
        memory: of the tap.
        path: of the finished file.
        description, tree, start_ns: see RecordingWriter.
        heads: of the tap's other rings when the recording started.
        limit_bytes: size at which the recording ends.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(10)
    tap = Tap(memory)
    part = path.with_name(path.name + PART)
    writer = RecordingWriter(part, description, tree, start_ns)
    drain = Drain(tap, writer, heads)
    parent = multiprocessing.parent_process()
    try:
        while not tap.stopped and (parent is None or parent.is_alive()):
            if not drain.turn(least=CHUNK_TICKS):
                time.sleep(POLL_S)
            if writer.size_bytes > limit_bytes:
                _log.warning("recording %s ends: the disk budget is used up", path.stem)
                tap.stop()
        while drain.turn(least=1):
            pass
    except OSError as error:
        _log.error("recording %s ends: %s", path.stem, error)
    finally:
        tap.stop()
        writer.close()
        part.replace(path)
