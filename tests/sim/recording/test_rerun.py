"""A recording gives back what was recorded, and its pipeline run again gives the same bits."""

import csv
from pathlib import Path

import numpy as np
import pytest

from control.timing import TICK_S
from sim.recording.reader import Recording, RecordingFormatError
from sim.recording.rerun import reestimate, rerun
from sim.runtime.simulation import Simulation, SimulationConfig
from sim.sweep import main
from tests.sim.recording.recorded import record
from tests.sim.runtime.test_state_capture import run, setpoint

BEFORE, TICKS = 233, 520
DEEDS = {
    60: ("add_wrench", {"force_n": [3.0, -4.0, 8.0], "duration_s": 0.4, "ramp_s": 0.1}),
    130: ("select_estimator", {"name": "adaptive", "k1": 60.0, "k2": 2000.0}),
    200: ("select_controller", {"name": "model_based"}),
    260: ("estop", {}),
    290: ("clear_estop", {}),
    340: ("select_estimator", {"name": "hybrid"}),
    400: ("reset", {}),
}


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> tuple[Recording, list[np.void]]:
    """Begun in motion, with all that can happen to a pipeline in it."""
    session = Simulation(SimulationConfig(scene="box", seed=9))
    run(session, 0, BEFORE)
    path: Path = tmp_path_factory.mktemp("recording") / "a.mcap"
    snapshots = record(session, path, TICKS, DEEDS, keyframes_every=60)
    return Recording(path), snapshots


@pytest.mark.slow
def test_the_pipeline_gives_the_recorded_bits_again(recording: tuple[Recording, list[np.void]]) -> None:
    read, _ = recording
    again = rerun(read)
    recorded = read.estimates_n()
    assert len(recorded) == TICKS
    for index, name in enumerate(read.estimators):
        assert again.estimates_n[:, index].tobytes() == recorded[:, index].tobytes(), name
    targets = np.ascontiguousarray(read.targets()["body"]["position"])
    assert again.target_position.tobytes() == targets.tobytes()


@pytest.mark.slow
def test_from_any_keyframe_the_pipeline_gives_the_recorded_bits_again(recording: tuple[Recording, list[np.void]]) -> None:
    whole, _ = recording
    assert len(whole.keyframes) >= 3
    for tick, after in zip(whole.keyframes, (*whole.keyframes[1:], TICKS), strict=True):
        part = Recording(whole.path, TICK_S * (after - 1), TICK_S * (after + 20))
        assert part.first_tick == tick
        again, recorded = rerun(part), whole.estimates_n()[tick : after + 20]
        assert again.estimates_n.tobytes() == recorded.tobytes(), tick
        targets = np.ascontiguousarray(whole.targets()["body"]["position"][tick : after + 20])
        assert again.target_position.tobytes() == targets.tobytes(), tick
        part.close()


@pytest.mark.slow
def test_the_tare_of_a_task_is_done_again(tmp_path: Path) -> None:
    session = Simulation(SimulationConfig(scene="box", seed=9))
    asked = setpoint(0)
    asked["drag_active"] = False
    session.tick_setpoint(asked, 0.0)
    task = session.start_task("box", {}).runner
    while task.phase != "zero" and session.time_s < 10.0:
        session.tick_setpoint(asked, 0.0)
    record(session, tmp_path / "a.mcap", 450, asked=lambda _: asked)
    assert session.own_deeds["tare"] == 1 and task.phase == "touch"
    read = Recording(tmp_path / "a.mcap")
    assert [event.name for event in read.events()] == ["tare"]
    assert rerun(read).estimates_n.tobytes() == np.ascontiguousarray(read.estimates_n()).tobytes()


@pytest.mark.slow
def test_one_estimator_alone_gives_what_it_gave_in_the_pipeline(recording: tuple[Recording, list[np.void]]) -> None:
    read, _ = recording
    first = read.estimators.index("gmo_cqp")
    alone = np.array([estimate.force_estimated_n for estimate in reestimate(read, "gmo_cqp")])[:130]
    recorded = read.estimates_n()[:130, first]
    shown = (np.diff(recorded, axis=0, prepend=np.nan) != 0.0).any(axis=1)  # it is asked once in ten ticks there
    shown[0] = False
    assert shown.sum() >= 12
    np.testing.assert_array_equal(alone[shown], recorded[shown])
    retuned = np.array([estimate.force_estimated_n for estimate in reestimate(read, "gmo_cqp", (12.0, 80.0))])[:130]
    assert np.abs(retuned - alone).max() > 0.05


@pytest.mark.slow
def test_a_sweep_goes_from_keyframe_to_keyframe(recording: tuple[Recording, list[np.void]], tmp_path: Path) -> None:
    whole, _ = recording
    words = ["--out", str(tmp_path), "--recording", str(whole.path), "--grid", "estimator=gmo_pi", "gains=6:20,12:80"]
    assert main(words) == 0
    with (tmp_path / "table.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * len(whole.keyframes)
    assert sum(float(row["robot_minutes"]) for row in rows) == pytest.approx(2 * TICKS * TICK_S / 60.0)
    assert {float(row["from_s"]) for row in rows} == {TICK_S * tick for tick in whole.keyframes}
    assert all(0.0 < float(row["error_rms_n"]) < 100.0 for row in rows)
    assert main(["--out", str(tmp_path), "--recording", str(tmp_path / "none.mcap"), "--grid", "estimator=gmo_pi"]) == 2


def test_snapshots_come_back_to_the_byte(recording: tuple[Recording, list[np.void]]) -> None:
    read, snapshots = recording
    assert read.snapshot(0.0) is None
    for index in (0, 17, len(snapshots) - 1):
        found = read.snapshot((10 * index + 10) * TICK_S + 1e-4)
        assert found is not None
        assert found.tobytes() == snapshots[index].tobytes()
    assert read.duration_s == pytest.approx(TICKS * TICK_S, abs=0.01)


def test_what_is_no_recording_is_said_so(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" * 3)
    with pytest.raises(RecordingFormatError, match="no recording of Forcelens"):
        Recording(path)
