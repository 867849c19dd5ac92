"""Why an estimate is mistrusted, and how much wider its sigma is then."""

from dataclasses import replace

import numpy as np
import pytest

from control.command.limits import DEFAULT_COMMAND
from control.estimation.mistrust import EstimatorFlag, Mistrust, MistrustConfig
from control.joints import ARM_SLICE, NOMINAL_POSITION
from control.robot_model import RobotModel
from control.types import ForceEstimate
from sim.backends.simulation.wrenches import Pulse
from sim.runtime.simulation import Simulation, SimulationConfig

FAR_M = 1.0
ESTIMATE = ForceEstimate(np.zeros(3), np.zeros((4, 3)), sigma_n=np.full(3, 0.2))


@pytest.fixture(scope="module")
def model() -> RobotModel:
    return RobotModel()


def judged(model: RobotModel, estimate: ForceEstimate = ESTIMATE, **changes):
    """Flags and sigma of a free arm in its nominal posture but for what is changed."""
    given = {"joint_position": NOMINAL_POSITION, "unexplained": np.zeros(28), "distance_m": FAR_M} | changes
    flags, judged_estimate = Mistrust(MistrustConfig(), model).judge(estimate, **given)
    return flags, np.asarray(judged_estimate.sigma_n)


def test_a_free_arm_is_trusted(model: RobotModel) -> None:
    flags, sigma = judged(model)
    assert flags == EstimatorFlag.NONE
    np.testing.assert_array_equal(sigma, 0.2)


def test_what_no_wrench_explains_widens_sigma_in_proportion(model: RobotModel) -> None:
    unexplained = np.zeros(28)
    unexplained[model.joint_rows[ARM_SLICE]] = 1.0
    flags, sigma = judged(model, unexplained=unexplained)
    assert flags == EstimatorFlag.CONTACT_ELSEWHERE
    assert sigma == pytest.approx(np.hypot(0.2, MistrustConfig().error_per_nm * np.sqrt(6.0)))


def test_a_stop_is_told_and_its_own_torque_is_no_contact(model: RobotModel) -> None:
    position, unexplained, joint = np.array(NOMINAL_POSITION), np.zeros(28), ARM_SLICE.start + 3
    position[joint] = model.position_upper[joint]
    unexplained[model.joint_rows[joint]] = 5.0
    flags, sigma = judged(model, joint_position=position, unexplained=unexplained)
    assert flags == EstimatorFlag.JOINT_AT_STOP
    assert (sigma > 0.5).all()


def test_an_arm_that_may_touch_the_robot_is_told(model: RobotModel) -> None:
    flags, sigma = judged(model, distance_m=0.001)
    assert flags == EstimatorFlag.SELF_CONTACT
    assert (sigma > 3.0).all()


def test_adapting_masses_are_a_reason_too(model: RobotModel) -> None:
    flags, _ = judged(model, replace(ESTIMATE, mass_adapting=True))
    assert flags == EstimatorFlag.MASS_ADAPTING


def test_a_push_on_the_forearm_is_told_from_one_on_the_hand() -> None:
    session = Simulation(SimulationConfig(seed=5))

    def flagged(body: str) -> float:
        """Share of ticks with the flag, while a body is pushed aside with 20 N."""
        session.backend.wrenches.add(Pulse(np.array([0.0, 20.0, 0.0]), 0.8, body=body, frame="world", ramp_s=0.1))
        flags = [session.tick(DEFAULT_COMMAND).estimator_flags for _ in range(400)][150:]
        for _ in range(400):
            session.tick(DEFAULT_COMMAND)
        return float(np.mean([EstimatorFlag.CONTACT_ELSEWHERE in flag for flag in flags]))

    for _ in range(500):
        session.tick(DEFAULT_COMMAND)
    assert flagged("end_effector") == 0.0
    assert flagged("arm_link3") > 0.9
