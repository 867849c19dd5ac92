"""Hand tracking and force regulation by the arm: resolved velocity in an inertia-weighted joint loop plus a force term.

    tau = g + M K_v (dq_d - dq) + k_d dq_d + J^T F

A Jacobian-transpose spring of the same stiffness is unstable on the wrist at 50 Hz; weighting by the joint inertia M gives
every joint the same bandwidth K_v.
"""

import math
from dataclasses import dataclass

import numpy as np

from control.command.axis_mask import CONTACT_NOISE_N
from control.estimation.model_adaptation import ARM as ARM_MASS
from control.joints import ARM_SLICE, DAMPING, STIFFNESS, TORQUE_LIMIT
from control.kernels.compiled import kernel
from control.kernels.records import config_record
from control.kernels.small_algebra import Triple, clip, rotate, rotate_back, solve_positive
from control.timing import CONTROL_PERIOD_S
from control.whole_body.body_terms import BODY_TERMS
from control.whole_body.reference_correction import CORRECTION
from control.whole_body.task_memory import TASK_MEMORY
from control.whole_body.task_signals import TASK_SIGNALS

_FIRST = ARM_SLICE.start


@dataclass(frozen=True, slots=True)
class ArmConfig:
    """Gains of the arm.

    Attributes:
        position_gain: 1/s, reference velocity per position error.
        position_error_limit_m: error beyond which the approach speed grows no more.
        orientation_gain: 1/s. With less, a mass that the model does not know of turns the hand by degrees.
        orientation_scale_m: what one radian costs in metres when position and orientation conflict.
        damping: of the damped least squares, in m: a reach that stretches the arm gets slow instead of violent.
        joint_speed_limit_rps: of the resolved joint velocity.
        velocity_gain: K_v, 1/s.
        integral_gain: N per m s, of the hand force that removes what the model does not know about position axes. More than
            4.5 N at the integral's limit would, with what `load_gain` adds, drag a pressing hand over its friction.
        force_gain: N per N of force error on force axes, on top of the commanded force fed forward. With more, a stiff
            contact rings: the estimate is late.
        force_integral_gain: 1/s.
        force_error_limit_n: force errors beyond it add no more.
        force_velocity_feedback: share of the hand's velocity that force axes do not brake; below 1 the hand is damped.
        yield_speed_mps: a hand that is asked for no force, or feels `surprise_n` more than it is asked for, and yields faster
            is braked by what it is faster; beyond the border by all its speed. At 0.4 m/s a hand that is pulled back and down
            by 40 N swings far enough to brush the base.
        brake_nspm: N s/m, by which.
        brake_share: of the momentum of the hand's apparent mass that it takes at most in one period: with more it would ring.
        nearest_m: distance from the shoulder within which it does not come.
        yield_x_m, yield_y_m, yield_z_m: box in heading within which a hand that is asked for no force yields: where the wheels
            stand wide enough for a firm pull, and the arm does not come near the robot.
        border_m: how far beyond the border of the workspace a force axis has become a position axis that holds the border.
        border_load_limit_n: of the estimated force that such an axis carries.
        border_stiffness: N/m, besides, of the way back.
        contact_share: of the commanded force, estimated, that counts as contact; less a noise of contact_noise_n. Until then
            a force axis moves towards contact under velocity control.
        contact_noise_n: smaller commanded forces need no contact.
        approach_gain: m/s per N of the commanded force, of the hand towards contact: a small
            commanded force gives a slow approach.
        approach_speed_limit_mps: of that speed.
        load_gain: share of the estimated force that axes in motion carry, so that a load deflects them less.
        load_limit_n: of that share.
        still_share: of position_gain that is left to a still axis of a pressing hand, which its friction holds: with all of it
            the hand, caught a centimetre off its reference, pushes there by 2 N and more.
        limit_margin_rad: joints this close to an end are not driven further.
    """

    position_gain: float = 6.0
    position_error_limit_m: float = 0.1
    orientation_gain: float = 8.0
    orientation_scale_m: float = 0.15
    damping: float = 0.04
    joint_speed_limit_rps: float = 3.0
    velocity_gain: float = 15.0
    integral_gain: float = 150.0
    force_gain: float = 0.2
    force_integral_gain: float = 5.0
    force_error_limit_n: float = 8.0
    force_velocity_feedback: float = 0.5
    yield_speed_mps: float = 0.25
    surprise_n: float = 6.0
    brake_nspm: float = 60.0
    brake_share: float = 0.6
    nearest_m: float = 0.40
    yield_x_m: tuple[float, float] = (0.42, 0.74)
    yield_y_m: tuple[float, float] = (-0.25, 0.25)
    yield_z_m: tuple[float, float] = (0.42, 0.63)
    border_m: float = 0.05
    border_load_limit_n: float = 40.0
    border_stiffness: float = 600.0
    contact_share: float = 0.3
    contact_noise_n: float = CONTACT_NOISE_N
    approach_gain: float = 0.03
    approach_speed_limit_mps: float = 0.3
    load_gain: float = 0.8
    load_limit_n: float = 10.0
    still_share: float = 0.4
    limit_margin_rad: float = 0.1


ARM = config_record(ArmConfig(), lower=6, upper=6, workspace=(2, 3), shoulder=3, reach=())
"""The numbers of ArmConfig, the ends of the joints (rad), and what bounds the workspace: the corners of a box, and a sphere
around the shoulder (m, in heading)."""


@kernel("void(Arm, vector, vector, vector, f8[:])", Arm=ARM)
def way_back(arm: np.record, force_n: np.ndarray, anchor: np.ndarray, hand_position: np.ndarray, back: np.ndarray) -> None:
    """Way (3,) m, in heading, from the hand to the border of where it yields; zero inside, and where a force is asked for.

    Args:
        force_n: (3,) N, asked for.
        anchor: (3,) m, where the hand was when that began: no border lies before it.
        hand_position: (3,) m, in heading.
        back: (3,) the result.
    """
    distance, begun = 0.0, 0.0
    for i in range(3):
        distance += (hand_position[i] - arm.shoulder[i]) ** 2
        begun += (anchor[i] - arm.shoulder[i]) ** 2
    distance, begun = math.sqrt(distance), math.sqrt(begun)
    beyond = distance - clip(distance, min(arm.nearest_m, begun), max(arm.reach, begun))
    stretched = beyond / max(distance, 1e-9)
    for i in range(3):
        back[i] = 0.0
        if force_n[i] == 0.0:
            box = arm.yield_x_m if i == 0 else arm.yield_y_m if i == 1 else arm.yield_z_m
            inside = clip(hand_position[i], min(box[0], anchor[i]), max(box[1], anchor[i]))
            back[i] = inside - hand_position[i] - stretched * (hand_position[i] - arm.shoulder[i])


@kernel("f8(f8, f8, f8)")
def border_hold(back_m: float, force_estimated_n: float, border_m: float) -> float:
    """Share, 0 to 1, by which an axis holds the border of the workspace: none inside, and none where a contact is pressed on.

        clip(|back| / border, 0, 1) clip(1 - f_hat sign(back) / 2 N, 0, 1)

    Args:
        back_m: way back to the border along the axis, signed.
        force_estimated_n: f_hat, on the hand; a load that pushes back to the border needs no holding.
        border_m: beyond which the axis holds wholly.
    """
    inwards = force_estimated_n if back_m > 0.0 else -force_estimated_n
    return min(1.0, abs(back_m) / border_m) * clip(1.0 - inwards / 2.0, 0.0, 1.0)


@kernel("UniTuple(f8, 3)(Terms, Signals)", Terms=BODY_TERMS, Signals=TASK_SIGNALS)
def _velocity_from_arm(terms: np.record, signals: np.record) -> Triple:
    """Velocity of the hand, m/s, in heading, that the arm's joints alone give it."""
    velocity = np.zeros(3)
    for i in range(3):
        for joint in range(6):
            velocity[i] += terms.hand_jacobian[i, joint] * signals.joint_velocity[_FIRST + joint]
    return rotate_back(terms.rotation_heading_to_world, velocity)


@kernel(
    "void(Arm, Terms, Signals, Memory, Correction, vector, vector, f8[:])",
    Arm=ARM,
    Terms=BODY_TERMS,
    Signals=TASK_SIGNALS,
    Memory=TASK_MEMORY,
    Correction=CORRECTION,
)
def _reference_twist(
    arm: np.record,
    terms: np.record,
    signals: np.record,
    memory: np.record,
    correction: np.record,
    force_share: np.ndarray,
    back: np.ndarray,
    twist: np.ndarray,
) -> None:
    """Hand twist (6,), world-aligned, that the arm should add to the base's motion.

    Position axes track, v = v_ref + K_p e; force axes move towards contact, and yield to it by their share of force control.
    """
    command, hand, heading = signals.command, terms.hand, terms.rotation_heading_to_world
    rate = rotate(terms.rotation_base_to_world, signals.angular_velocity)
    # The heading frame follows the base over the ground but not its tilting and heaving: the arm takes those out.
    heave = rate[0] * hand[1] - rate[1] * hand[0] + signals.base_linear_velocity[2]
    rocking = rotate_back(heading, np.array([rate[1] * hand[2], -rate[0] * hand[2], heave]))
    arm_velocity = _velocity_from_arm(terms, signals)

    linear, turn = np.empty(3), np.empty(3)
    for i in range(3):
        error = command.position_m[i] - signals.hand_position[i]
        error = clip(error, -arm.position_error_limit_m, arm.position_error_limit_m)
        held = arm.position_gain * (1.0 - (1.0 - arm.still_share) * memory.released[i])
        tracking = memory.reference_velocity[i] + held * error - rocking[i]
        approach = clip(-arm.approach_gain * command.force_n[i], -arm.approach_speed_limit_mps, arm.approach_speed_limit_mps)
        # Where nothing is met, the search ends at the border of the workspace.
        to_lower = arm.position_gain * (arm.workspace[0, i] - signals.hand_position[i])
        to_upper = arm.position_gain * (arm.workspace[1, i] - signals.hand_position[i])
        approach = clip(approach, to_lower, to_upper)
        if back[i] != 0.0:
            approach = arm.position_gain * back[i]
        elif command.force_n[i] == 0.0:
            to_rest = memory.rest[i] - signals.hand_position[i]
            approach = arm.position_gain * clip(to_rest, -arm.position_error_limit_m, arm.position_error_limit_m)
        motion = (1.0 - command.mask[i]) * (tracking + correction.hand_velocity[i]) + command.mask[i] * approach
        yielding = arm.force_velocity_feedback * arm_velocity[i]
        linear[i] = (1.0 - force_share[i]) * motion + force_share[i] * yielding
        turn[i] = arm.orientation_gain * signals.orientation_error[i] + correction.hand_angular_velocity[i]
    twist[0], twist[1], twist[2] = rotate(heading, linear)
    twist[3], twist[4], twist[5] = rotate(heading, turn)
    twist[3] -= rate[0]
    twist[4] -= rate[1]


@kernel("b1(Arm, Signals, vector, f8[:,::1], f8[::1])", Arm=ARM, Signals=TASK_SIGNALS)
def _hold_at_ends(arm: np.record, signals: np.record, velocity: np.ndarray, normal: np.ndarray, wanted: np.ndarray) -> bool:
    """Take joints that would move on towards their near end out of the normal equations; whether there was any.

    Args:
        velocity: (6,) rad/s, solution of
        normal, wanted: (6, 6) and (6,), in which such a joint's velocity becomes zero.
    """
    held = False
    for i in range(6):
        q, margin = signals.joint_position[_FIRST + i], arm.limit_margin_rad
        if (q > arm.upper[i] - margin and velocity[i] > 1e-9) or (q < arm.lower[i] + margin and velocity[i] < -1e-9):
            held = True
            for j in range(6):
                normal[i, j] = normal[j, i] = 0.0
            normal[i, i], wanted[i] = 1.0, 0.0
    return held


@kernel("void(Arm, Terms, Signals, vector, f8[::1])", Arm=ARM, Terms=BODY_TERMS, Signals=TASK_SIGNALS)
def _resolve(arm: np.record, terms: np.record, signals: np.record, twist: np.ndarray, velocity: np.ndarray) -> None:
    """Damped least-squares joint velocity (6,) of a hand twist (6,), (J^T W J + d^2) v = J^T W t, within speed and ends."""
    weighted, normal = np.empty((6, 6)), np.empty((6, 6))
    for row in range(6):
        weight = 1.0 if row < 3 else arm.orientation_scale_m**2
        for joint in range(6):
            weighted[row, joint] = weight * terms.hand_jacobian[row, joint]
    for i in range(6):
        velocity[i] = 0.0
        for row in range(6):
            velocity[i] += weighted[row, i] * twist[row]
        for j in range(6):
            normal[i, j] = arm.damping**2 if i == j else 0.0
            for row in range(6):
                normal[i, j] += weighted[row, i] * terms.hand_jacobian[row, j]
    factor, wanted = normal.copy(), velocity.copy()
    solve_positive(factor, velocity)
    # A joint near its end moves no further towards it: the others serve what is left, the position before the orientation.
    while _hold_at_ends(arm, signals, velocity, normal, wanted):
        factor[:], velocity[:] = normal, wanted
        solve_positive(factor, velocity)
    fastest = 1e-9
    for i in range(6):
        fastest = max(fastest, abs(velocity[i]))
    share = min(1.0, arm.joint_speed_limit_rps / fastest)
    for i in range(6):
        velocity[i] *= share


@kernel("f8(Terms, Signals, i8)", Terms=BODY_TERMS, Signals=TASK_SIGNALS)
def _apparent_mass(terms: np.record, signals: np.record, axis: int) -> float:
    """Mass, kg, that a force at the hand along a heading axis feels of the arm: 1 / (j M^-1 j^T) with j = e^T J."""
    heading = terms.rotation_heading_to_world
    row, inertia = np.empty(6), np.empty((6, 6))
    for i in range(6):
        row[i] = 0.0
        for k in range(3):
            row[i] += heading[k, axis] * terms.hand_jacobian[k, i]
        for j in range(6):
            inertia[i, j] = signals.mass_scales[ARM_MASS] * terms.arm_inertia[i, j]
    moved = row.copy()
    solve_positive(inertia, moved)
    return 1.0 / max(np.dot(row, moved), 1e-3)


@kernel(
    "UniTuple(f8, 3)(Arm, Terms, Signals, Memory, Correction, vector, vector)",
    Arm=ARM,
    Terms=BODY_TERMS,
    Signals=TASK_SIGNALS,
    Memory=TASK_MEMORY,
    Correction=CORRECTION,
)
def _hand_force(
    arm: np.record,
    terms: np.record,
    signals: np.record,
    memory: np.record,
    correction: np.record,
    force_share: np.ndarray,
    back: np.ndarray,
) -> tuple[float, float, float]:
    """Force, N, world-aligned, that the hand shall exert on the environment.

    Under force control -f + K_f e + K_i int e, with e = f_hat - f; otherwise a share of the estimated load; and what the
    integral of the position error asks for.
    """
    command, force = signals.command, np.empty(3)
    arm_velocity = _velocity_from_arm(terms, signals)
    for i in range(3):
        error = signals.force_estimated_n[i] - command.force_n[i]
        near = clip(error, -arm.force_error_limit_n, arm.force_error_limit_n)
        regulation = arm.force_gain * near + arm.force_integral_gain * memory.force_integral[i] - command.force_n[i]
        holding = command.mask[i] if back[i] != 0.0 else 0.0
        most = (1.0 - holding) * arm.load_limit_n + holding * arm.border_load_limit_n
        load = clip((1.0 - memory.released[i]) * arm.load_gain * signals.force_estimated_n[i], -most, most)
        pulled = command.force_n[i] == 0.0 or abs(error) > arm.surprise_n
        yielding = command.mask[i] if pulled else 0.0
        free = arm.yield_speed_mps * (force_share[i] if back[i] != 0.0 else 1.0)
        damping = 0.0
        if yielding > 0.0:
            damping = min(arm.brake_nspm, arm.brake_share * _apparent_mass(terms, signals, i) / CONTROL_PERIOD_S)
        brake = damping * (arm_velocity[i] - clip(arm_velocity[i], -free, free))
        force[i] = (
            yielding * (arm.border_stiffness * (1.0 - force_share[i]) * back[i] - brake)
            + force_share[i] * (regulation + correction.hand_force[i])
            - (1.0 - force_share[i]) * load
            + arm.integral_gain * memory.position_integral[i]
        )
    return rotate(terms.rotation_heading_to_world, force)


@kernel(
    "void(Arm, Terms, Signals, Memory, Correction, vector, vector, f8[:])",
    Arm=ARM,
    Terms=BODY_TERMS,
    Signals=TASK_SIGNALS,
    Memory=TASK_MEMORY,
    Correction=CORRECTION,
)
def arm_targets(
    arm: np.record,
    terms: np.record,
    signals: np.record,
    memory: np.record,
    correction: np.record,
    force_share: np.ndarray,
    back: np.ndarray,
    out: np.ndarray,
) -> None:
    """Position targets (6,), rad, that carry the torque of the law above.

    Args:
        force_share: (3,) of the mask law, less what the border holds.
        back: (3,) of `way_back`.
    """
    twist, velocity = np.empty(6), np.empty(6)
    _reference_twist(arm, terms, signals, memory, correction, force_share, back, twist)
    _resolve(arm, terms, signals, twist, velocity)
    force = _hand_force(arm, terms, signals, memory, correction, force_share, back)
    mass = signals.mass_scales[ARM_MASS]
    for i in range(6):
        joint = _FIRST + i
        torque = mass * terms.gravity_torque[joint] + DAMPING[joint] * velocity[i]
        for j in range(6):
            acceleration = arm.velocity_gain * (velocity[j] - signals.joint_velocity[_FIRST + j])
            torque += mass * terms.arm_inertia[i, j] * acceleration
        for row in range(3):
            torque += terms.hand_jacobian[row, i] * force[row]
        torque = clip(torque, -TORQUE_LIMIT[joint], TORQUE_LIMIT[joint])
        out[i] = signals.joint_position[joint] + torque / STIFFNESS[joint]
