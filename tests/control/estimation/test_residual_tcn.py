"""The running network is causal, equals the full dilated network and PyTorch, and refuses weights that do not fit."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch.nn import functional

from control.estimation.networks.force_features import (
    GROUPS,
    HYBRID_GROUPS,
    PAPER_GROUPS,
    SIGMA_DRIVERS,
    feature_names,
    features,
    increment_columns,
    sigma_drivers,
)
from control.estimation.networks.force_network import NetworkManifest, SampleError, scale_outputs
from control.estimation.networks.force_signals import SIGNALS, derive
from control.estimation.networks.network_weights import WeightsError, load_network, save_network
from control.estimation.networks.residual_tcn import ResidualTcn, TcnShape, parameter_shapes
from control.learning.tcn_module import TcnModule
from control.timing import CONTROL_PERIOD_S

INCREMENT_GROUPS = ("nominal_force", "nominal_unexplained")
NETWORK_GROUPS = (*INCREMENT_GROUPS, "nominal_force_length")

SHAPES = [TcnShape(7, 3), TcnShape(64, 6), TcnShape(5, 3, history=9, width=12, kernel=2, dilations=(1, 2, 4), head=8)]


def random_parameters(shape: TcnShape, seed: int = 0) -> dict[str, np.ndarray]:
    random = np.random.default_rng(seed)
    return {
        name: (1.0 / np.sqrt(np.prod(size[1:])) * random.standard_normal(size)).astype(np.float32)
        for name, size in parameter_shapes(shape).items()
    }


def dense_network(shape: TcnShape, parameters: dict[str, np.ndarray], window: np.ndarray) -> np.ndarray:
    """The textbook network: every time step of every layer, (H, outputs)."""
    p = {name: torch.from_numpy(array) for name, array in parameters.items()}
    steps = torch.from_numpy(window.T)[None]
    for index, dilation in enumerate(shape.dilations):
        out, padding = steps, (dilation * (shape.kernel - 1), 0)
        for conv in ("conv1", "conv2"):
            weight, bias = p[f"blocks.{index}.{conv}.weight"], p[f"blocks.{index}.{conv}.bias"]
            out = torch.relu(functional.conv1d(functional.pad(out, padding), weight, bias, dilation=dilation))
        if f"blocks.{index}.skip.weight" in p:
            steps = functional.conv1d(steps, p[f"blocks.{index}.skip.weight"], p[f"blocks.{index}.skip.bias"])
        steps = torch.relu(out + steps)
    hidden = torch.relu(steps[0].T @ p["head.0.weight"].T + p["head.0.bias"])
    return (hidden @ p["head.1.weight"].T + p["head.1.bias"]).numpy()


@pytest.mark.parametrize("shape", SHAPES)
def test_it_equals_the_full_network_and_pytorch(shape: TcnShape) -> None:
    parameters = random_parameters(shape)
    network = ResidualTcn(shape, parameters)
    module = TcnModule(shape).eval()
    module.load_state_dict({name: torch.from_numpy(array) for name, array in parameters.items()})
    random = np.random.default_rng(1)
    for _ in range(3):
        window = random.standard_normal((shape.history, shape.inputs)).astype(np.float32)
        expected = dense_network(shape, parameters, window)[-1]
        np.testing.assert_allclose(network.predict(window.astype(float)), expected, atol=1e-5)
        with torch.no_grad():
            np.testing.assert_allclose(module(torch.from_numpy(window)[None])[0].numpy(), expected, atol=1e-5)


def test_the_network_is_causal_and_uses_its_whole_history() -> None:
    shape = SHAPES[0]
    parameters = random_parameters(shape)
    window = np.random.default_rng(2).standard_normal((shape.history, shape.inputs)).astype(np.float32)
    before = dense_network(shape, parameters, window)
    for step in range(shape.history):
        changed = window.copy()
        changed[step] += 1.0
        after = dense_network(shape, parameters, changed)
        np.testing.assert_array_equal(after[:step], before[:step])
        assert np.abs(after[-1] - before[-1]).max() > 1e-6
    network = ResidualTcn(shape, parameters)
    np.testing.assert_allclose(network.predict(window.astype(float)), before[-1], atol=1e-5)


@pytest.mark.parametrize("name", ["blocks.0.conv1.weight", "head.1.bias"])
def test_wrong_parameters_are_named(name: str) -> None:
    shape = SHAPES[0]
    parameters = random_parameters(shape)
    with pytest.raises(ValueError, match=name):
        ResidualTcn(shape, parameters | {name: np.zeros(2, np.float32)})
    del parameters[name]
    with pytest.raises(ValueError, match=f"{name}.*missing"):
        ResidualTcn(shape, parameters)


def random_signals(seed: int, count: int = 1) -> np.ndarray:
    random = np.random.default_rng(seed)
    signals = np.zeros(count, SIGNALS)
    for name in SIGNALS.names or ():
        signals[name] = random.standard_normal(signals[name].shape)
    derive(signals)
    return signals


def changed(signals: np.ndarray, **fields: np.ndarray) -> np.ndarray:
    signals = signals.copy()
    for name, value in fields.items():
        signals[name] = value
    derive(signals)
    return signals


@pytest.mark.parametrize("groups", [PAPER_GROUPS, HYBRID_GROUPS])
def test_features_of_many_steps_are_the_features_of_each(groups: tuple[str, ...]) -> None:
    steps = random_signals(3, 4)
    rows = features(groups, steps)
    assert rows.shape == (4, len(feature_names(groups)))
    for index in range(4):
        np.testing.assert_array_equal(features(groups, steps[index : index + 1])[0], rows[index])


def test_features_are_what_their_names_say() -> None:
    signals = random_signals(8)
    values = dict(zip(feature_names(tuple(GROUPS)), features(tuple(GROUPS), signals)[0], strict=True))
    one = signals[0]
    assert values["joint_position.arm_joint1"] == one.joint_position[16]
    assert values["joint_velocity.RR_wheel"] == one.joint_velocity[15]
    assert values["gravity_in_base.z"] == one.gravity_in_base[2]
    assert (values["gait_phase.sin"], values["gait_phase.cos"]) == (0.0, 1.0)
    assert values["mask.y"] == one.mask[1]
    assert values["nominal_force_length"] == pytest.approx(np.linalg.norm(one.nominal_force))
    assert values["nominal_wheel_force.FR.z"] == one.nominal_wheel_forces[5]
    assert values["nominal_residual.base_moment_x"] == one.nominal_residual[3]
    assert values["nominal_unexplained.FL_hip"] == one.nominal_unexplained[6]
    assert values["nominal_mass_scale.rest"] == one.nominal_mass_scale[1]


def test_wheel_angles_and_yaw_are_no_features() -> None:
    signals = random_signals(4)
    turned = signals["joint_position"].copy()
    turned[:, 12:16] += 100.0
    for groups in (PAPER_GROUPS, HYBRID_GROUPS):
        np.testing.assert_array_equal(features(groups, changed(signals, joint_position=turned)), features(groups, signals))


def saved_network(directory: Path, gaussian: bool = True) -> NetworkManifest:
    names = feature_names(NETWORK_GROUPS)
    shape = TcnShape(len(names), 6 if gaussian else 3)
    manifest = NetworkManifest(
        name="hybrid",
        nominal="adaptive",
        feature_groups=NETWORK_GROUPS,
        increment_groups=INCREMENT_GROUPS,
        feature_names=names,
        shape=shape,
        period_s=CONTROL_PERIOD_S,
        output_scale_n=1.5,
        output_limit_n=(2.0, 2.0, 2.0),
        output_noise_n=0.0,
        sigma_scale=(1.0, 1.1, 0.9) if gaussian else None,
        sigma_slopes=(2.0, 0.3) if gaussian else (),
        training={"command": "python -m ..."},
        metrics={"validation_rmse_vector_n": 0.5},
    )
    random = np.random.default_rng(5)
    normalization = {"feature_mean": random.standard_normal(len(names)), "feature_std": 0.5 + random.random(len(names))}
    save_network(directory, manifest, random_parameters(shape) | normalization)
    return manifest


def test_reloaded_weights_answer_the_same_and_keep_their_manifest(tmp_path: Path) -> None:
    manifest = saved_network(tmp_path)
    first, second = load_network("hybrid", tmp_path), load_network("hybrid", tmp_path)
    assert replace(first.manifest, sha256="") == manifest
    for seed in range(25):
        (force, sigma), (force2, sigma2) = first.step(random_signals(seed)), second.step(random_signals(seed))
        np.testing.assert_array_equal(force, force2)
        assert sigma is not None and sigma2 is not None
        np.testing.assert_array_equal(sigma, sigma2)
        assert (np.abs(force) <= 2.0).all() and (sigma > 0.0).all()


def test_missing_history_repeats_the_first_step(tmp_path: Path) -> None:
    saved_network(tmp_path)
    started, held = load_network("hybrid", tmp_path), load_network("hybrid", tmp_path)
    for _ in range(19):
        held.step(random_signals(0))
    np.testing.assert_array_equal(started.step(random_signals(0))[0], held.step(random_signals(0))[0])
    np.testing.assert_array_equal(started.step(random_signals(1))[0], held.step(random_signals(1))[0])
    started.reset()
    fresh = load_network("hybrid", tmp_path)
    np.testing.assert_array_equal(started.step(random_signals(2))[0], fresh.step(random_signals(2))[0])


def test_outputs_below_the_noise_vanish_and_large_ones_stay(tmp_path: Path) -> None:
    manifest = replace(saved_network(tmp_path), output_noise_n=0.1)
    raw = np.array([[1e-3, 0.1 / 1.5, 1.0, 0.0, 0.0, 0.0]])
    force = scale_outputs(raw.astype(np.float32), np.ones((1, SIGMA_DRIVERS)), manifest)[0][0]
    assert abs(force[0]) < 1e-6
    assert force[1] == pytest.approx(0.05)
    assert force[2] == pytest.approx(1.5, rel=0.005)


def test_sigma_follows_its_drivers_and_the_force_does_not(tmp_path: Path) -> None:
    manifest = saved_network(tmp_path)
    raw = np.array([[0.1, 0.2, 0.3, -1.0, 0.0, 1.0]] * 2)
    force, sigma = scale_outputs(raw.astype(np.float32), np.array([[0.0, -0.5], [0.1, 0.5]]), manifest)
    assert sigma is not None
    np.testing.assert_array_equal(force[0], force[1])
    np.testing.assert_allclose(sigma[1] / sigma[0], np.exp(2.0 * 0.1 + 0.3 * 1.0))


def test_a_force_that_changes_faster_has_the_larger_driver_and_its_level_does_not_matter() -> None:
    random = np.random.default_rng(7)
    increments = increment_columns(NETWORK_GROUPS, INCREMENT_GROUPS)
    windows, mass_scale = random.standard_normal((5, 20, len(increments))), random.uniform(0.8, 1.2, (5, 2))
    drivers = sigma_drivers(windows, increments, mass_scale)
    assert drivers.shape == (5, SIGMA_DRIVERS)
    np.testing.assert_allclose(drivers[:, 0], np.abs(np.diff(mass_scale)[:, 0]))
    faster = sigma_drivers(windows * (1.0 + increments), increments, mass_scale)[:, -1]
    assert (drivers[:, -1] < faster).all() and (faster < drivers[:, -1] + np.log(2.0)).all()
    other_levels = windows + 3.0 * (1.0 - increments)
    np.testing.assert_array_equal(sigma_drivers(other_levels, increments, mass_scale), drivers)
    assert np.isfinite(sigma_drivers(0.0 * windows, increments, mass_scale)).all()


def test_the_level_of_what_is_seen_as_change_does_not_matter(tmp_path: Path) -> None:
    saved_network(tmp_path)
    network, shifted = load_network("hybrid", tmp_path), load_network("hybrid", tmp_path)
    for seed in range(22):
        signals = random_signals(seed)
        other = changed(signals, nominal_unexplained=signals["nominal_unexplained"] + 7.0)
        np.testing.assert_allclose(network.step(signals)[0], shifted.step(other)[0], atol=1e-5)
    moved = changed(random_signals(30), nominal_unexplained=random_signals(30)["nominal_unexplained"] + 1.0)
    assert np.abs(network.step(random_signals(30))[0] - shifted.step(moved)[0]).max() > 1e-6


def test_an_extreme_input_is_clipped(tmp_path: Path) -> None:
    saved_network(tmp_path)
    network, other = load_network("hybrid", tmp_path), load_network("hybrid", tmp_path)
    signals = random_signals(6)
    np.testing.assert_array_equal(network.step(signals)[0], other.step(signals)[0])
    far = changed(signals, nominal_force=np.full(3, 1e3), nominal_unexplained=np.full(28, 1e3))
    farther = changed(signals, nominal_force=np.full(3, 1e6), nominal_unexplained=np.full(28, 1e6))
    np.testing.assert_array_equal(network.step(far)[0], other.step(farther)[0])


@pytest.mark.parametrize("broken", [np.nan, np.inf, -np.inf])
def test_a_step_that_is_not_finite_leaves_no_trace_in_the_window(tmp_path: Path, broken: float) -> None:
    saved_network(tmp_path)
    network, sound = load_network("hybrid", tmp_path), load_network("hybrid", tmp_path)
    for seed in range(30):
        force, _ = network.step(random_signals(seed))
        np.testing.assert_array_equal(force, sound.step(random_signals(seed))[0])
        with pytest.raises(SampleError, match=r"nominal_force\.y"):
            network.step(changed(random_signals(seed), nominal_force=np.array([1.0, broken, 1.0])))


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda m: m["feature_names"].reverse(), "features differ"),
        (lambda m: m["feature_names"].__setitem__(0, "joint_position.elbow"), "elbow"),
        (lambda m: m["feature_groups"].__setitem__(0, "smell"), "smell"),
        (lambda m: m["shape"].__setitem__("width", 32), "shape"),
        (lambda m: m.__setitem__("sha256", "0" * 64), "sha256"),
        (lambda m: m.__setitem__("schema", 0), "schema"),
        (lambda m: m.pop("nominal"), "nominal"),
        (lambda m: m["sigma_slopes"].pop(), r"hybrid\.json: sigma_slopes has 1 entries.*2 drivers.*residual_training"),
        (lambda m: m["sigma_slopes"].clear(), "sigma_slopes has 0 entries"),
    ],
)
def test_weights_that_do_not_fit_are_refused(tmp_path: Path, change, problem: str) -> None:
    saved_network(tmp_path)
    path = tmp_path / "hybrid.json"
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    with pytest.raises(WeightsError, match=problem):
        load_network("hybrid", tmp_path)


def test_a_damaged_or_missing_file_is_refused(tmp_path: Path) -> None:
    saved_network(tmp_path)
    weights = tmp_path / "hybrid.npz"
    weights.write_bytes(weights.read_bytes()[:-1] + b"x")
    with pytest.raises(WeightsError, match="sha256"):
        load_network("hybrid", tmp_path)
    weights.unlink()
    with pytest.raises(WeightsError, match="missing"):
        load_network("hybrid", tmp_path)
