"""Data collection: honest splits, published profiles, reproducible rollouts, resume, and the same result on a Ray cluster."""

import errno
import json
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from control.learning.rollout_data import SPLITS, DatasetError, column_sizes, is_whole_rollout, load_split
from control.robot_model import RobotModel
from control.timing import CONTROL_PERIOD_S, TICK_S
from sim.collect_dataset import CollectionError, collect, main
from sim.processes.executors import ExecutorError, map_unordered
from sim.trials.rollout_plans import RolloutPlan, plan_rollouts
from sim.trials.rollout_profiles import (
    FORCE_LIMIT_N,
    HORIZONTAL_LIMIT_N,
    PROFILES,
    MotionConfig,
    RandomMotion,
    rms_force,
    rms_slope,
    sampled_force,
)
from sim.trials.rollout_recorder import manifest_entry, record_rollout
from sim.trials.rollout_runner import ATTEMPTS

LINKS = ("base", "arm_link1")


@pytest.mark.parametrize("profile", ["hold", "sine", "slow"])
def test_profiles_start_at_zero_and_stay_within_their_limits(profile: str) -> None:
    for seed in range(5):
        force = sampled_force(profile, np.random.default_rng(seed), 20.0, TICK_S)
        assert force.shape == (10_000, 3)
        np.testing.assert_allclose(force[0], 0.0, atol=1e-12)
        assert np.linalg.norm(force, axis=1).max() <= FORCE_LIMIT_N + 1e-9
        assert np.hypot(force[:, 0], force[:, 1]).max() <= HORIZONTAL_LIMIT_N + 1e-9
        # No jump: a step is bounded by the slope of the fastest ramp (peak 1.875 times its mean).
        assert np.abs(np.diff(force, axis=0)).max() <= 1.875 * 2.0 * FORCE_LIMIT_N / 0.3 * TICK_S * 1.1


def test_slow_is_slower_than_sine_and_every_profile_pushes() -> None:
    forces = {
        profile: np.vstack([sampled_force(profile, np.random.default_rng(seed), 20.0, 0.01) for seed in range(10)])
        for profile in ("hold", "sine", "slow")
    }
    assert all(8.0 < rms_force(force) < 20.0 for force in forces.values())
    slopes = {profile: rms_slope(force[1:2000], 0.01) for profile, force in forces.items()}
    assert slopes["slow"] < 0.5 * slopes["sine"]


def test_unknown_profiles_are_refused() -> None:
    with pytest.raises(ValueError, match="storm"):
        sampled_force("storm", np.random.default_rng(0), 1.0, TICK_S)


def test_rms_figures_match_a_closed_form() -> None:
    time = np.arange(0.0, 10.0, 1e-3)
    force = np.column_stack([3.0 * np.sin(2.0 * np.pi * time), np.zeros_like(time), np.full_like(time, 4.0)])
    assert rms_force(force) == pytest.approx(np.sqrt(4.5 + 16.0), rel=1e-3)
    assert rms_slope(force, 1e-3) == pytest.approx(3.0 * 2.0 * np.pi / np.sqrt(2.0), rel=1e-3)


def test_random_motion_is_reproducible_and_moves_base_and_hand() -> None:
    first, second = (RandomMotion(MotionConfig(), np.random.default_rng(1)) for _ in range(2))
    positions, velocities = set(), set()
    for time in np.arange(0.0, 20.0, CONTROL_PERIOD_S):
        a, b = first.step(time), second.step(time)
        np.testing.assert_array_equal(a.position_m, b.position_m)
        assert not a.mask.any()
        positions.add(tuple(a.position_m))
        velocities.add(tuple(a.base_velocity))
    assert len(positions) > 4 and len(velocities) > 4


def test_plans_split_rollouts_before_anything_runs() -> None:
    plans = plan_rollouts(seed=7, count=200, links=LINKS, duration_s=10.0)
    assert plans == plan_rollouts(seed=7, count=200, links=LINKS, duration_s=10.0)
    assert plans != plan_rollouts(seed=8, count=200, links=LINKS, duration_s=10.0)
    counts = {split: sum(plan.split == split for plan in plans) for split in SPLITS}
    assert counts == {"train": 132, "validation": 60, "test": 8}
    assert {plan.duration_s for plan in plans if plan.split == "train"} == {10.0}
    assert {plan.duration_s for plan in plans if plan.split != "train"} == {20.0}
    # Attempts use the seeds that follow: no two rollouts ever share one.
    seeds = {plan.seed + attempt for plan in plans for attempt in range(8)}
    assert len(seeds) == 8 * len(plans)


def test_held_out_plans_cover_every_cell_and_training_is_randomised() -> None:
    plans = plan_rollouts(seed=7, count=400, links=LINKS, duration_s=10.0)
    for split in ("validation", "test"):
        cells = {(p.profile, "link" if p.per_link else p.mass_scale) for p in plans if p.split == split}
        assert cells == {(profile, kind) for profile in PROFILES for kind in (0.8, 1.0, 1.2, "link")}
    train = [plan for plan in plans if plan.split == "train"]
    assert {plan.delay_ticks for plan in train} == {0, 1, 2, 3}
    assert len({plan.torque_scale_std for plan in train}) == len(train)
    assert {plan.profile for plan in train} == {"hold", "sine", "slow", "spring"}
    scales = [scale for plan in train for scale in plan.per_link.values()]
    assert min(scales) < 0.85 and max(scales) > 1.15 and min(scales) >= 0.8 and max(scales) <= 1.2
    with pytest.raises(ValueError, match="at least 3"):
        plan_rollouts(seed=0, count=2, links=LINKS, duration_s=1.0)


@pytest.mark.slow
def test_a_rollout_repeats_exactly_and_records_what_acts() -> None:
    plan = RolloutPlan(0, "train", seed=11, profile="hold", mass_scale=1.2, duration_s=1.4)
    first, second = record_rollout(plan), record_rollout(plan)
    assert set(first.arrays) == set(column_sizes())
    for name, array in first.arrays.items():
        assert len(array) == round(1.4 / CONTROL_PERIOD_S)
        np.testing.assert_array_equal(array, second.arrays[name])
    force = first.arrays["force_true_n"]
    assert np.abs(force[:20]).max() < 1e-6 and np.abs(force[-1]).max() > 1.0
    weight = first.arrays["wheel_forces_true"].reshape(-1, 4, 3).sum(axis=1)[15:25, 2].mean()
    assert weight == pytest.approx(1.2 * 9.81 * RobotModel().total_mass, rel=0.02)


def test_springs_answer_motion() -> None:
    plan = RolloutPlan(0, "train", seed=5, profile="spring", mass_scale=1.0, duration_s=1.5)
    force = record_rollout(plan).arrays["force_true_n"]
    assert np.abs(force).max() > 1.0


def test_a_rollout_that_falls_is_tried_again_and_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    plan = RolloutPlan(0, "train", seed=3, profile="hold", mass_scale=1.0, duration_s=0.2)
    assert record_rollout(plan).rejected == ()
    monkeypatch.setattr("sim.trials.rollout_runner.MINIMUM_HEIGHT_M", 1.0)
    recording = record_rollout(plan)
    assert recording.rejected == ("fall",) * ATTEMPTS
    assert not recording.arrays and manifest_entry(recording, "")["rejected"] == ["fall"] * ATTEMPTS


@pytest.mark.slow
def test_collection_resumes_and_refuses_another_data_set(tmp_path: Path) -> None:
    manifest = collect(tmp_path, seed=1, rollouts=3, duration_s=0.3)
    assert manifest["counts"] == dict.fromkeys(SPLITS, 1)
    assert {"rms_force_n", "rms_slope_nps"} == set(manifest["profiles"]["hold"])
    before = {path: path.stat().st_mtime_ns for path in tmp_path.glob("rollouts/*.npz")}
    gone = sorted(before)[1]
    gone.unlink()
    gone.with_suffix(".json").unlink()
    again = collect(tmp_path, seed=1, rollouts=3, duration_s=0.3)
    assert again["rollouts"] == manifest["rollouts"] == json.loads((tmp_path / "manifest.json").read_text())["rollouts"]
    after = {path: path.stat().st_mtime_ns for path in tmp_path.glob("rollouts/*.npz")}
    assert [path for path in after if after[path] != before[path]] == [gone]
    assert len(load_split(tmp_path, "train")[0].force_true_n) == 15
    with pytest.raises(CollectionError, match="--output"):
        collect(tmp_path, seed=2, rollouts=3, duration_s=0.3)


@pytest.fixture
def in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Collect without other processes."""
    monkeypatch.setattr("sim.collect_dataset.map_unordered", lambda _, function, arguments, *__: map(function, arguments))


def test_a_collection_continues_wherever_the_disk_was_full(
    tmp_path: Path, in_process: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    reference = collect(tmp_path / "reference", seed=1, rollouts=3, duration_s=0.1)
    for room in range(7):
        writes = iter(range(room))

        def full(_: int, writes: Iterator[int] = writes) -> None:
            if next(writes, None) is None:
                raise OSError(errno.ENOSPC, "No space left on device")

        with monkeypatch.context() as patch:
            patch.setattr("control.files.os.fsync", full)
            with pytest.raises(OSError, match="No space"):
                collect(tmp_path / f"{room}", seed=1, rollouts=3, duration_s=0.1)
        assert collect(tmp_path / f"{room}", seed=1, rollouts=3, duration_s=0.1) == reference
        assert not list((tmp_path / f"{room}").rglob("*partial*"))


@pytest.mark.parametrize("ending", [".json", ".npz"])
@pytest.mark.parametrize("damage", [lambda data: b"", lambda data: data[: len(data) // 2], lambda data: data[:-1]])
def test_what_was_written_half_way_is_found_and_recorded_again(
    tmp_path: Path, in_process: None, ending: str, damage: Callable[[bytes], bytes]
) -> None:
    manifest = collect(tmp_path, seed=1, rollouts=3, duration_s=0.1)
    victim = sorted(tmp_path.glob(f"rollouts/*{ending}"))[1]
    whole = victim.read_bytes()
    damaged = damage(whole)
    victim.write_bytes(damaged)
    assert collect(tmp_path, seed=1, rollouts=3, duration_s=0.1) == manifest
    assert (victim.read_bytes() == damaged) == (damaged.rstrip() == whole.rstrip())  # a line end is no loss
    load_split(tmp_path, manifest["rollouts"][1]["split"])


def test_a_damaged_data_set_is_not_trained_on(tmp_path: Path, in_process: None) -> None:
    manifest = collect(tmp_path, seed=1, rollouts=3, duration_s=0.1)
    first = manifest["rollouts"][0]
    path = tmp_path / first["file"]
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 0xFF
    path.write_bytes(data)
    assert not is_whole_rollout(path)
    path.write_bytes(data[:100])
    with pytest.raises(DatasetError, match="run the collection again"):
        load_split(tmp_path, first["split"])
    (tmp_path / "manifest.json").write_text("{")
    with pytest.raises(DatasetError, match="run the collection again"):
        load_split(tmp_path, first["split"])


def test_a_full_disk_is_told_plainly(
    tmp_path: Path, in_process: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("control.files.os.fsync", full)
    with pytest.raises(SystemExit, match="1"):
        main(["--output", str(tmp_path), "--rollouts", "3", "--duration", "0.1"])
    assert "No space left on device. What is there is kept" in capsys.readouterr().err


def test_without_ray_the_cure_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "ray", None)
    with pytest.raises(ExecutorError, match="cluster"):
        list(map_unordered("ray", abs, [-1], 1))
    with pytest.raises(ValueError, match="abacus"):
        map_unordered("abacus", abs, [-1], 1)


@pytest.mark.slow
def test_one_split_is_recorded_as_it_is_among_all(tmp_path: Path) -> None:
    whole = collect(tmp_path / "whole", seed=4, rollouts=3, duration_s=0.2)
    part = collect(tmp_path / "part", seed=4, rollouts=3, duration_s=0.2, splits=("validation",))
    assert part["counts"] == {"train": 0, "validation": 1, "test": 0}
    assert part["rollouts"] == [entry for entry in whole["rollouts"] if entry["split"] == "validation"]


def test_a_local_ray_cluster_gives_the_same_data(tmp_path: Path) -> None:
    pytest.importorskip("ray")
    local = collect(tmp_path / "local", seed=4, rollouts=3, duration_s=0.2)
    cluster = collect(tmp_path / "ray", seed=4, rollouts=3, duration_s=0.2, executor="ray", workers=2)
    assert local["rollouts"] == cluster["rollouts"]
    for entry in local["rollouts"]:
        with np.load(tmp_path / "local" / entry["file"]) as a, np.load(tmp_path / "ray" / entry["file"]) as b:
            for name in a.files:
                np.testing.assert_array_equal(a[name], b[name])
