"""A sweep makes one row per cell whatever happens to it, and draws them."""

import csv
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from control.paths import ROOT
from sim.sweep import SweepError, cells, main, parse_grid

SLOW = ("--function", "tests.sim.sweep_cells:slow", "--grid", "a=1,2,3,4", "b=1,2,3,4,5,6", "seconds=0.1")


def table(folder: Path) -> list[dict[str, str]]:
    with (folder / "table.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def kept(folder: Path) -> list[Path]:
    """Files of cells that are done, without those that are being written."""
    return [file for file in folder.glob("*.json") if "partial" not in file.name]


def test_a_grid_is_all_combinations() -> None:
    grid = parse_grid(["controller=policy,model_based", "mass_scale=0.8,1.0", "seed=1"])
    assert list(cells(grid))[1] == {"controller": "policy", "mass_scale": 1.0, "seed": 1}
    assert len(list(cells(grid))) == 4
    for wrong in ("seed", "seed=", "=1", "a b=1"):
        with pytest.raises(SweepError, match="key=value"):
            parse_grid([wrong])


def test_a_sweep_of_24_that_was_killed_half_way_goes_on(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "sim.sweep", "--out", str(tmp_path), *SLOW]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(command, cwd=ROOT, env=environment, stderr=subprocess.DEVNULL, start_new_session=True)
    folder = tmp_path / "cells"
    deadline = time.monotonic() + 60.0
    while len(kept(folder)) < 8 and time.monotonic() < deadline:
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    done = {file: file.stat().st_mtime_ns for file in kept(folder)}
    assert 8 <= len(done) < 24
    assert main(["--out", str(tmp_path), *SLOW, "--workers", "2"]) == 0
    assert {file: file.stat().st_mtime_ns for file in done} == done, "what was done is not done again"
    rows = table(tmp_path)
    assert len(rows) == 24
    assert all(int(row["sum"]) == int(row["a"]) + int(row["b"]) for row in rows)
    assert (tmp_path / "plot.png").stat().st_size > 5000


def test_a_cell_that_fails_costs_no_other_and_is_tried_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--out", str(tmp_path), "--function", "tests.sim.sweep_cells:failing", "--grid", "a=1,2,3"]
    assert main(words) == 1
    assert [row["square"] for row in table(tmp_path)] == ["1", "9"]
    assert main(words) == 1
    told = capsys.readouterr().err
    assert told.count("two is too much") == 2 and "2 of 3 cells are done already" in told


def test_a_benchmark_takes_the_cell_as_its_options(tmp_path: Path) -> None:
    words = ["--out", str(tmp_path), "--benchmark", "no_such_thing", "--grid", "seed=1"]
    assert main(words) == 1
    assert main(["--out", str(tmp_path), "--grid", "seed"]) == 2


@pytest.mark.slow
def test_the_full_stack_is_tried_unless_told_otherwise(tmp_path: Path) -> None:
    grid = ["controller=model_based", "estimator=adaptive", "mass_scale=1.1", "seed=1", "minutes=0.05", "gains=20:40"]
    assert main(["--out", str(tmp_path), "--grid", *grid]) == 0
    (row,) = table(tmp_path)
    assert 0.0 < float(row["rmse_estimate_n"]) < 10.0 and row["falls"] == "0"
