"""The seqlock: no reader ever sees half a record, not even of a writer that was killed."""

import multiprocessing
import time
from typing import Any

import numpy as np
import pytest

from sim.processes import shared_record
from sim.processes.shared_record import SharedRecord

RECORD = np.dtype([("count", "u8"), ("values", "f8", 400), ("count_again", "u8")])
CONTEXT = multiprocessing.get_context("spawn")


@pytest.fixture
def shared() -> SharedRecord:
    return SharedRecord(shared_record.allocate(RECORD), RECORD)


def numbered(count: int) -> np.ndarray:
    record = np.zeros(1, RECORD)
    record["count"] = record["count_again"] = count
    record["values"] = count
    return record


def write_for(memory: Any, seconds: float) -> None:
    shared = SharedRecord(memory, RECORD)
    end = time.monotonic() + seconds
    count = 0
    while time.monotonic() < end:
        count += 1
        shared.write(numbered(count))


def test_there_is_nothing_to_read_before_the_first_write(shared: SharedRecord) -> None:
    assert shared.read() is None


def test_a_record_comes_back_and_is_a_copy(shared: SharedRecord) -> None:
    shared.write(numbered(7))
    first = shared.read()
    shared.write(numbered(8))
    second = shared.read()
    assert first is not None and second is not None
    assert first[0]["count"] == 7
    assert second[0]["count"] == 8


def test_only_what_is_new_is_read_anew(shared: SharedRecord) -> None:
    assert shared.read_new() is None
    for count in (7, 8):
        shared.write(numbered(count))
        newest = shared.read_new()
        assert newest is not None
        assert newest[0]["count"] == count
        assert shared.read_new() is None
        assert shared.read() is not None, "whoever asks for the newest gets it"


def test_two_processes_never_tear_a_record() -> None:
    memory = shared_record.allocate(RECORD)
    shared = SharedRecord(memory, RECORD)
    writer = CONTEXT.Process(target=write_for, args=(memory, 1.0))
    writer.start()
    seen = []
    while writer.is_alive() or not seen:
        record = shared.read()
        if record is None:
            continue
        count = int(record[0]["count"])
        assert record[0]["count_again"] == count
        assert (record[0]["values"] == count).all()
        seen.append(count)
    writer.join()
    assert seen == sorted(seen)
    assert len(set(seen)) > 20


def test_a_writer_killed_half_way_leaves_nothing_readable_and_the_next_one_repairs_it(shared: SharedRecord) -> None:
    shared.write(numbered(1))
    shared._header[0]["counter"] += 1  # as after its first store
    assert shared.read(attempts=3) is None
    shared.write(numbered(2))
    record = shared.read()
    assert record is not None
    assert record[0]["count"] == 2


def test_stores_that_became_visible_out_of_order_are_refused(shared: SharedRecord) -> None:
    shared.write(numbered(1))
    shared._body[100] ^= 1  # the counter says "complete", the body is not
    assert shared.read(attempts=3) is None
