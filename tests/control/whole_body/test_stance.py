"""The stance: where the wheels stand under the trunk, and how soon they come back."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from control.joints import LEG_SLICE, NOMINAL_BASE_HEIGHT_M, NOMINAL_POSITION
from control.robot_model import RobotModel
from control.whole_body.body_terms import BODY_TERMS
from control.whole_body.stance import STANCE_STATE, StanceConfig, shifted_posture, stance_record


@pytest.fixture
def model():
    return RobotModel()


def stand(model, config, vertical_forces, periods, follows=True):
    """Leg posture (12,) and state of a stance with these loads after some periods, of legs that follow or do not."""
    stance, state, posture = stance_record(config, model), np.zeros(1, STANCE_STATE), np.empty(12)
    terms, forces = np.zeros(1, BODY_TERMS), np.zeros((4, 3))
    terms["rotation_heading_to_world"] = terms["rotation_base_to_world"] = np.eye(3)
    joints, forces[:, 2] = NOMINAL_POSITION.copy(), vertical_forces
    for _ in range(periods):
        model.update_configuration(np.eye(3), joints)
        terms["contacts"] = model.wheel_contact_positions
        shifted_posture(stance[0], terms[0], forces, state[0], posture)
        if follows:
            joints[LEG_SLICE] = posture
    return posture, state[0]


def test_the_stance_follows_the_centre_of_pressure_and_its_legs_put_the_wheels_there(model):
    """Front wheels that bear the more draw the wheels ahead, for the trunk shall stand behind them, up to the limit."""
    config = StanceConfig(return_gain=0.0, limit_m=0.1)
    posture, state = stand(model, config, (100.0, 100.0, 10.0, 10.0), 200)
    bent = NOMINAL_POSITION.copy()
    model.update_configuration(np.eye(3), bent)
    nominal = model.wheel_contact_positions.copy()
    bent[LEG_SLICE] = posture
    model.update_configuration(np.eye(3), bent)
    moved = model.wheel_contact_positions - nominal
    assert np.allclose(moved[:, 0], config.limit_m, atol=0.01), "linear in the joints, so short by a centimetre at the farthest"
    assert np.allclose(moved[:, 1], 0.0, atol=1e-3)
    assert np.allclose(state.shift_velocity, 0.0)


def test_the_stance_does_not_run_away_from_wheels_that_do_not_follow(model):
    """Blocked, or moved by somebody who imitates it."""
    config = StanceConfig()
    _, state = stand(model, config, (100.0, 100.0, 10.0, 10.0), 200, follows=False)
    assert np.allclose(state.shift, [config.lead_m, 0.0])
    assert np.allclose(state.shift_velocity, 0.0)


def test_the_stance_leaves_small_offsets_alone(model):
    posture, _ = stand(model, StanceConfig(), (62.0, 62.0, 55.0, 55.0), 1)
    assert np.allclose(posture, NOMINAL_POSITION[LEG_SLICE], atol=1e-4)


def test_the_stance_comes_back_before_the_hand_that_was_let_go_shall_rest(model):
    """It moves the hand on as it does; by a share of `return_gain` within a second while something still pulls a little."""
    config = StanceConfig()
    stance, state = stance_record(config, model), np.zeros(1, STANCE_STATE)
    terms, forces = np.zeros(1, BODY_TERMS), np.zeros((4, 3))
    terms["rotation_heading_to_world"] = terms["rotation_base_to_world"] = np.eye(3)
    model.update_configuration(np.eye(3), NOMINAL_POSITION)
    terms["contacts"] = contacts = model.wheel_contact_positions
    for lean, gain in ((0.0, config.rest_return_gain), (config.dead_band_m, config.return_gain)):
        forces[:, 2] = 60.0 * (1.0 + lean * np.sign(contacts[:, 1]) / np.abs(contacts[:, 1] - contacts[:, 1].mean()))
        state["shift"] = 0.0, 0.03
        for _ in range(50):
            shifted_posture(stance[0], terms[0], forces, state[0], np.empty(12))
        assert state["shift"][0, 1] == pytest.approx(0.03 * np.exp(-gain), rel=0.02)


def on_floor(model, joints, rise):
    """Rotation (3, 3) of a base whose wheels stand on a floor with this rise along x and y."""
    model.update_configuration(np.eye(3), joints)
    *_, normal = np.linalg.svd(model.wheel_contact_positions - model.wheel_contact_positions.mean(axis=0))[2]
    normal *= np.sign(normal[2])
    up = np.array([-rise[0], -rise[1], 1.0]) / np.linalg.norm([*rise, 1.0])
    axis = np.cross(normal, up)
    return Rotation.from_rotvec(axis * np.arcsin(np.linalg.norm(axis)) / max(np.linalg.norm(axis), 1e-12)).as_matrix()


@pytest.mark.parametrize("rise", [(0.09, 0.0), (0.0, -0.09), (-0.05, 0.05), (0.0, 0.0), (0.25, 0.0), (0.1, -0.25)])
def test_on_a_slope_the_trunk_stands_level_and_the_wheels_under_the_centre_of_mass(model, rise):
    """Farther than the legs level, the trunk leans with the floor and has its weight down the slope."""
    config = StanceConfig()
    stance, state = stance_record(config, model), np.zeros(1, STANCE_STATE)
    terms, forces, posture = np.zeros(1, BODY_TERMS), np.zeros((4, 3)), np.empty(12)
    terms["rotation_heading_to_world"] = np.eye(3)
    forces[:, 2], joints, height = 60.0, NOMINAL_POSITION.copy(), 0.35
    base_to_heading, center, contacts = np.eye(3), np.zeros(3), np.zeros((4, 3))
    for _ in range(600):
        base_to_heading = on_floor(model, joints, rise)
        model.update_configuration(base_to_heading, joints)
        contacts = model.wheel_contact_positions
        center = base_to_heading @ [*stance["middle"][0], height - NOMINAL_BASE_HEIGHT_M]
        terms["rotation_base_to_world"], terms["contacts"], terms["center_of_mass"] = base_to_heading, contacts, center
        shifted_posture(stance[0], terms[0], forces, state[0], posture)
        joints[LEG_SLICE] = posture
    levelled = np.clip(np.abs(rise) - config.level_dead_band, 0.0, config.level_limit)
    lean = np.arctan(np.abs(rise) - levelled)
    assert np.degrees(np.arccos(base_to_heading[2, 2])) == pytest.approx(np.degrees(np.linalg.norm(lean)), abs=1.0)
    assert np.abs(center - contacts.mean(axis=0))[:2].max() < 0.012
