"""What Prometheus scrapes: it parses, says what the state says, and leaves out what is not known."""

import math
import time
from collections.abc import Iterator

import pytest
from prometheus_client.parser import text_string_to_metric_families

from server.metrics import CONTENT_TYPE
from tests.server.running_server import RunningServer

Samples = dict[tuple[str, frozenset[tuple[str, str]]], float]


def scrape(server: RunningServer) -> Samples:
    answer = server.http.get("/metrics")
    assert answer.headers["content-type"].startswith("text/plain; version=0.0.4") and "text/plain" in CONTENT_TYPE
    families = list(text_string_to_metric_families(answer.text))
    assert all(family.documentation for family in families)
    return {(sample.name, frozenset(sample.labels.items())): sample.value for family in families for sample in family.samples}


def one(samples: Samples, name: str, **labels: str) -> float:
    return samples[f"forcelens_{name}", frozenset(labels.items())]


@pytest.fixture
def samples(server: RunningServer) -> Iterator[Samples]:
    server.wait_for(lambda state: state["loop"]["rate_hz"] > 0.0 and state["time_s"] > 0.5)
    yield scrape(server)


def test_it_says_what_the_state_says(samples: Samples, server: RunningServer) -> None:
    state = server.state()
    assert one(samples, "ready") == one(samples, "control_alive") == one(samples, "mode", mode="running") == 1.0
    assert one(samples, "mode", mode="estop") == one(samples, "lease_held") == one(samples, "clients", kind="stream") == 0.0
    assert one(samples, "loop_missed_deadlines_total") <= state["loop"]["overruns"]
    assert {dict(labels)["estimator"] for name, labels in samples if name == "forcelens_estimator_error_newtons"} <= set(
        state["end_effector"]["force_estimates_n"]
    )
    assert one(samples, "mass_scale_ratio", kind="true") == 1.0
    assert one(samples, "control_resident_memory_bytes") > 1e7
    assert all(math.isfinite(value) for value in samples.values())


def test_it_tells_of_the_recorder(server: RunningServer, samples: Samples) -> None:
    assert one(samples, "recording") == one(samples, "recorder_alive") == 0.0
    key = server.http.post("/api/v1/recordings", json={}).json()["id"]
    server.wait_for(lambda state: state["recording"]["size_bytes"] > 0)
    during = scrape(server)
    row = server.http.delete("/api/v1/recordings/current").json()
    server.http.delete(f"/api/v1/recordings/{key}").raise_for_status()
    assert one(during, "recording") == one(during, "recorder_alive") == 1.0
    assert 0.0 < one(during, "recording_bytes") <= row["size_bytes"]
    assert one(during, "recording_lost_ticks_total") == 0.0
    assert one(during, "recorder_resident_memory_bytes") > 1e7
    assert one(scrape(server), "recorder_alive") == 0.0


def test_every_tick_is_in_one_class_of_the_histogram(server: RunningServer, samples: Samples) -> None:
    def buckets(of: Samples) -> list[float]:
        found = {dict(labels)["le"]: value for (name, labels), value in of.items() if name.endswith("duration_seconds_bucket")}
        return [found[bound] for bound in sorted(found, key=float)]

    server.http.post("/api/v1/run", json={"state": "paused"}).raise_for_status()
    server.wait_for(lambda state: state["mode"] == "paused")
    later = scrape(server)
    counts = buckets(later)
    assert counts == sorted(counts)
    assert counts[-1] == one(later, "loop_tick_duration_seconds_count") >= one(samples, "loop_tick_duration_seconds_count") > 0
    assert one(later, "loop_tick_duration_seconds_sum") > 0.0


def test_a_stop_shows_and_the_readers_are_counted(server: RunningServer) -> None:
    import websockets.sync.client

    with websockets.sync.client.connect(server.socket_url("/api/v1/stream"), proxy=None) as socket:
        socket.recv()
        assert one(scrape(server), "clients", kind="stream") == 1.0
    server.http.post("/api/v1/estop").raise_for_status()
    assert one(scrape(server), "mode", mode="estop") == 1.0
    deadline = time.monotonic() + 5.0
    while one(scrape(server), "clients", kind="stream") and time.monotonic() < deadline:
        time.sleep(0.01)
    assert one(scrape(server), "clients", kind="stream") == 0.0


def test_ready_is_no_matter_of_life(server: RunningServer) -> None:
    assert server.http.get("/api/v1/ready").json() == {"ready": True, "reason": None}
    client = server.operator.client
    future = client.submit("set_scene", name="box")
    early = server.http.get("/api/v1/ready")
    future.result(30.0)
    assert early.status_code in (200, 503) and early.json()["ready"] == (early.status_code == 200)
    server.http.put("/api/v1/scene", json={"name": "free"}).raise_for_status()
