"""Where the wheels stand under the trunk: they follow the centre of pressure, so a pulled robot leans against the pull, and
the slope of the floor, so that the trunk stands level.
"""

from dataclasses import dataclass

import numpy as np

from control.joints import LEGS, NOMINAL_POSITION
from control.kernels.compiled import kernel
from control.kernels.records import config_record, packed, record
from control.kernels.small_algebra import clip, rotate_back
from control.robot_model import RobotModel
from control.timing import CONTROL_PERIOD_S
from control.whole_body.body_terms import BODY_TERMS, LEG_OF_JOINT

_STEP_RAD = 1e-4


@dataclass(frozen=True, slots=True)
class StanceConfig:
    """Attributes:
    gain: 1/s, of the distance between the centre of pressure and the middle of the wheels, beyond the dead band, ahead and
        aside. Aside, where the shift moves the trunk, a hand that is led feels it: at 8 a lead takes 14 N instead of 11.
    dead_band_m: distance that is left alone; the wheels stand 0.17 m from their middle.
    return_gain: 1/s, at which the wheels go back to their place of rest, under the centre of mass on the plane on which they
        stand, while the centre of pressure is off their middle.
    rest_return_gain: the same where it is in their middle. A base that comes back over wheels that stand moves the hand; 2 s
        after the last pull of whoever led it aside it shall be at rest.
    limit_m: farthest shift of the wheels from their nominal place, per axis. With 0.14 m a sudden pull of 40 N back and up
        lifts the front wheels of a light robot for good, on a floor that rises by 5 degrees with 0.2 m.
    lead_m: farthest shift that is asked for beyond where the legs hold the wheels. They follow within 0.03 m; where something
        else moves them (a policy that imitates) the shift must not run away.
    speed_mps: fastest shift ahead and aside. At 0.4 ahead the front wheels of a light robot lift before the shift has come far
        enough; aside the wheels do not roll, and what the shift moves is the trunk.
    level_gain: 1/s, at which the legs follow the slope of the floor. Faster, they follow what wheels that lift make of it: a
        robot that a pull tips leans farther.
    level_dead_band: slope, m/m, that is left alone. A wheel that hangs 1 cm above the floor looks like 0.015; a leg that is
        bent for it would leave it there.
    level_limit: steepest slope, m/m, that the legs are bent for.
    """

    gain: tuple[float, float] = (8.0, 4.0)
    dead_band_m: float = 0.025
    return_gain: float = 0.2
    rest_return_gain: float = 0.8
    limit_m: float = 0.25
    lead_m: float = 0.05
    speed_mps: tuple[float, float] = (0.6, 0.3)
    level_gain: float = 1.5
    level_dead_band: float = 0.02
    level_limit: float = 0.15


STANCE = config_record(StanceConfig(), leg_rad_per_m=(12, 3), middle=2)
"""The numbers of StanceConfig, how the leg joints move per shift of the wheels under the trunk, and where the middle of the
wheels lies without a shift, m, in base.
"""

STANCE_STATE = record(shift=2, shift_velocity=2, rise=2)
"""Zeros at the nominal stance.

Fields:
    shift, shift_velocity: of the wheels from their nominal place, m and m/s, heading axes.
    rise: of the floor that the legs are bent for, m/m along the heading axes.
"""


@kernel("f8(f8[:,::1], f8[:], i8)")
def _slope(contacts: np.ndarray, middle: np.ndarray, axis: int) -> float:
    """Rise along a heading axis, m/m, of the plane through the contacts (4, 3), whose middle (3,) is; all in heading, m."""
    rise, spread = 0.0, 0.0
    for wheel in range(4):
        way = contacts[wheel, axis] - middle[axis]
        rise += way * (contacts[wheel, 2] - middle[2])
        spread += way * way
    return rise / spread


@kernel("void(Stance, Terms, matrix, State, f8[:])", Stance=STANCE, Terms=BODY_TERMS, State=STANCE_STATE)
def shifted_posture(
    stance: np.record, terms: np.record, ground_forces: np.ndarray, state: np.record, posture: np.ndarray
) -> None:
    """Leg posture (12,), rad, after one period: the shift integrates k max(|c| - band, 0) sgn(c) - k_r (shift - rest), up to a
    lead.

    On a floor that rises by g per metre a wheel r ahead of the middle stands g r higher under a trunk that is level. Where that
    is farther than the legs level, by g', the trunk leans with the floor and its centre of mass lies h (g - g') down the slope:
    there the wheels rest.

    Args:
        ground_forces: (4, 3) N, that the balance asks of the wheels; their centre of pressure lies c off their middle.
    """
    load, pressure, middle, reached = 0.0, np.zeros(2), np.zeros(3), -stance.middle
    contacts = np.empty((4, 3))
    for wheel in range(4):
        contact = rotate_back(terms.rotation_heading_to_world, terms.contacts[wheel])
        in_base = rotate_back(terms.rotation_base_to_world, terms.contacts[wheel])
        load += ground_forces[wheel, 2]
        for i in range(3):
            contacts[wheel, i] = contact[i]
            middle[i] += 0.25 * contact[i]
        for i in range(2):
            pressure[i] += ground_forces[wheel, 2] * contact[i]
            reached[i] += 0.25 * in_base[i]
    height = terms.center_of_mass[2] - middle[2]
    for i in range(2):
        slope = _slope(contacts, middle, i)
        steep = slope - clip(slope, -stance.level_dead_band, stance.level_dead_band)
        levelled = clip(steep, -stance.level_limit, stance.level_limit)
        state.rise[i] += stance.level_gain * CONTROL_PERIOD_S * (levelled - state.rise[i])
        rest = -height * (slope - state.rise[i])
        offset = pressure[i] / max(load, 1.0) - middle[i]
        excess = offset - clip(offset, -stance.dead_band_m, stance.dead_band_m)
        loaded = clip(abs(offset) / stance.dead_band_m, 0.0, 1.0)
        back = loaded * stance.return_gain + (1.0 - loaded) * stance.rest_return_gain
        last = state.shift[i]
        velocity = clip(stance.gain[i] * excess - back * (last - rest), -stance.speed_mps[i], stance.speed_mps[i])
        shift = clip(last + velocity * CONTROL_PERIOD_S, reached[i] - stance.lead_m, reached[i] + stance.lead_m)
        state.shift[i] = clip(shift, -stance.limit_m, stance.limit_m)
        state.shift_velocity[i] = (state.shift[i] - last) / CONTROL_PERIOD_S
    for joint in range(12):
        wheel, rad_per_m = LEG_OF_JOINT[joint], stance.leg_rad_per_m[joint]
        up = state.rise[0] * (contacts[wheel, 0] - middle[0]) + state.rise[1] * (contacts[wheel, 1] - middle[1])
        bent = rad_per_m[0] * state.shift[0] + rad_per_m[1] * state.shift[1] + rad_per_m[2] * up
        posture[joint] = NOMINAL_POSITION[joint] + bent


def stance_record(config: StanceConfig, model: RobotModel) -> np.ndarray:
    """STANCE (1,) with the legs' kinematics at the nominal posture, in which `model` is left."""
    rad_per_m = np.linalg.inv(_contact_jacobians(model))
    model.update_configuration(np.eye(3), NOMINAL_POSITION)
    middle = model.wheel_contact_positions.mean(axis=0)[:2]
    return packed(STANCE, config, leg_rad_per_m=rad_per_m.reshape(len(LEGS) * 3, 3), middle=middle)


def _contact_jacobians(model: RobotModel) -> np.ndarray:
    """(4, 3, 3) m/rad: motion of each wheel's lowest point with its leg's hip, thigh and calf, by central differences."""
    jacobians = np.empty((len(LEGS), 3, 3))
    posture = NOMINAL_POSITION.copy()
    for leg in range(len(LEGS)):
        for joint in range(3):
            ends = []
            for step in (_STEP_RAD, -_STEP_RAD):
                posture[3 * leg + joint] += step
                model.update_configuration(np.eye(3), posture)
                ends.append(model.wheel_contact_positions[leg].copy())
                posture[3 * leg + joint] -= step
            jacobians[leg, :, joint] = (ends[0] - ends[1]) / (2.0 * _STEP_RAD)
    return jacobians
