"""Recordings by REST: through control process and recorder into a file that the reference reader reads."""

import io
import json
import os
import signal
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from server.errors import RefusedError
from sim.recording.folder import RecordingFolder
from tests.server.contract import API
from tests.server.running_server import RunningServer

TICKS = 700


def call(server: RunningServer, method: str, path: str, body: Any = None) -> Any:
    response = server.http.request(method, API + path, json=body)
    response.raise_for_status()
    return response.json() if response.content else None


@pytest.fixture
def paused(server: RunningServer) -> Iterator[RunningServer]:
    """Recordings of a simulation that is stepped are as long as they were asked to be."""
    call(server, "POST", "run", {"state": "paused"})
    yield server
    server.operator.recordings.end()
    for row in server.operator.recordings.list():
        server.operator.recordings.delete(row.id)


def record(server: RunningServer, ticks: int = TICKS, **options: str) -> dict[str, Any]:
    call(server, "POST", "recordings", options)
    call(server, "POST", "step", {"ticks": ticks})
    return call(server, "DELETE", "recordings/current")


def test_what_was_recorded_is_what_happened(paused: RunningServer) -> None:
    call(paused, "PATCH", "command", {"mask": [0, 0, 1], "force_n": [0, 0, 7]})
    started = call(paused, "POST", "recordings", {"name": "a push", "note": "quiet"})
    call(paused, "POST", "step", {"ticks": 200})
    call(paused, "PUT", "estimator", {"name": "adaptive"})
    call(paused, "POST", "step", {"ticks": TICKS - 200})
    shown = paused.state()["recording"]
    assert (shown["id"], shown["duration_s"]) == (started["id"], pytest.approx(0.002 * TICKS))
    row = call(paused, "DELETE", "recordings/current")
    assert (row["name"], row["note"], row["complete"], row["gaps"]) == ("a push", "quiet", True, 0)
    assert row["duration_s"] == pytest.approx(0.002 * TICKS, abs=0.01)
    assert call(paused, "GET", "recordings") == [row]
    state = paused.state()
    assert state["recording"] is None
    data = paused.http.get(f"{API}recordings/{row['id']}/download").content
    assert len(data) == row["size_bytes"]
    reader = make_reader(io.BytesIO(data), validate_crcs=True, decoder_factories=[DecoderFactory()])
    counts = {}
    last: dict[str, Any] = {}
    for _, channel, _, message in reader.iter_decoded_messages(
        topics=["/sensors", "/estimates", "/inputs", "/state", "/truth", "/tf", "/scene"]
    ):
        counts[channel.topic] = counts.get(channel.topic, 0) + 1
        last[channel.topic] = message
    assert counts["/sensors"] == counts["/estimates"] == counts["/inputs"] == TICKS
    assert counts["/state"] == pytest.approx(TICKS / 10, abs=4)
    assert counts["/truth"] == pytest.approx(TICKS / 5, abs=10)
    assert list(last["/inputs"].force_n) == [0.0, 0.0, 7.0]
    assert list(last["/sensors"].joint_position) == state["joints"]["position"]
    estimated = state["end_effector"]["force_estimates_n"]["hybrid"]
    assert [last["/estimates"].hybrid.x, last["/estimates"].hybrid.y, last["/estimates"].hybrid.z] == estimated
    events = [json.loads(message.data)["name"] for _, _, message in reader.iter_messages(topics=["/events"])]
    assert events == ["select_estimator"]
    names = {attachment.name for attachment in reader.iter_attachments()}
    assert names == {"robot.xml", "forcelens.foxglove.json", "keyframe-0.zst"}
    metadata = {each.name: each.metadata for each in reader.iter_metadata()}["forcelens"]
    assert (metadata["scene"], metadata["name"]) == ("free", "a push")
    assert "weights.hybrid" in metadata
    call(paused, "PUT", "estimator", {"name": "hybrid"})
    call(paused, "DELETE", f"recordings/{row['id']}")
    assert call(paused, "GET", "recordings") == []


def test_one_at_a_time_and_what_is_not_there_is_missing(paused: RunningServer) -> None:
    started = call(paused, "POST", "recordings")
    for method, path, status in (
        ("POST", "recordings", 409),
        ("DELETE", f"recordings/{started['id']}", 409),
        ("GET", "recordings/nothing", 404),
        ("GET", "recordings/nothing/download", 404),
        ("GET", "recordings/..%2Fsecret/download", 404),
        ("DELETE", "recordings/nothing", 404),
        ("POST", "history/branch", 409),
    ):
        assert paused.http.request(method, API + path).status_code == status, path
    call(paused, "DELETE", "recordings/current")
    assert paused.http.delete(f"{API}recordings/current").status_code == 404


def test_a_full_budget_is_refused_with_what_to_do(paused: RunningServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(paused.operator.recordings, "folder", RecordingFolder(paused.operator.recordings.folder.path, 1000))
    response = paused.http.post(f"{API}recordings")
    assert response.status_code == 409
    assert "delete recordings, or allow more with --data-budget" in response.json()["detail"]
    assert paused.state()["recording"] is None


@pytest.mark.parametrize("chunks", [1, 3])
def test_a_recorder_that_is_killed_loses_a_second_at_most(paused: RunningServer, chunks: int) -> None:
    call(paused, "POST", "recordings")
    recorder = paused.operator.recordings._recorder
    assert recorder is not None
    assert recorder.pid is not None
    call(paused, "POST", "step", {"ticks": 250 * chunks + 200})
    paused.wait_for(lambda state: state["recording"] and state["recording"]["size_bytes"] > 0)
    time.sleep(0.3)
    os.kill(recorder.pid, signal.SIGKILL)
    recorder.join()
    (row,) = call(paused, "GET", "recordings")
    assert not row["complete"]
    assert 0.5 * chunks <= row["duration_s"] + 0.01
    paused.wait_for(lambda state: state["recording"] is None)
    assert record(paused)["complete"], "the next one works"


def test_it_ends_with_its_control_process(paused: RunningServer) -> None:
    call(paused, "POST", "recordings")
    call(paused, "POST", "step", {"ticks": 600})
    call(paused, "POST", "control/restart", {"force": True})
    (row,) = call(paused, "GET", "recordings")
    assert row["complete"]
    assert row["duration_s"] == pytest.approx(1.2, abs=0.01)


def test_what_a_crash_left_is_repaired_at_the_next_start(paused: RunningServer) -> None:
    folder = paused.operator.recordings.folder
    row = record(paused)
    path = folder.file(row["id"])
    data = path.read_bytes()
    path.unlink()
    (folder.path / f"{row['id']}.mcap.part").write_bytes(data[: int(0.8 * len(data))])
    (folder.path / "20200101-000000-000.mcap.part").write_bytes(data[:100])
    folder.repair()
    (found,) = folder.list()
    assert (found.id, found.complete) == (row["id"], False)
    assert found.duration_s > 0.4
    assert np.isclose(found.size_bytes, 0.8 * len(data), rtol=0.5)


def test_a_recording_is_shown_and_sends_nothing(paused: RunningServer) -> None:
    call(paused, "PUT", "controller", {"name": "policy"})  # the default, with which the simulation comes back
    before = paused.state()
    row = record(paused, 300)
    after = paused.state()
    call(paused, "PUT", "backend", {"name": "replay", "options": {"recording": row["id"]}})
    try:
        assert call(paused, "GET", "backend")["name"] == "replay"
        replay = call(paused, "PATCH", "replay", {"time_s": 0.4, "state": "paused", "speed": 8})
        assert (replay["time_s"], replay["state"], replay["speed"]) == (0.4, "paused", 8)
        assert replay["duration_s"] == pytest.approx(0.6, abs=0.01)
        shown = paused.state()
        assert (shown["backend"], shown["mode"], shown["time_s"]) == ("replay", "paused", 0.4)
        call(paused, "PATCH", "replay", {"time_s": replay["duration_s"]})
        assert paused.state()["joints"]["position"] == pytest.approx(after["joints"]["position"], abs=3e-3)
        assert paused.state()["end_effector"]["force_estimates_n"].keys() == before["end_effector"]["force_estimates_n"].keys()
        assert call(paused, "PATCH", "replay", {"state": "playing"})["time_s"] == 0.0
        paused.wait_for(lambda _: call(paused, "GET", "replay")["state"] == "paused")
        for method, path, body, status in (
            ("PATCH", "command", {"guidance": True}, 409),
            ("PUT", "estimator", {"name": "adaptive"}, 409),
            ("POST", "recordings", {}, 409),
            ("POST", "reset", {}, 409),
            ("PATCH", "replay", {"time_s": 9.0}, 422),
            ("PATCH", "replay", {"speed": 9.0}, 422),
        ):
            assert paused.http.request(method, API + path, json=body).status_code == status, path
        assert paused.operator.estimates.shown == row["id"]
    finally:
        call(paused, "PUT", "backend", {"name": "simulation"})
    with pytest.raises(RefusedError, match="no recording is shown"):
        paused.operator.estimates.again("gmo_pi", None)
    assert paused.http.get(f"{API}replay").status_code == 409
    assert paused.state()["controller"] == before["controller"]
