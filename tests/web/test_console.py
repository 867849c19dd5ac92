"""The console as a whole: it draws every kind of snapshot, and a broken one does not end it."""

import asyncio
import threading
from collections.abc import Iterator

import numpy as np
import pytest
from viser import __version__ as viser_version

from sim.runtime.snapshot import Mode
from tests.web.recording_push_tests import RecordingPushTests
from tests.web.recording_sink import RecordingSink
from web.console import Console


@pytest.fixture
def console(sink: RecordingSink, snapshot: np.void) -> Iterator[Console]:
    console = Console(sink, lambda: snapshot, RecordingPushTests())
    yield console
    console.stop()


def test_its_door_leads_to_the_scene(console: Console) -> None:
    async def look() -> str | bytes:
        async with console.door.connect([f"viser-v{viser_version}"]) as visitor:
            return await visitor.receive()

    assert asyncio.run(asyncio.wait_for(look(), 20.0))


@pytest.mark.parametrize("mode", list(Mode))
def test_every_mode_is_drawn(console: Console, snapshot: np.void, mode: Mode) -> None:
    snapshot["mode"] = mode
    console.draw(snapshot)


def test_a_snapshot_of_hardware_has_no_truth_and_is_drawn(console: Console, snapshot: np.void) -> None:
    snapshot["backend"], snapshot["scene"] = b"hardware", b"robot"
    for name in (
        "force_true_n",
        "wheel_force_true_n",
        "mass_scale_true",
        "wheel_contact_position_in_world",
        "force_errors_rms_n",
    ):
        snapshot[name] = np.nan
    console.draw(snapshot)
    console.draw(None)
    console.draw(snapshot)


def test_drawing_sends_nothing_back(console: Console, sink: RecordingSink, snapshot: np.void) -> None:
    snapshot["command"]["force_n"] = [1.0, 2.0, 3.0]
    snapshot["command"]["guidance"] = True
    snapshot["speed"] = 2.0
    console.draw(snapshot)
    assert sink.calls == []


def test_one_bad_frame_does_not_stop_the_pump(
    sink: RecordingSink, snapshot: np.void, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    frames, recovered = [], threading.Event()

    def source() -> np.void:
        frames.append(None)
        if len(frames) == 1:
            raise ValueError("torn")
        recovered.set()
        return snapshot

    console = Console(sink, source, RecordingPushTests())
    monkeypatch.setattr(console, "has_viewers", lambda: True)
    console.start()
    assert recovered.wait(10.0)
    console.stop()
    assert "could not draw" in caplog.text


def test_nobody_watching_costs_nothing(sink: RecordingSink, snapshot: np.void) -> None:
    asked = threading.Event()

    def source() -> np.void:
        asked.set()
        return snapshot

    console = Console(sink, source, RecordingPushTests())
    console.start()
    assert not asked.wait(0.3)
    console.stop()
