"""The ring between a writer that never waits and a reader that may come late, and the gap that this leaves in a file."""

import json
from contextlib import closing
from pathlib import Path

import numpy as np
from mcap.reader import make_reader

from sim.recording import tap as tap_module
from sim.recording.body_tree import BodyTree
from sim.recording.description import Description
from sim.recording.reader import Recording
from sim.recording.recorder import CHUNK_TICKS, Drain, RecordingWriter
from sim.recording.ring import Ring, bytes_of
from sim.recording.tap import TICK_SLOTS, Heads, Tap
from sim.runtime.snapshot import SNAPSHOT
from sim.runtime.tick_layout import TICK

DTYPE = np.dtype([("value", "f8"), ("odd", "u1")])
RUN = {"name": "gap", "note": "", "started": "", "scene": "free", "estimators": "hybrid"}


def test_what_is_put_is_taken_once_and_in_order() -> None:
    ring = Ring(bytearray(Ring.size_of(DTYPE, 64)), DTYPE, 64)
    record, taken, tail = np.zeros(1, DTYPE), [], 0
    for value in range(300):
        record["value"] = value
        ring.put(bytes_of(record))
        if value % 37 == 0:
            batch = ring.take(tail, 1000)
            assert batch.missed == 0
            taken += batch.records["value"].tolist()
            tail = batch.first + len(batch.records)
    assert taken == list(range(len(taken)))
    assert len(taken) == tail > 250


def test_a_late_reader_learns_what_it_missed() -> None:
    ring = Ring(bytearray(Ring.size_of(DTYPE, 64)), DTYPE, 64)
    record = np.zeros(1, DTYPE)
    for value in range(1000):
        record["value"] = value
        ring.put(bytes_of(record))
    batch = ring.take(10, 1000)
    assert batch.missed == batch.first - 10
    assert batch.records["value"].tolist() == list(range(batch.first, 1000))
    assert ring.take(1000, 10).missed == 0


def test_a_held_up_recorder_leaves_a_counted_gap(tmp_path: Path) -> None:
    tap = Tap(tap_module.allocate())
    tap.start("gap")
    writer = RecordingWriter(tmp_path / "gap.mcap", Description(RUN, ("hybrid",), b""), BodyTree.from_mjcf(), 10**18)
    drain = Drain(tap, writer, Heads())
    record = np.zeros(1, TICK)
    for tick in range(TICK_SLOTS + 700):
        record["sensor_time_s"] = tick
        tap.ticks.put(bytes_of(record))
        if tick == 299:
            assert drain.turn(least=CHUNK_TICKS)
    while drain.turn(least=1):
        pass
    writer.close()
    with (tmp_path / "gap.mcap").open("rb") as file:
        reader = make_reader(file)
        (gap,) = [json.loads(message.data) for _, _, message in reader.iter_messages(topics=["/gaps"])]
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        topics = {channel.topic: number for number, channel in summary.channels.items()}
        written = summary.statistics.channel_message_counts[topics["/sensors"]]
    assert gap["first_tick"] == CHUNK_TICKS
    assert gap["ticks"] == tap.missed > 300
    assert written + gap["ticks"] == TICK_SLOTS + 700


def test_a_last_chunk_shorter_than_a_control_period_is_written(tmp_path: Path) -> None:
    """Its moments come too soon after the last state to be one themselves."""
    tap = Tap(tap_module.allocate())
    tap.start("short")
    writer = RecordingWriter(tmp_path / "short.mcap", Description(RUN, ("hybrid",), b""), BodyTree.from_mjcf(), 10**18)
    drain = Drain(tap, writer, Heads())
    record, snapshot = np.zeros(1, TICK), np.zeros(1, SNAPSHOT)[0]
    for tick in range(CHUNK_TICKS + 3):
        tap.ticks.put(bytes_of(record))
        if tick in (CHUNK_TICKS - 1, CHUNK_TICKS + 2):
            tap.put_moment(snapshot)
            assert drain.turn(least=1)
    assert not drain.turn(least=1)
    writer.close()
    with closing(Recording(tmp_path / "short.mcap")) as recording:
        assert len(recording.sensors()) == CHUNK_TICKS + 3
