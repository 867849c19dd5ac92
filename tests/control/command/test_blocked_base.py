"""A base that does not move where it is driven: the driving ends, until less or the other way is asked for."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from control.command.blocked_base import BlockedBase, BlockedBaseConfig
from control.command.limits import DEFAULT_COMMAND
from control.faults import Fault
from control.timing import CONTROL_PERIOD_S
from control.types import Command
from sim.trials.trial import Trial, TrialSetup

CONFIG = BlockedBaseConfig()
AHEAD = np.array([0.3, 0.0, 0.0])
STILL = np.zeros(3)


def drive(velocity: np.ndarray) -> Command:
    return replace(DEFAULT_COMMAND, base_velocity=velocity)


def after(
    watch: BlockedBase, asked: np.ndarray, measured: np.ndarray, way: float, rolled: np.ndarray | None = None
) -> np.ndarray:
    """Base velocity that is left when the base should have gone `way`; its wheels do not slip unless said."""
    rolled = measured if rolled is None else rolled
    for _ in range(round(way / np.abs(asked).max() / CONTROL_PERIOD_S)):
        watch.step(asked, asked, asked, measured, rolled, CONTROL_PERIOD_S)
    return watch.free(asked)


def asking(watch: BlockedBase, asked: np.ndarray, relieved: np.ndarray | None = None) -> np.ndarray:
    """Base velocity that is left of what is asked for while the base stands."""
    drive = asked if relieved is None else relieved
    watch.step(asked, drive, STILL, STILL, STILL, CONTROL_PERIOD_S)
    return watch.free(drive)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("axis", [0, 2])
def test_a_base_that_stands_stops_driving_and_may_go_back(axis: int, sign: float) -> None:
    watch, asked = BlockedBase(CONFIG), np.zeros(3)
    asked[axis] = 0.4 * sign
    assert np.array_equal(after(watch, asked, STILL, 0.8 * CONFIG.way[axis]), asked)
    assert np.array_equal(after(watch, asked, STILL, 0.6 * CONFIG.way[axis]), STILL)
    assert np.array_equal(asking(watch, asked), STILL), "it stays stopped"
    assert np.array_equal(asking(watch, -asked), -asked)
    assert np.array_equal(asking(watch, asked), asked), "tried again"


def test_standing_under_a_load_may_drive_back_and_does_not_try_again() -> None:
    watch = BlockedBase(CONFIG)
    after(watch, AHEAD, STILL, 0.2)
    assert np.array_equal(asking(watch, AHEAD, -AHEAD), -AHEAD)
    assert np.array_equal(asking(watch, AHEAD), STILL)


def test_driving_stops_where_it_is_blocked_and_turning_goes_on() -> None:
    both = np.array([0.3, 0.0, 0.3])
    assert np.array_equal(after(BlockedBase(CONFIG), both, np.array([0.0, 0.0, 0.25]), 0.2), [0.0, 0.0, 0.3])


@pytest.mark.parametrize("measured", [AHEAD, 0.6 * AHEAD], ids=["as asked", "slower"])
def test_a_base_that_moves_drives_on(measured: np.ndarray) -> None:
    assert np.array_equal(after(BlockedBase(CONFIG), AHEAD, measured, 3.0), AHEAD)


def test_slow_wheels_are_believed_and_fast_ones_may_spin() -> None:
    slow, off = 0.4 * AHEAD, 0.4 * AHEAD - [0.07, 0.0, 0.0]
    assert np.array_equal(after(BlockedBase(CONFIG), slow, off, 3.0, rolled=slow), slow)
    assert np.array_equal(after(BlockedBase(CONFIG), slow, slow, 0.2, rolled=STILL), STILL)
    assert np.array_equal(after(BlockedBase(CONFIG), AHEAD, STILL, 0.2, rolled=AHEAD), STILL)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_base_that_is_turned_about_a_caught_wheel_stops(sign: float) -> None:
    turned = AHEAD + np.array([0.0, 0.0, sign])
    assert np.array_equal(after(BlockedBase(CONFIG), AHEAD, turned, 0.15), STILL)
    scrubbing = np.array([0.3, 0.0, 0.3 * sign])
    assert np.array_equal(after(BlockedBase(CONFIG), AHEAD, scrubbing, 3.0), AHEAD)


def upright(trial: Trial) -> float:
    """Cosine of the tilt."""
    w, x, y, z = trial.truth.base_orientation_wxyz
    return w * w - x * x - y * y + z * z


@pytest.mark.slow
@pytest.mark.parametrize(("ahead_mps", "turn_rps", "seconds"), [(0.4, 0.2, 5.0), (0.12, 0.0, 12.0)])
def test_a_robot_that_is_driven_against_a_board_stands_upright_and_says_so(
    ahead_mps: float, turn_rps: float, seconds: float
) -> None:
    trial, told = Trial(TrialSetup(), seed=614, scene="board"), Fault.NONE
    for _ in trial.run(drive(np.array([ahead_mps, 0.0, turn_rps])), seconds):
        told |= trial.session.output.safety.faults
        assert upright(trial) > np.cos(np.radians(12.0))
    assert Fault.BASE_BLOCKED in told
    stood = trial.truth.base_position[0]
    for _ in trial.run(drive(np.array([-0.3, 0.0, 0.0])), 2.0):
        pass
    assert trial.truth.base_position[0] < stood - 0.3, "it drives back"
    assert Fault.BASE_BLOCKED not in trial.session.output.safety.faults


@pytest.mark.slow
def test_a_robot_that_backs_one_leg_into_a_box_stands_upright_and_says_so() -> None:
    trial, told = Trial(TrialSetup(), seed=614, scene="box"), Fault.NONE
    data, model = trial.session.backend.data, trial.session.backend.model
    data.qpos[:7] += [-0.3, 0.3, 0.0, -1.0, 0.0, 0.0, 1.0]  # facing away from the box
    mujoco.mj_forward(model, data)
    for _ in trial.run(DEFAULT_COMMAND, 1.5):
        pass
    for _ in trial.run(drive(np.array([-0.6, 0.0, 0.0])), 5.0):
        told |= trial.session.output.safety.faults
        assert upright(trial) > np.cos(np.radians(12.0))
    assert Fault.BASE_BLOCKED in told
