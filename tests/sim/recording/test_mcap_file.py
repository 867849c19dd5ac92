"""Files of our own writer, read by the reference reader; and files that were cut off anywhere."""

import random
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from sim.recording.mcap_file import McapWriter
from sim.recording.messages import STATE, read_states, write_states
from sim.recording.repair import NoRecordingError, is_whole, repair
from sim.recording.wire import VECTOR, Wire
from sim.runtime.snapshot import SNAPSHOT

WIRE = Wire("Probe", {"time_s": 1, "force": VECTOR, "joints": 22, "name": "S8"})
OTHER = Wire("Other", {"value": 1})
CHUNKS, PER_CHUNK = 12, 25
START_NS = 1_790_000_000_000_000_000


def write(path: Path, *, closed: bool = True) -> np.ndarray:
    """Forces (n, 3) that were written, along with other messages."""
    rng = np.random.default_rng(3)
    writer = McapWriter(path, "test")
    writer.attach("robot.xml", "application/xml", b"<robot/>" * 100, START_NS)
    writer.describe("run", {"seed": "3"})
    channels = [writer.channel(f"/{wire.name}", wire.name, "protobuf", wire.descriptors) for wire in (WIRE, OTHER)]
    forces = rng.normal(size=(CHUNKS, PER_CHUNK, 3))
    for chunk in range(CHUNKS):
        times = START_NS + 2_000_000 * (chunk * PER_CHUNK + np.arange(PER_CHUNK, dtype="u8"))
        probes, others = WIRE.batch(times, channels[0]), OTHER.batch(times[::5], channels[1])
        for axis in range(3):
            probes["body"][f"force.{'xyz'[axis]}"] = forces[chunk, :, axis]
        probes["body"]["joints"], probes["body"]["name"] = rng.normal(size=(PER_CHUNK, 22)), b"probe"
        writer.write_chunk([probes, others])
    if closed:
        writer.close()
    else:
        writer.abandon()
    return forces.reshape(-1, 3)


def forces_of(path: Path) -> np.ndarray:
    """By the reference reader, with every checksum."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        read = [each.decoded_message for each in reader.iter_decoded_messages(topics=[f"/{WIRE.name}"])]
        count = sum(1 for _ in reader.iter_messages())
        assert count == summary.statistics.message_count
        assert [each.data for each in reader.iter_attachments()] == [b"<robot/>" * 100]
    return np.array([(each.force.x, each.force.y, each.force.z) for each in read]).reshape(-1, 3)


def test_the_reference_reader_reads_every_bit(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    forces = write(path)
    assert is_whole(path)
    assert forces_of(path).tobytes() == forces.tobytes()


def test_a_file_that_was_cut_off_anywhere_is_repaired(tmp_path: Path) -> None:
    whole = tmp_path / "whole.mcap"
    forces = write(whole, closed=False)
    data = whole.read_bytes()
    begin = len(data) // (CHUNKS + 1)
    path = tmp_path / "cut.mcap"
    for cut in random.Random(1).sample(range(begin, len(data)), 60):
        path.write_bytes(data[:cut])
        assert not is_whole(path)
        repair(path)
        read = forces_of(path)
        assert read.tobytes() == forces[: len(read)].tobytes()
        lost_bytes = (1.0 - len(read) / len(forces)) * len(data) - (len(data) - cut)
        assert lost_bytes < 2.5 * len(data) / CHUNKS, "more than a chunk is lost"


def test_what_holds_nothing_is_said_so(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(b"nothing of the kind")
    with pytest.raises(NoRecordingError, match="no MCAP file"):
        repair(path)
    path.unlink()
    McapWriter(path, "test").abandon()
    with pytest.raises(NoRecordingError, match="before anything was recorded"):
        repair(path)


def test_a_snapshot_goes_into_a_state_and_back_to_the_byte() -> None:
    rng = np.random.default_rng(5)
    snapshots = np.zeros(7, SNAPSHOT)
    for name in ("force_true_n", "joint_position", "policy_observation", "object_position"):
        snapshots[name] = rng.normal(size=snapshots[name].shape)
    snapshots["command"]["force_n"], snapshots["command"]["guidance"] = 3.5, True
    snapshots["estimator_names"][:, :2] = [b"gmo_pi", b"hybrid"]
    snapshots["scene"], snapshots["wheel_in_contact"], snapshots["sequence"] = b"box", True, 123456789
    snapshots["force_sigma_n"] = np.nan
    bodies = STATE.batch(np.arange(7, dtype="u8"), 1)["body"]
    write_states(snapshots, bodies)
    assert read_states(bodies).tobytes() == snapshots.tobytes()
