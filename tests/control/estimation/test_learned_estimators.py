"""Learned estimators: exactly the nominal estimate plus the network's correction, at 50 Hz, without side effects."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from control.estimation.base_state import BaseStateConfig, BaseStateEstimator
from control.estimation.force_estimator import EstimatorInput
from control.estimation.networks.force_features import HYBRID_GROUPS, PAPER_GROUPS, feature_names
from control.estimation.networks.force_network import ForceNetwork, NetworkManifest, SampleError
from control.estimation.networks.force_signals import signals_at
from control.estimation.networks.learned_estimators import LearnedEstimator
from control.estimation.networks.network_weights import WeightsError, load_network, save_network
from control.estimation.networks.residual_tcn import TcnShape, parameter_shapes
from control.estimation.projecting_estimator import ProjectingEstimator
from control.estimation.registry import LEARNED_NAMES, MODEL_BASED_NAMES, EstimatorsConfig, make_estimators
from control.joints import JOINT_COUNT, NOMINAL_POSITION
from control.robot_model import RobotModel
from control.timing import CONTROL_PERIOD_S, SLOT_COUNT, TICK_S, Job, slots
from control.types import SensorFrame


def save(directory: Path, name: str, nominal: str | None, groups: tuple[str, ...], scale: float) -> None:
    names = feature_names(groups)
    gaussian = name == "hybrid"
    shape = TcnShape(len(names), 6 if gaussian else 3)
    random = np.random.default_rng(0)
    arrays = {key: scale * random.standard_normal(size) for key, size in parameter_shapes(shape).items()}
    arrays |= {"feature_mean": np.zeros(len(names)), "feature_std": np.full(len(names), 10.0)}
    sigma, slopes = ((1.0, 1.0, 1.0), (0.5, 0.3)) if gaussian else (None, ())
    limit = (5.0, 5.0, 5.0)
    manifest = NetworkManifest(name, nominal, groups, (), names, shape, CONTROL_PERIOD_S, 2.0, limit, 0.0, sigma, slopes)
    save_network(directory, manifest, arrays)


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    save(tmp_path, "tcn", None, PAPER_GROUPS, 0.1)
    save(tmp_path, "hybrid_paper", "gmo_cqp", PAPER_GROUPS, 0.1)
    save(tmp_path, "hybrid", "adaptive", HYBRID_GROUPS, 0.1)
    return tmp_path


class Robot:
    """A standing robot with noisy sensors, one tick at a time."""

    def __init__(self) -> None:
        self.model = RobotModel()
        self._base_state = BaseStateEstimator(BaseStateConfig(), self.model)
        self._random = np.random.default_rng(3)
        self._time = 0.0

    def tick(self) -> EstimatorInput:
        noise = self._random.standard_normal
        self._time += TICK_S
        sensor = SensorFrame(
            time_s=self._time,
            orientation_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
            angular_velocity=0.01 * noise(3),
            linear_acceleration=np.array([0.0, 0.0, 9.81]) + 0.05 * noise(3),
            joint_position=NOMINAL_POSITION + 1e-3 * noise(JOINT_COUNT),
            joint_velocity=0.02 * noise(JOINT_COUNT),
            joint_torque=0.1 * noise(JOINT_COUNT),
        )
        base = self._base_state.step(sensor)
        velocities = base.linear_velocity_in_base, base.angular_velocity_in_base
        self.model.update(base.rotation_base_to_world, sensor.joint_position, *velocities, sensor.joint_velocity)
        return EstimatorInput(round(self._time / TICK_S) - 1, self.model, sensor, base)


def test_all_networks_run_and_a_missing_one_is_said_with_its_cure(weights: Path) -> None:
    model = RobotModel()
    assert tuple(make_estimators(model, EstimatorsConfig(weights=None))) == MODEL_BASED_NAMES
    assert tuple(make_estimators(model, EstimatorsConfig(weights=weights))) == MODEL_BASED_NAMES + LEARNED_NAMES
    (weights / "tcn.npz").unlink()
    with pytest.raises(WeightsError, match=r"tcn.npz.*missing.*residual_training"):
        make_estimators(model, EstimatorsConfig(weights=weights))


@pytest.mark.parametrize("name", LEARNED_NAMES)
def test_the_estimate_is_the_nominal_one_plus_the_networks(weights: Path, name: str) -> None:
    robot = Robot()
    estimators = make_estimators(robot.model, EstimatorsConfig(weights=weights))
    network = load_network(name, weights)
    nominal = estimators["gmo_cqp" if name == "hybrid_paper" else "adaptive"]
    assert isinstance(nominal, ProjectingEstimator)
    for tick in range(35):
        inputs = robot.tick()
        for estimator in (nominal, estimators[name]):
            estimator.observe(inputs)
        if tick % 10 == 4:
            base = nominal.estimate()
            correction, sigma = network.step(signals_at(inputs, nominal, base))
            estimate = estimators[name].estimate()
            expected = correction if name == "tcn" else base.force_estimated_n + correction
            np.testing.assert_array_equal(estimate.force_estimated_n, expected)
            assert (estimate.sigma_n is None) == (sigma is None) == (name != "hybrid")
            np.testing.assert_array_equal(estimate.wheel_forces_in_heading, base.wheel_forces_in_heading)


def test_between_network_steps_the_correction_holds_and_the_nominal_part_does_not(weights: Path) -> None:
    robot = Robot()
    estimators = make_estimators(robot.model, EstimatorsConfig(weights=weights))
    adaptive, hybrid = estimators["adaptive"], estimators["hybrid"]
    corrections, nominals = [], []
    for _ in range(30):
        hybrid.observe(robot.tick())
        nominals.append(adaptive.estimate().force_estimated_n)
        corrections.append(hybrid.estimate().force_estimated_n - nominals[-1])
    (second,) = slots(Job.NETWORK_STEP)
    for start, stop in ((0, second), (second, second + 10), (second + 10, second + 20)):
        block = np.array(corrections[start:stop])
        assert np.abs(block - block[0]).max() < 1e-9
        assert np.abs(corrections[stop] - block[0]).max() > 1e-6
    assert np.abs(np.diff(nominals, axis=0)).min(axis=0).max() > 0.0


def test_a_network_moves_to_its_slot_when_every_tick_asks_and_back_when_few_do(weights: Path, monkeypatch) -> None:
    robot = Robot()
    hybrid = make_estimators(robot.model, EstimatorsConfig(weights=weights))["hybrid"]
    stepped: list[int] = []
    step = ForceNetwork.step
    monkeypatch.setattr(ForceNetwork, "step", lambda self, signals: (stepped.append(tick), step(self, signals))[1])
    own, selected = 7, range(33, 72)
    for tick in range(100):
        hybrid.observe(robot.tick())
        if tick in selected or tick % SLOT_COUNT == own:
            hybrid.estimate()
    (slot,) = slots(Job.NETWORK_STEP)
    assert stepped == [7, 17, 27, 30 + slot, 40 + slot, 50 + slot, 60 + slot, 87, 97]
    assert np.diff(stepped).min() > SLOT_COUNT // 2


def test_sharing_a_nominal_estimator_does_not_disturb_it(weights: Path) -> None:
    alone_robot, shared_robot = Robot(), Robot()
    alone = make_estimators(alone_robot.model, EstimatorsConfig(weights=None))
    shared = make_estimators(shared_robot.model, EstimatorsConfig(weights=weights))
    for tick in range(400):
        for robot, estimators in ((alone_robot, alone), (shared_robot, shared)):
            inputs = robot.tick()
            for estimator in estimators.values():
                estimator.observe(inputs)
        if tick % 100 == 50:
            for name in LEARNED_NAMES:
                shared[name].estimate()
    for name in MODEL_BASED_NAMES:
        ours, theirs = shared[name].estimate(), alone[name].estimate()
        np.testing.assert_array_equal(ours.force_estimated_n, theirs.force_estimated_n)
        assert ours.mass_scale == theirs.mass_scale


@pytest.mark.parametrize("name", ["tcn", "hybrid_paper"])
def test_a_broken_frame_at_a_networks_step_holds_its_force_says_so_and_is_forgotten_at_the_next_step(
    weights: Path, name: str
) -> None:
    robot = Robot()
    learned = make_estimators(robot.model, EstimatorsConfig(weights=weights))[name]
    estimates = []
    for tick in range(40):
        inputs = robot.tick()
        if tick == 20:
            broken = inputs.sensor.joint_velocity.copy()
            broken[3] = np.nan
            inputs = replace(inputs, sensor=replace(inputs.sensor, joint_velocity=broken))
        learned.observe(inputs)
        if tick % 10 == 0:
            estimates.append(learned.estimate())
    assert [estimate.stale for estimate in estimates] == [False, False, True, False]
    if name == "tcn":
        np.testing.assert_array_equal(estimates[2].force_estimated_n, estimates[1].force_estimated_n)
    assert all(np.isfinite(estimate.force_estimated_n).all() for estimate in estimates)


def test_a_network_whose_first_step_is_broken_gives_no_estimate_and_starts_with_the_next(weights: Path) -> None:
    robot = Robot()
    tcn = make_estimators(robot.model, EstimatorsConfig(weights=weights))["tcn"]
    tcn.observe(replace(robot.tick(), mask=np.full(3, np.nan)))
    with pytest.raises(SampleError, match="mask"):
        tcn.estimate()
    tcn.observe(robot.tick())
    assert not tcn.estimate().stale


def test_reset_forgets_the_window(weights: Path) -> None:
    first, second = Robot(), Robot()
    used = make_estimators(first.model, EstimatorsConfig(weights=weights))["hybrid"]
    for _ in range(25):
        used.observe(first.tick())
        used.estimate()
    used.reset()
    with pytest.raises(RuntimeError, match="observe"):
        used.estimate()
    again = Robot()
    fresh = make_estimators(second.model, EstimatorsConfig(weights=weights))["hybrid"]
    for _ in range(25):
        inputs = second.tick()
        fresh.observe(inputs)
        used.observe(replace(again.tick(), model=second.model))
        np.testing.assert_array_equal(used.estimate().force_estimated_n, fresh.estimate().force_estimated_n)


def test_a_network_that_says_zero_changes_nothing(weights: Path) -> None:
    save(weights, "hybrid", "adaptive", HYBRID_GROUPS, 0.0)
    robot = Robot()
    estimators = make_estimators(robot.model, EstimatorsConfig(weights=weights))
    hybrid = estimators["hybrid"]
    assert isinstance(hybrid, LearnedEstimator)
    for _ in range(12):
        hybrid.observe(robot.tick())
    np.testing.assert_array_equal(hybrid.estimate().force_estimated_n, estimators["adaptive"].estimate().force_estimated_n)


@pytest.mark.parametrize("name", LEARNED_NAMES)
def test_shipped_weights_fit_this_code(name: str) -> None:
    assert load_network(name).manifest.name == name


def test_the_shipped_hybrid_is_not_worse_than_its_nominal_estimate_on_any_kind_of_validation_rollout() -> None:
    for kind, cell in load_network("hybrid").manifest.metrics["cells"].items():
        assert cell["rmse_vector_n"] <= cell["nominal_rmse_vector_n"], kind
