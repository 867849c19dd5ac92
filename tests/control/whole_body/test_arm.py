"""The arm's law: hand tracking, force regulation, borders and ends."""

from dataclasses import replace

import numpy as np
import pytest

from control.command.limits import CommandLimits
from control.joints import ARM_SLICE, DAMPING, TORQUE_LIMIT
from control.kernels.records import packed
from control.robot_model import RobotModel
from control.whole_body.arm import ARM, ArmConfig, border_hold, way_back
from control.whole_body.model_based import ModelBasedConfig
from tests.control.whole_body.standing import Law, arm_torque, correction_of, hand_command, inputs


@pytest.fixture
def model():
    return RobotModel()


@pytest.mark.parametrize("tilt", [0.0, 0.2, -0.2])
def test_an_arm_at_its_target_carries_its_weight_and_nothing_else(model, tilt):
    tick = inputs(model, tilt=tilt)
    tick = replace(tick, command=hand_command(tick))
    assert np.allclose(arm_torque(tick), model.gravity[model.joint_rows[ARM_SLICE]], atol=1e-9)


def test_a_commanded_force_is_fed_forward_through_the_jacobian(model):
    tick = inputs(model)
    rest = arm_torque(replace(tick, command=hand_command(tick)))
    force = np.array([6.0, -4.0, 15.0])
    pressing = replace(tick, command=hand_command(tick, mask=np.ones(3), force_n=force), force_estimated_n=force)
    jacobian = model.end_effector_jacobian[:3, model.joint_rows[ARM_SLICE]]
    assert np.allclose(arm_torque(pressing) - rest, -jacobian.T @ force, atol=1e-9)


def test_a_correction_moves_position_axes_presses_force_axes_and_turns_the_hand(model):
    tick = inputs(model)
    mask = np.array([0.0, 0.0, 1.0])
    pressed = 10.0 * mask
    tick = replace(tick, command=hand_command(tick, mask=mask, force_n=pressed), force_estimated_n=pressed)
    velocity, force, turn = np.array([0.03, -0.02, 0.04]), np.array([5.0, 4.0, -3.0]), np.array([0.1, -0.05, 0.08])
    config = replace(ArmConfig(), damping=1e-6)
    plain, corrected = (Law(RobotModel(), ModelBasedConfig(arm=config)) for _ in range(2))
    correction = correction_of(hand_velocity=velocity, hand_force=force, hand_angular_velocity=turn)
    added = corrected.arm_torque(tick, correction) - plain.arm_torque(tick)
    rows = model.joint_rows[ARM_SLICE]
    jacobian, inertia = model.end_effector_jacobian[:, rows], model.mass_matrix[np.ix_(rows, rows)]
    added -= jacobian[:3].T @ (mask * force)
    joint_velocity = np.linalg.solve(config.velocity_gain * inertia + np.diag(DAMPING[ARM_SLICE]), added)
    assert np.allclose(jacobian @ joint_velocity, np.concatenate([(1.0 - mask) * velocity, turn]), atol=1e-6)


def test_a_force_axis_pushes_harder_while_the_estimate_is_too_low(model):
    tick = inputs(model)
    command = hand_command(tick, mask=np.array([0.0, 0.0, 1.0]), force_n=np.array([0.0, 0.0, 10.0]))
    law = Law(RobotModel())
    low = replace(tick, command=command, force_estimated_n=np.array([0.0, 0.0, 4.0]))
    jacobian = model.end_effector_jacobian[2, model.joint_rows[ARM_SLICE]]
    first = law.arm_torque(low)
    assert (first - model.gravity[model.joint_rows[ARM_SLICE]]) @ jacobian < 0.0
    later = first
    for _ in range(20):
        later = law.arm_torque(low)
    assert (later - first) @ jacobian < 0.0


def test_before_contact_a_force_axis_approaches_instead_of_pushing(model):
    tick = inputs(model)
    command = hand_command(tick, mask=np.array([0.0, 0.0, 1.0]), force_n=np.array([0.0, 0.0, 20.0]))
    rows = model.joint_rows[ARM_SLICE]
    inertia = model.mass_matrix[np.ix_(rows, rows)]
    change = arm_torque(replace(tick, command=command)) - model.gravity[rows]
    # Where the torque would take the hand from rest: down, and neither ahead nor aside as a bare J^T F would.
    config = ArmConfig()
    asked = np.linalg.solve(config.velocity_gain * inertia + np.diag(DAMPING[ARM_SLICE]), change)
    hand_velocity = model.end_effector_jacobian[:3, rows] @ asked
    assert hand_velocity == pytest.approx([0.0, 0.0, -config.approach_speed_limit_mps], abs=0.05)


def test_a_position_axis_carries_most_of_an_estimated_load(model):
    tick = inputs(model)
    tick = replace(tick, command=hand_command(tick))
    load = np.array([5.0, 0.0, -5.0])
    change = arm_torque(replace(tick, force_estimated_n=load)) - arm_torque(tick)
    jacobian = model.end_effector_jacobian[:3, model.joint_rows[ARM_SLICE]]
    assert np.allclose(change, -ArmConfig().load_gain * jacobian.T @ load, atol=1e-9)


def test_a_hand_error_is_approached_at_a_limited_speed(model):
    tick = inputs(model)
    far = hand_command(tick)
    far = replace(far, position_m=far.position_m + np.array([0.0, 2.0, 0.0]))
    torque = arm_torque(replace(tick, command=far))
    assert np.all(np.abs(torque) <= TORQUE_LIMIT[ARM_SLICE])
    assert np.abs(torque - model.gravity[model.joint_rows[ARM_SLICE]]).max() < 20.0


class Borders:
    """The borders of where a hand yields."""

    def __init__(self):
        config, limits = ArmConfig(), CommandLimits()
        box = np.transpose([limits.position_x_m, limits.position_y_m, limits.position_z_m])
        bounds = {"lower": -1.0, "upper": 1.0, "workspace": box, "shoulder": limits.shoulder_m, "reach": limits.reach_m}
        self._arm, self.shoulder = packed(ARM, config, **bounds)[0], np.array(limits.shoulder_m)
        self.box = np.transpose([config.yield_x_m, config.yield_y_m, config.yield_z_m])
        self.nearest_m, self.farthest_m = config.nearest_m, limits.reach_m

    def back(self, hand, anchor=None, force=(0.0, 0.0, 0.0)):
        back = np.empty(3)
        hand = np.array(hand)
        way_back(self._arm, np.array(force), hand if anchor is None else np.array(anchor), hand, back)
        return back

    def inside(self, hand):
        """Whether a hand is in the box and at a distance from the shoulder that the arm likes."""
        boxed = (hand >= self.box[0] - 1e-9).all() and (hand <= self.box[1] + 1e-9).all()
        return bool(boxed and self.nearest_m <= np.linalg.norm(hand - self.shoulder) <= self.farthest_m)


INSIDE = np.array([0.55, 0.05, 0.5])


def test_a_hand_yields_freely_within_its_borders_and_is_led_back_into_the_box_from_beyond():
    borders, random = Borders(), np.random.default_rng(3)
    for hand in random.uniform((0.3, -0.4, 0.3), (0.8, 0.4, 0.75), (300, 3)):
        back = borders.back(hand, INSIDE)
        if borders.inside(hand):
            assert not back.any()
        elif borders.nearest_m <= np.linalg.norm(hand - borders.shoulder) <= borders.farthest_m:
            assert hand + back == pytest.approx(np.clip(hand, *borders.box))


@pytest.mark.parametrize(("distance_m", "wanted_m"), [(0.30, 0.40), (0.80, 0.72)])
def test_an_arm_too_short_or_too_long_is_led_back_along_the_line_to_the_shoulder(distance_m, wanted_m):
    borders = Borders()
    line = np.array([0.9, 0.1, -0.1]) / np.linalg.norm([0.9, 0.1, -0.1])
    hand = borders.shoulder + distance_m * line
    box = np.clip(hand, *borders.box) - hand
    assert hand + borders.back(hand, INSIDE) - box == pytest.approx(borders.shoulder + wanted_m * line)


def test_no_border_lies_before_the_hand_that_began_beyond_it_and_none_on_an_axis_that_presses():
    borders = Borders()
    beyond = np.array([0.62, 0.30, 0.5])
    assert not borders.back(beyond, anchor=beyond).any()
    farther = borders.back(beyond + [0.0, 0.04, 0.0], anchor=beyond)
    assert farther == pytest.approx([0.0, -0.04, 0.0])
    assert not borders.back(beyond, INSIDE, force=(0.0, 5.0, 0.0))[1]


def test_a_border_holds_as_the_hand_goes_beyond_it_unless_a_load_brings_it_back():
    ways = np.linspace(0.0, 0.1, 30)
    shares = [border_hold(way, -10.0, 0.05) for way in ways]
    assert shares == pytest.approx(np.minimum(ways / 0.05, 1.0))
    assert border_hold(-0.1, 10.0, 0.05) == 1.0
    assert [border_hold(0.1, load, 0.05) for load in (0.0, 1.0, 2.0, 9.0)] == [1.0, 0.5, 0.0, 0.0]


def test_a_joint_near_its_end_is_driven_no_further_and_the_others_still_move_the_hand(model):
    tick, margin = inputs(model), ArmConfig().limit_margin_rad
    aside = hand_command(tick)
    aside = replace(aside, position_m=aside.position_m + np.array([0.0, 0.05, 0.03]))
    tick = replace(tick, command=aside)
    rows = model.joint_rows[ARM_SLICE]
    apparent = ArmConfig().velocity_gain * model.mass_matrix[np.ix_(rows, rows)] + np.diag(DAMPING[ARM_SLICE])

    def velocity(law):
        return np.linalg.solve(apparent, law.arm_torque(tick) - model.gravity[rows])

    config = ModelBasedConfig(arm=replace(ArmConfig(), integral_gain=0.0))
    free = velocity(Law(RobotModel(), config))
    joint = int(np.abs(free).argmax())
    ending = RobotModel()
    bound = ending.position_upper if free[joint] > 0.0 else ending.position_lower
    bound[ARM_SLICE.start + joint] = tick.sensor.joint_position[ARM_SLICE.start + joint] + 0.5 * margin * np.sign(free[joint])
    held = velocity(Law(ending, config))
    assert held[joint] == pytest.approx(0.0, abs=1e-9)
    assert (model.end_effector_jacobian[:3, rows] @ held) @ [0.0, 0.05, 0.03] > 0.0


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_hand_that_yields_fast_is_braked_and_a_slow_one_is_not(model, axis):
    """Power of what the speed adds, beside the drive's own damping and the joint loop."""
    jacobian = RobotModel()
    rows = model.joint_rows[ARM_SLICE]
    added = []
    for speed in (0.5, 1.5):
        tick = inputs(jacobian)
        wanted = np.zeros(6)
        wanted[axis] = speed * ArmConfig().yield_speed_mps
        joint_velocity = np.zeros(22)
        joint_velocity[ARM_SLICE] = np.linalg.solve(jacobian.end_effector_jacobian[:, rows], wanted)
        torques = []
        for config in (ArmConfig(), replace(ArmConfig(), brake_nspm=0.0)):
            tick = inputs(model, joint_velocity=joint_velocity, force=10.0 * np.eye(3)[axis])
            tick = replace(tick, command=hand_command(tick, mask=np.eye(3)[axis]))
            torques.append(Law(RobotModel(), ModelBasedConfig(arm=config)).arm_torque(tick))
        added.append(float((torques[0] - torques[1]) @ joint_velocity[ARM_SLICE]))
    assert added[0] == pytest.approx(0.0, abs=1e-9)
    assert added[1] < -0.01


def test_a_still_axis_of_a_pressing_hand_pushes_less_for_where_it_is_off(model):
    """Friction holds it there; a reference that moves is followed with all of the gain."""
    tick, config = inputs(model), replace(ArmConfig(), integral_gain=0.0)
    mask = np.array([0.0, 0.0, 1.0])
    pressing = hand_command(tick, mask=mask, force_n=15.0 * mask)
    off = replace(pressing, position_m=pressing.position_m + np.array([0.01, 0.0, 0.0]))
    rows = model.joint_rows[ARM_SLICE]
    apparent = config.velocity_gain * model.mass_matrix[np.ix_(rows, rows)] + np.diag(DAMPING[ARM_SLICE])

    def speed(periods):
        laws = [Law(RobotModel(), ModelBasedConfig(arm=config)) for _ in range(2)]
        torques = []
        for law, command in zip(laws, (pressing, off), strict=True):
            pressed = replace(tick, command=command, force_estimated_n=15.0 * mask)
            torques.append([law.arm_torque(pressed) for _ in range(periods)][-1])
        return (model.end_effector_jacobian[:3, rows] @ np.linalg.solve(apparent, torques[1] - torques[0]))[0]

    assert speed(100) == pytest.approx(config.still_share * speed(1), rel=0.05)
    assert speed(1) == pytest.approx(0.01 * config.position_gain, rel=0.1)
