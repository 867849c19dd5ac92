"""Training on made-up rollouts: it learns what is there, resumes exactly, and leaves held-out data out."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from control.estimation.networks.network_weights import load_network
from control.learning.calibration import COVERAGE, calibrate
from control.learning.evaluation import Prediction, predict, relative_error
from control.learning.losses import beta_likelihood, smooth_l1
from control.learning.recalibration import recalibrate
from control.learning.residual_training import ResidualTraining, RunError, TrainingConfig, main
from control.learning.rollout_bias import rollout_bias
from control.learning.rollout_data import (
    SETTLE_STEPS,
    DatasetError,
    Rollout,
    column_sizes,
    load_split,
    save_rollout,
    write_manifest,
)
from control.learning.shrinkage import NOISES_N, choose_output_noise
from control.learning.targets import TARGETS
from control.learning.windows import Normalization, WindowSet, raw_features, wanted_force
from control.timing import CONTROL_PERIOD_S

SHORT = TrainingConfig(epochs=2, samples_per_epoch=256, batch=64)
torch.set_num_threads(1)


def made_up_rollout(seed: int, steps: int = 300) -> dict[str, np.ndarray]:
    """Noise, except that the true force stands still: its nominal estimates are noise around it."""
    random = np.random.default_rng(seed)
    arrays = {name: random.standard_normal((steps, size)) for name, size in column_sizes().items()}
    arrays["force_true_n"][:] = 10.0 * random.standard_normal(3)
    for nominal in ("gmo_cqp", "adaptive"):
        arrays[f"{nominal}.force"] += arrays["force_true_n"]
    return arrays


@pytest.fixture
def data(tmp_path: Path) -> Path:
    entries = []
    for index, split in enumerate(["train"] * 6 + ["validation"] * 2 + ["test"]):
        name = f"rollouts/{index}.npz"
        save_rollout(tmp_path / name, made_up_rollout(index))
        entries.append({"file": name, "split": split, "profile": "hold", "mass_scale": 1.0, "per_link": {}})
    write_manifest(tmp_path, {"seed": 0, "commit": "none", "command": "none", "rollouts": entries})
    return tmp_path


@pytest.mark.slow
def test_a_residual_network_halves_the_noise_around_a_force_that_stands_still(data: Path, tmp_path: Path) -> None:
    config = TrainingConfig(epochs=2, samples_per_epoch=3200, batch=32, dropout=0.0, learning_rate=4e-3)
    training = ResidualTraining(TARGETS["hybrid"], data, tmp_path / "run", config)
    training.fit()
    manifest = training.export(tmp_path / "weights", "test")
    cell = manifest.metrics["cells"]["hold 1.0"]
    assert cell["rmse_vector_n"] < 0.5 * cell["nominal_rmse_vector_n"]
    assert cell["coverage_2sigma"] == pytest.approx(0.9545, abs=0.01)
    assert (tmp_path / "run" / "curves.png").stat().st_size > 1000


def test_recalibration_covers_other_data_and_leaves_the_network_alone(data: Path, tmp_path: Path) -> None:
    weights, other = tmp_path / "weights", tmp_path / "other"
    base = ["--data", str(data), "--target", "hybrid", "--run", str(tmp_path / "run"), "--output", str(weights)]
    main([*base, "--epochs", "1", "--samples-per-epoch", "256"])
    before, network = load_network("hybrid", weights).manifest, (weights / "hybrid.npz").read_bytes()
    arrays = made_up_rollout(20)
    arrays["adaptive.force"] = arrays["force_true_n"] + 3.0 * (arrays["adaptive.force"] - arrays["force_true_n"])
    save_rollout(other / "rollout.npz", arrays)
    entry = {"file": "rollout.npz", "split": "validation", "profile": "hold", "mass_scale": 1.0, "per_link": {}}
    write_manifest(other, {"seed": 1, "commit": "none", "command": "none", "rollouts": [entry]})
    recalibrate(other, "hybrid", weights, "test")
    after = load_network("hybrid", weights).manifest
    assert (weights / "hybrid.npz").read_bytes() == network and after.metrics == before.metrics
    assert after.training["calibration"]["cells"]["hold 1.0"]["coverage_2sigma"] == pytest.approx(0.9545, abs=0.01)
    assert after.sigma_scale is not None and before.sigma_scale is not None
    assert np.mean(after.sigma_scale) > 1.5 * np.mean(before.sigma_scale)


@pytest.mark.parametrize("name", sorted(TARGETS))
def test_exported_weights_run_as_they_were_trained(data: Path, tmp_path: Path, name: str) -> None:
    run, weights = tmp_path / "run", tmp_path / "weights"
    base = ["--data", str(data), "--target", name, "--run", str(run), "--output", str(weights)]
    main([*base, "--epochs", "1", "--samples-per-epoch", "256"])
    network = load_network(name, weights)
    assert network.manifest.nominal == TARGETS[name].nominal
    assert "--target" in network.manifest.training["command"]
    training = ResidualTraining(TARGETS[name], data, run, TrainingConfig(epochs=1, samples_per_epoch=256))
    training.module.load_state_dict(training.best_parameters)
    training.module.eval()
    rollout = training.validation[0]
    signals = rollout.signals(TARGETS[name].features_from)
    sigmas = []
    for step in range(SETTLE_STEPS + 30):
        force, sigma = network.step(signals[step : step + 1])
        window, _, _ = training.validation_set.windows(torch.tensor([0]), torch.tensor([step]))
        with torch.no_grad():
            raw = training.module(window)[0, :3].numpy()
        limit = np.array(network.manifest.output_limit_n)
        expected = np.clip(network.manifest.output_scale_n * raw, -limit, limit)
        expected *= expected**2 / (expected**2 + network.manifest.output_noise_n**2)
        np.testing.assert_allclose(force, expected, atol=1e-4)
        sigmas.append(sigma)
    stated = predict(training.module, training.validation_set, [rollout], TARGETS[name], network.manifest)[0].sigma
    if stated is None:
        assert sigmas == [None] * len(sigmas)
    else:
        assert all(network.manifest.sigma_slopes)
        np.testing.assert_allclose(sigmas[SETTLE_STEPS:], stated[:30], rtol=1e-4)


def test_a_resumed_run_ends_where_an_uninterrupted_one_does(data: Path, tmp_path: Path) -> None:
    whole = ResidualTraining(TARGETS["hybrid_paper"], data, tmp_path / "whole", SHORT)
    whole.fit()
    first = ResidualTraining(TARGETS["hybrid_paper"], data, tmp_path / "cut", SHORT)
    first._save_checkpoint = lambda original=first._save_checkpoint: (original(), _interrupt())  # type: ignore[method-assign]
    with pytest.raises(KeyboardInterrupt):
        first.fit()
    resumed = ResidualTraining(TARGETS["hybrid_paper"], data, tmp_path / "cut", SHORT)
    assert len(resumed.losses) == 1
    resumed.fit()
    assert resumed.losses == whole.losses and resumed.validation_rmse == whole.validation_rmse
    for name, tensor in whole.module.state_dict().items():
        assert torch.equal(tensor, resumed.module.state_dict()[name]), name


def _interrupt() -> None:
    raise KeyboardInterrupt


def test_a_run_folder_of_another_training_is_refused(data: Path, tmp_path: Path) -> None:
    ResidualTraining(TARGETS["tcn"], data, tmp_path / "run", SHORT)._save_checkpoint()
    with pytest.raises(RunError, match="another training"):
        ResidualTraining(TARGETS["hybrid"], data, tmp_path / "run", SHORT)


def test_normalisation_and_limits_come_from_the_training_split_alone(data: Path) -> None:
    target = TARGETS["hybrid"]
    before = ResidualTraining(target, data, data / "a", SHORT)
    for index in (6, 7, 8):
        save_rollout(data / f"rollouts/{index}.npz", {n: 100.0 * a for n, a in made_up_rollout(index).items()})
    after = ResidualTraining(target, data, data / "b", SHORT)
    np.testing.assert_array_equal(before.normalization.mean, after.normalization.mean)
    np.testing.assert_array_equal(before.normalization.std, after.normalization.std)
    assert before.manifest == after.manifest


def test_increments_are_changes_from_the_step_before_and_the_rest_are_levels(data: Path) -> None:
    target = TARGETS["hybrid"]
    rollout = load_split(data, "validation")[0]
    values, force = raw_features(rollout, target), rollout.arrays["adaptive.force"]
    assert not values[0, :3].any()
    np.testing.assert_array_equal(values[1:, :3], np.diff(force.astype(float), axis=0))
    np.testing.assert_allclose(values[:, -1], np.linalg.norm(force, axis=1), rtol=1e-6)


def test_windows_end_at_their_step_and_repeat_the_first_one_before_the_start(data: Path) -> None:
    target = TARGETS["tcn"]
    rollouts = load_split(data, "validation")
    windows = WindowSet(rollouts, target, Normalization.of(rollouts, target), history=20)
    inputs, learnable, wanted = windows.windows(torch.tensor([1, 1, 1]), torch.tensor([0, 5, 40]))
    assert torch.equal(inputs[0], inputs[0][:1].expand(20, -1))
    assert torch.equal(inputs[1][:14], inputs[0][:14]) and not torch.equal(inputs[1][15], inputs[0][0])
    later, _, _ = windows.windows(torch.tensor([1]), torch.tensor([41]))
    assert torch.equal(later[0][:-1], inputs[2][1:])
    np.testing.assert_allclose(wanted[2].numpy(), wanted_force(rollouts[1], target)[40], rtol=1e-6)
    assert torch.equal(wanted, learnable)


def test_a_posture_dependent_bias_is_found_and_lag_is_not_mistaken_for_one() -> None:
    random = np.random.default_rng(0)
    steps = np.arange(500)[:, None] * CONTROL_PERIOD_S
    arrays = {name: np.zeros((500, size)) for name, size in column_sizes().items()}
    arrays["joint_position"][:, 16:] = 0.3 * np.sin(0.7 * steps + random.uniform(0.0, 6.0, 6))
    arrays["force_true_n"] = 10.0 * np.sin(1.5 * steps + np.array([0.0, 1.0, 2.0]))
    lag = 0.03 * np.gradient(arrays["force_true_n"], CONTROL_PERIOD_S, axis=0)
    bias = np.array([0.5, -0.3, 0.2]) + arrays["joint_position"][:, 16:] @ random.standard_normal((6, 3))
    arrays["adaptive.force"] = arrays["force_true_n"] - lag - bias
    rollout = Rollout({}, arrays)
    found = rollout_bias(rollout, wanted_force(rollout, TARGETS["hybrid"]))
    assert np.sqrt(((found - bias) ** 2).mean()) < 0.1 * np.sqrt((bias**2).mean())


def test_the_mean_follows_what_can_be_learned_and_the_variance_all_of_the_error() -> None:
    torch.manual_seed(0)
    noise = 0.2 * torch.randn(1000, 3)
    bias = 0.4 * torch.where(torch.rand(1000, 3) < 0.5, 1.0, -1.0)
    raw = torch.zeros(6, requires_grad=True)
    optimizer = torch.optim.Adam([raw], 0.05)
    for _ in range(150):
        optimizer.zero_grad()
        beta_likelihood(raw.expand(1000, 6), 1.0 + noise, 1.0 + noise + bias).backward()
        optimizer.step()
    assert raw[:3].detach().numpy() == pytest.approx(1.0, abs=0.05)
    assert np.exp(0.5 * raw[3:].detach().numpy()) == pytest.approx(np.sqrt(0.2**2 + 0.4**2), rel=0.1)


def test_the_likelihood_pulls_the_variance_to_the_right_one() -> None:
    torch.manual_seed(0)
    error = 0.5 * torch.randn(20_000, 3)
    slopes = []
    for sigma in (0.25, 0.5, 1.0):
        log_variance = torch.full((20_000, 3), 2.0 * float(np.log(sigma)), requires_grad=True)
        beta_likelihood(torch.cat([torch.zeros(20_000, 3), log_variance], dim=1), error, error, beta=0.0).backward()
        assert log_variance.grad is not None
        slopes.append(float(log_variance.grad.sum()))
    assert slopes[0] < 0.0 < slopes[2] and abs(slopes[1]) < 0.05 * slopes[2]


def test_smooth_l1_is_quadratic_below_one_and_linear_above() -> None:
    target = torch.zeros(1, 3)
    assert float(smooth_l1(torch.full((1, 3), 0.5), target)) == pytest.approx(0.125)
    assert float(smooth_l1(torch.full((1, 3), 3.0), target)) == pytest.approx(2.5)


def test_bad_data_is_refused(data: Path) -> None:
    arrays = made_up_rollout(0)
    arrays["force_true_n"][3, 1] = np.nan
    with pytest.raises(DatasetError, match=r"force_true_n.*not finite"):
        save_rollout(data / "rollouts/bad.npz", arrays)
    del arrays["force_true_n"]
    with pytest.raises(DatasetError, match="force_true_n"):
        save_rollout(data / "rollouts/bad.npz", arrays)
    with pytest.raises(DatasetError, match=r"collect_dataset"):
        load_split(data / "nowhere", "train")
    (data / "rollouts/0.npz").unlink()
    with pytest.raises(DatasetError, match="fills the gap"):
        load_split(data, "train")


def prediction(error: np.ndarray, nominal_error: np.ndarray | None = None, sigma: np.ndarray | None = None) -> Prediction:
    return Prediction(error, nominal_error, sigma, np.ones((len(error), 2)))


def test_a_correction_is_trusted_as_far_as_it_harms_no_kind_of_rollout() -> None:
    def cells(harmed: bool) -> Callable[[float], list[list[Prediction]]]:
        def predict_with(noise: float) -> list[list[Prediction]]:
            good, bad = 1.0 / (1.0 + noise), 0.1 / (1.0 + 100.0 * noise)
            helped = prediction(np.full((50, 3), 2.0 - good), np.full((50, 3), 2.0))
            worse = prediction(np.full((50, 3), 1.0 + harmed * (bad - 0.02)), np.ones((50, 3)))
            return [[helped], [worse]]

        return predict_with

    def worst(noise: float) -> float:
        return max(relative_error(cell) for cell in cells(harmed=True)(noise))

    assert choose_output_noise(cells(harmed=False)) == NOISES_N[0]
    assert choose_output_noise(cells(harmed=True)) == min(noise for noise in NOISES_N if worst(noise) <= 1.0)


def test_calibration_covers_light_and_heavy_robots_alike() -> None:
    random = np.random.default_rng(0)
    predictions = []
    for mass in np.tile([0.8, 1.0, 1.2], 4):
        drivers = np.column_stack([np.full(4000, mass), random.uniform(0.9, 1.1, 4000)])
        true_sigma = np.array([0.2, 0.3, 0.4]) * np.exp(1.5 * drivers[:, :1] - 0.5 * drivers[:, 1:])
        error = true_sigma * random.standard_normal((4000, 3))
        predictions.append(Prediction(error, None, np.full((4000, 3), 0.5), drivers))
    scale, slopes = calibrate(predictions)
    assert slopes == pytest.approx((1.5, -0.5), abs=0.15)
    for one in predictions[:3]:
        sigma = 0.5 * np.array(scale) * np.exp(one.drivers @ slopes)[:, None]
        assert (np.abs(one.error) <= 2.0 * sigma).mean(axis=0) == pytest.approx(COVERAGE, abs=0.012)
    with pytest.raises(ValueError, match="sigma"):
        calibrate([prediction(np.ones((5, 3)))])
