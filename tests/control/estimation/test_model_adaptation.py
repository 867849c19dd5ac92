"""Adaptation against data that obeys its own model r = B x - N beta - F phi."""

import numpy as np
import pytest

from control.estimation.model_adaptation import (
    ARM,
    FRICTIONS,
    MASSES,
    PARAMETER_COUNT,
    REST,
    ModelAdaptation,
    ModelAdaptationConfig,
    correct_residual,
    friction_groups,
)
from control.estimation.wrench_projection import ProjectionWeights
from control.joints import ARM_SLICE, JOINT_COUNT, NOMINAL_POSITION
from control.robot_model import RobotModel
from control.timing import CONTROL_PERIOD_S

FREE_N = 0.0
"""Force on the hand that leaves every instant its full weight."""

WEIGHTS = ProjectionWeights(support_cost=1e-6, force_cost=1e-6)


class Recording:
    """Random postures and joint velocities of a robot whose masses differ by beta and whose frictions differ by phi, with a
    random force at the end effector."""

    def __init__(self, beta: tuple[float, float], phi: float | np.ndarray = 0.0, seed: int = 0, noise: float = 0.05) -> None:
        self.model = RobotModel()
        self._theta = np.zeros(PARAMETER_COUNT)
        self._theta[MASSES] = beta
        self._theta[FRICTIONS] = phi
        self._rng = np.random.default_rng(seed)
        self._noise = noise
        self._rows, self._costs = WEIGHTS.rows(self.model), WEIGHTS.costs()

    def feed(self, adaptation: ModelAdaptation, count: int) -> None:
        model, rng = self.model, self._rng
        still = np.zeros(3)
        for _ in range(count):
            position = NOMINAL_POSITION + np.r_[np.zeros(16), 0.3 * rng.normal(size=6)]
            model.update(np.eye(3), position, still, still, np.zeros(JOINT_COUNT))
            arm = model.arm_gravity
            friction = np.zeros(28)
            friction[model.joint_rows] = 0.3 * rng.choice([-1.0, 1.0], size=JOINT_COUNT)
            forces, groups = np.column_stack([arm, model.gravity - arm, friction]), friction_groups(model)
            scale = 1 + self._theta[MASSES]
            weight = scale[REST] * (model.total_mass - model.arm_mass) + scale[ARM] * model.arm_mass
            wrench = np.zeros(18)
            wrench[2:12:3] = weight * 9.81 / 4
            wrench[12:15] = 8.0 * rng.normal(size=3)
            missing = np.empty(28)
            correct_residual(np.zeros(28), forces, groups, self._theta, missing)
            residual = model.wrench_jacobian.T @ wrench - missing + self._noise * rng.normal(size=28)
            adaptation.update(model.wrench_jacobian, residual, self._rows, self._costs, forces, groups, FREE_N)


@pytest.mark.parametrize("beta", [(0.0, 0.0), (0.2, 0.2), (-0.2, -0.2), (0.25, -0.1), (-0.15, 0.1)])
def test_both_scales_are_found_under_an_unknown_force(beta: tuple[float, float]) -> None:
    adaptation = ModelAdaptation(ModelAdaptationConfig(memory_s=60.0))
    Recording(beta).feed(adaptation, 1000)
    np.testing.assert_allclose(adaptation.parameters[MASSES], beta, atol=0.03)


@pytest.mark.parametrize("phi", [0.0, 0.5, -0.4])
def test_frictions_are_found_beside_the_masses_under_an_unknown_force(phi: float) -> None:
    adaptation = ModelAdaptation(ModelAdaptationConfig(memory_s=60.0))
    each = phi + np.linspace(-0.2, 0.2, 7)
    Recording((0.1, -0.1), each).feed(adaptation, 1500)
    np.testing.assert_allclose(adaptation.parameters[MASSES], [0.1, -0.1], atol=0.03)
    np.testing.assert_allclose(adaptation.parameters[FRICTIONS], each, atol=0.12)


def test_friction_never_drives_a_joint() -> None:
    config = ModelAdaptationConfig()
    adaptation = ModelAdaptation(config)
    Recording((0.0, 0.0), -3.0).feed(adaptation, 500)
    np.testing.assert_allclose(adaptation.parameters[FRICTIONS], -config.friction_limit)


def test_every_joint_belongs_to_one_friction_group() -> None:
    model = RobotModel()
    groups = friction_groups(model)
    np.testing.assert_array_equal(groups[:6], -1)
    np.testing.assert_array_equal(groups[model.joint_rows[ARM_SLICE]], np.arange(6))
    np.testing.assert_array_equal(groups[model.joint_rows[: ARM_SLICE.start]], 6)


def test_a_robot_that_changes_is_noticed() -> None:
    adaptation = ModelAdaptation(ModelAdaptationConfig(memory_s=4.0))
    Recording((0.0, 0.0)).feed(adaptation, 500)
    Recording((0.3, 0.3), seed=1).feed(adaptation, 1000)
    np.testing.assert_allclose(adaptation.parameters[MASSES], 0.3, atol=0.05)


def test_the_masses_count_as_moving_until_they_rest_and_again_when_the_robot_changes() -> None:
    adaptation = ModelAdaptation(ModelAdaptationConfig())
    assert adaptation.moving  # nothing is known yet
    Recording((0.0, 0.0)).feed(adaptation, 500)
    assert not adaptation.moving
    changed = Recording((0.2, 0.2), seed=1)
    changed.feed(adaptation, 50)
    assert adaptation.moving
    changed.feed(adaptation, 1500)
    assert not adaptation.moving
    np.testing.assert_allclose(adaptation.parameters[MASSES], 0.2, atol=0.05)
    adaptation.reset()
    assert adaptation.moving


def test_nothing_is_learned_before_the_observer_has_settled() -> None:
    config = ModelAdaptationConfig()
    adaptation = ModelAdaptation(config)
    recording = Recording((0.2, 0.2))
    recording.feed(adaptation, round(config.settle_s / CONTROL_PERIOD_S) - 1)
    np.testing.assert_array_equal(adaptation.parameters, 0.0)
    recording.feed(adaptation, 5)
    assert adaptation.parameters[REST] > 0.05


def test_without_information_the_prior_returns() -> None:
    adaptation = ModelAdaptation(ModelAdaptationConfig(memory_s=0.5))
    recording = Recording((0.2, 0.2))
    recording.feed(adaptation, 100)
    assert adaptation.parameters[REST] > 0.15
    rows, costs = WEIGHTS.rows(recording.model), WEIGHTS.costs()
    nothing, groups = np.zeros(28), friction_groups(recording.model)
    for _ in range(500):
        adaptation.update(recording.model.wrench_jacobian, nothing, rows, costs, np.zeros((28, 3)), groups, FREE_N)
    np.testing.assert_allclose(adaptation.parameters, 0.0, atol=1e-3)


def beta_after_pressing(force_n: float) -> np.ndarray:
    """Beta of a robot that presses with 20 N for 10 s, the force acting 2 cm below its modelled point."""
    model, adaptation = RobotModel(), ModelAdaptation(ModelAdaptationConfig())
    model.update(np.eye(3), NOMINAL_POSITION, np.zeros(3), np.zeros(3), np.zeros(JOINT_COUNT))
    arm = model.arm_gravity
    forces = np.column_stack([arm, model.gravity - arm, np.zeros(28)])
    wrench = np.zeros(18)
    wrench[2:12:3] = model.total_mass * 9.81 / 4
    wrench[12:15] = force = np.array([-20.0, 0.0, 20.0])
    wrench[15:] = np.cross([0.0, 0.0, -0.02], force)
    residual = model.wrench_jacobian.T @ wrench
    rows, costs, groups = WEIGHTS.rows(model), WEIGHTS.costs(), friction_groups(model)
    for _ in range(500):
        adaptation.update(model.wrench_jacobian, residual, rows, costs, forces, groups, force_n)
    return adaptation.parameters


def test_a_contact_off_its_modelled_point_is_hardly_taken_for_mass() -> None:
    trusting = np.abs(beta_after_pressing(FREE_N)[ARM])
    wary = np.abs(beta_after_pressing(28.0)[ARM])
    assert trusting > 0.05
    assert wary < 0.5 * trusting


def test_a_robot_that_hangs_is_not_taken_for_weightless() -> None:
    config = ModelAdaptationConfig()
    adaptation = ModelAdaptation(config)
    Recording((-1.0, -1.0)).feed(adaptation, 300)
    np.testing.assert_allclose(adaptation.parameters[MASSES], -config.limit)


def test_reset_forgets() -> None:
    adaptation = ModelAdaptation(ModelAdaptationConfig())
    Recording((0.2, 0.2)).feed(adaptation, 100)
    adaptation.reset()
    np.testing.assert_array_equal(adaptation.parameters, 0.0)


def test_scales_must_be_positive() -> None:
    with pytest.raises(ValueError, match="memory_s"):
        ModelAdaptationConfig(memory_s=0.0)


def test_arm_gravity_is_what_the_arm_adds() -> None:
    """The arm loads only its own joints and the base: there it is its weight, at the arm's centre of mass."""
    model = RobotModel()
    model.update(np.eye(3), NOMINAL_POSITION, np.zeros(3), np.zeros(3), np.zeros(JOINT_COUNT))
    arm = model.arm_gravity
    np.testing.assert_allclose(arm[:3], [0, 0, model.arm_mass * 9.81], atol=1e-9)
    arm_rows = model.joint_rows[16:]
    np.testing.assert_allclose(arm[arm_rows], model.gravity[arm_rows], atol=1e-12)
    np.testing.assert_allclose(arm[model.joint_rows[:16]], 0, atol=1e-12)
    assert 3.5 < model.arm_mass < 4.5
