"""Recordings as a LeRobot data set: what its loader reads is what was recorded."""

import json
from pathlib import Path

import numpy as np
import pytest

from control.timing import SLOT_COUNT
from sim.export_lerobot import frames, main
from sim.recording.reader import Recording
from sim.runtime.simulation import Simulation, SimulationConfig
from tests.sim.recording.recorded import record


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path: Path = tmp_path_factory.mktemp("recording") / "a.mcap"
    record(Simulation(SimulationConfig(seed=3)), path, 120)
    return path


def test_frames_are_every_tenth_tick(path: Path) -> None:
    recording = Recording(path)
    values = frames(recording)
    sensors = recording.sensors()["body"]
    assert len(values["action"]) == 12
    np.testing.assert_allclose(values["observation.state"][3, :22], sensors["joint_position"][3 * SLOT_COUNT], rtol=1e-6)
    hybrid = recording.estimates_n()[::SLOT_COUNT, recording.estimators.index("hybrid")]
    np.testing.assert_allclose(values["observation.force"][5], hybrid[5], rtol=1e-5)


def test_the_data_set_is_whole_and_not_written_over(path: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    words = [str(path), str(path), "--output", str(tmp_path / "set"), "--task", "press"]
    assert main(words) == 0
    info = json.loads((tmp_path / "set" / "meta" / "info.json").read_text())
    assert (info["total_episodes"], info["total_frames"], info["fps"]) == (2, 24, 50)
    table = parquet.read_table(tmp_path / "set" / info["data_path"].format(episode_chunk=0, episode_index=1))
    assert table.num_rows == 12
    assert set(table.column_names) == set(info["features"])
    assert table["index"].to_pylist()[0] == 12
    for name, feature in info["features"].items():
        if feature["dtype"] == "float32" and name != "timestamp":
            assert len(table[name].to_pylist()[0]) == feature["shape"][0] == len(feature["names"]), name
    assert main(words) == 2
