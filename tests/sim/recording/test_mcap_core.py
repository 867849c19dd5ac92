"""The reader that Foxglove and Lichtblick are built on reads a recording whole: node with @mcap/core, where there is one."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from sim.recording.reader import Recording
from sim.runtime.simulation import Simulation, SimulationConfig
from tests.sim.recording.recorded import record

SCRIPT = Path(__file__).with_name("read_mcap.cjs")
PACKAGES = ("@mcap/core", "@mcap/support", "fzstd")
REQUIRES = ";".join(f"require('{name}')" for name in PACKAGES)
TICKS = 300


@pytest.mark.slow
def test_the_viewers_own_reader_finds_what_was_recorded(tmp_path: Path) -> None:
    node = shutil.which("node")
    if node is None or subprocess.run([node, "-e", REQUIRES], capture_output=True).returncode:
        pytest.skip(f"needs node, `npm install {' '.join(PACKAGES)}`, and NODE_PATH to where they are")
    path = tmp_path / "a.mcap"
    snapshots = record(Simulation(SimulationConfig(seed=5)), path, TICKS)
    ended = subprocess.run([node, str(SCRIPT), str(path)], capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
    found = json.loads(ended.stdout)
    recording = Recording(path)
    assert [found["counts"][topic] for topic in ("/sensors", "/inputs", "/targets", "/estimates")] == [TICKS] * 4
    assert found["counts"]["/state"] == found["counts"]["/tf"] == len(snapshots)
    assert set(found["attachments"]) == {"keyframe-0.zst"}
    last = recording.sensors()["body"][-1]
    assert found["last"]["/sensors"]["joint_velocity"] == last["joint_velocity"].tolist()
    hybrid = found["last"]["/estimates"]["hybrid"]
    estimate = recording.estimates_n()[-1, recording.estimators.index("hybrid")]
    assert [hybrid["x"], hybrid["y"], hybrid["z"]] == estimate.tolist()
    np.testing.assert_array_equal(found["last"]["/state"]["policy_observation"], snapshots[-1]["policy_observation"])
    base = next(each for each in found["last"]["/tf"]["transforms"] if each["child_frame_id"] == "base_link")
    assert base["translation"]["x"] == pytest.approx(snapshots[-1]["base_position"][0], abs=1e-4)
    stamp = base["timestamp"]
    assert stamp["seconds"] * 10**9 + stamp["nanos"] == pytest.approx(recording.start_ns + TICKS * 2_000_000)
