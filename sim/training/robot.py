"""Many simulated robots stepped together on mujoco.batch, and their kinematics as arrays.

The training model trades detail for speed: 10 ms steps, pyramidal friction cones, wheels without torsional friction, no
self-collision, no dry joint friction except in the share of robots that randomisation gives it. Checkpoints are judged on
the full model (sim.trials.policy_score).
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.batch import Batch

from control.joints import (
    ARM_JOINT_NAMES,
    ARM_SLICE,
    END_EFFECTOR_FRAME,
    JOINT_COUNT,
    JOINT_NAMES,
    LEGS,
    NOMINAL_BASE_HEIGHT_M,
    NOMINAL_POSITION,
    TORQUE_LIMIT,
    WHEEL_CENTER_FRAMES,
    WHEEL_SLICE,
)
from control.timing import CONTROL_PERIOD_S
from control.whole_body.body_terms import BODY_TERMS
from sim import scenes
from sim.training.batch_rotations import cross
from sim.training.kinematics import KINEMATICS, move, weigh

TIMESTEP_S = 0.01
SUBSTEPS = round(CONTROL_PERIOD_S / TIMESTEP_S)


@dataclass(frozen=True, slots=True)
class Randomization:
    """Ranges of what differs between robots; uniform.

    Attributes:
        mass_scale: of every link.
        tool_mass_scale: of the last arm link and the tool, on top.
        wheel_friction: coefficient of the wheels on the ground.
        gain_scale: of each drive's stiffness, and apart from it of its damping.
        dry_friction_share: share of robots with `dry_friction_nm` on every joint.
        late_share: share of robots whose targets arrive one step (10 ms) late.
    """

    mass_scale: tuple[float, float] = (0.8, 1.2)
    tool_mass_scale: tuple[float, float] = (0.9, 1.1)
    wheel_friction: tuple[float, float] = (0.5, 1.4)
    gain_scale: tuple[float, float] = (0.9, 1.1)
    dry_friction_share: float = 0.5
    dry_friction_nm: tuple[float, float] = (0.1, 0.3)
    late_share: float = 0.3


NO_RANDOMIZATION = Randomization((1.0, 1.0), (1.0, 1.0), (0.8, 0.8), (1.0, 1.0), 0.0, (0.0, 0.0), 0.0)


def training_model() -> mujoco.MjModel:
    """The free scene, simplified."""
    model = scenes.build("free").model
    model.opt.timestep = TIMESTEP_S
    model.opt.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    model.opt.impratio = 1.0
    model.dof_frictionloss[:] = 0.0
    floor = model.geom("floor").id
    model.geom_contype[:], model.geom_conaffinity[:] = 1, 0
    model.geom_contype[floor], model.geom_conaffinity[floor] = 0, 1
    for leg in LEGS:
        model.geom_condim[model.geom(f"{leg}_wheel").id] = 3
    return model


class BatchedRobot:
    """n robots on flat ground. Arrays are renewed by `step` and `reset`, never changed in place, and lie in Fortran order
    (sim.training.batch_rotations); vectors are in world unless named otherwise.

    Attributes:
        base_position: (n, 3) m; rotation_base_to_world, rotation_heading_to_world: (n, 3, 3).
        base_linear_velocity, base_angular_velocity: (n, 3), the latter in world; angular_velocity_in_base (n, 3).
        joint_position, joint_velocity, joint_torque: (n, 22).
        hand_position, hand_velocity, hand_velocity_from_arm: (n, 3); hand_rotation (n, 3, 3).
        contact_positions: (n, 4, 3), lowest points of the wheels.
        rolling_velocity: (n, 3) m/s, see KINEMATICS.
        terms: BODY_TERMS (n,), changed in place.
        mass_scale: (n,) total mass over nominal; mass_scales (n, 2) of the arm and of the rest.
        gain_scales: (n, 2) mean stiffness and damping of the drives over nominal. wheel_friction: (n,).
    """

    base_position: np.ndarray
    rotation_base_to_world: np.ndarray
    rotation_heading_to_world: np.ndarray
    base_linear_velocity: np.ndarray
    base_angular_velocity: np.ndarray
    angular_velocity_in_base: np.ndarray
    joint_position: np.ndarray
    joint_velocity: np.ndarray
    joint_torque: np.ndarray
    hand_position: np.ndarray
    hand_velocity: np.ndarray
    hand_rotation: np.ndarray
    hand_velocity_from_arm: np.ndarray
    contact_positions: np.ndarray
    rolling_velocity: np.ndarray

    def __init__(self, count: int, threads: int, randomization: Randomization, random: np.random.Generator) -> None:
        self.count = count
        self._random = random
        self.model = model = training_model()
        self._nominal_masses = model.body_mass.copy()
        self._nominal_inertias = model.body_inertia.copy()
        self.batch = batch = Batch(model, nsim=count, nthread=threads)
        joints = [model.joint(name) for name in JOINT_NAMES]
        self._joint_ids = np.array([joint.id for joint in joints], np.int64)
        self._qpos_rows = np.array([joint.qposadr[0] for joint in joints], np.int64)
        self._dof_rows = np.array([joint.dofadr[0] for joint in joints], np.int64)
        self._actuators = np.array([model.actuator(name).id for name in JOINT_NAMES])
        self._hand_body = model.body("end_effector").id
        self._tool_bodies = [model.joint(ARM_JOINT_NAMES[-1]).bodyid[0], self._hand_body]
        self._qpos, self._qvel, self._ctrl = batch.bind("qpos"), batch.bind("qvel"), batch.bind("ctrl")
        self._wrenches, self._actuator_force = batch.bind("xfrc_applied"), batch.bind("actuator_force")
        self._disable_flags = batch.expand("opt.disableflags")
        self._axes, self._anchors, self._centers = batch.bind("xaxis"), batch.bind("xanchor"), batch.bind("xipos")
        self._site_positions, self._site_rotations = batch.bind("site_xpos"), batch.bind("site_xmat")
        self._principal_axes = batch.bind("ximat")
        sites = (*WHEEL_CENTER_FRAMES, END_EFFECTOR_FRAME)
        self._sites = np.array([model.site(name).id for name in sites], np.int64)
        self._carries = _carries(model, self._joint_ids)
        self._armature = model.dof_armature[self._dof_rows[ARM_SLICE]]
        self._kinematics = np.zeros(count, KINEMATICS)
        self.terms = np.zeros(count, BODY_TERMS)
        self.late = random.random(count) < randomization.late_share
        self._randomize(randomization)
        self._pending = np.zeros((count, JOINT_COUNT), order="F")
        everyone = np.arange(count)
        self._place(everyone)
        self.joint_torque = np.zeros((count, JOINT_COUNT), order="F")
        self._measure(everyone)

    def reset(self, ids: np.ndarray) -> None:
        """Put robots on their wheels near the nominal posture, facing anywhere."""
        self._place(ids)
        self.joint_torque = self.joint_torque.copy(order="F")
        self.joint_torque[ids] = 0.0
        self._measure(ids)

    def set_targets(self, targets: np.ndarray) -> None:
        """Joint targets (n, 22) for the steps to come; late robots keep their old ones through the next step."""
        self._ctrl[:, self._actuators] = np.where(self.late[:, None], self._pending, targets)
        self._pending = targets.copy(order="F")

    def apply_hand_force(self, force: np.ndarray) -> None:
        """Force (n, 3), N, in world, of the environment on the hand until it is set again."""
        body = self._hand_body
        self._wrenches[:, body, :3] = force
        self._wrenches[:, body, 3:] = cross(self.hand_position - self._hand_center, force)

    def step(self, refresh: bool) -> None:
        """Advance TIMESTEP_S. Without `refresh` only base and joint states and a first-order hand position are current."""
        self.batch.step()
        if refresh:
            # Before kinematics, which leave other robots' forces there.
            self.joint_torque = np.clip(self._actuator_force.T[self._actuators].T, -TORQUE_LIMIT, TORQUE_LIMIT)
            self._forward_kinematics()
            self._measure(np.arange(self.count))
        else:
            self.hand_position = self.hand_position + TIMESTEP_S * self.hand_velocity
        self._ctrl[:, self._actuators] = self._pending

    def _place(self, ids: np.ndarray) -> None:
        random, count = self._random, len(ids)
        yaw = random.uniform(-np.pi, np.pi, count)
        qpos = np.zeros((count, self._qpos.shape[1]))
        qpos[:, 2] = NOMINAL_BASE_HEIGHT_M
        qpos[:, 3], qpos[:, 6] = np.cos(yaw / 2), np.sin(yaw / 2)
        spread = np.array([0.06] * 12 + [np.pi] * 4 + [0.25] * 6)
        qpos[:, self._qpos_rows] = NOMINAL_POSITION + random.uniform(-spread, spread, (count, JOINT_COUNT))
        self.batch.state[ids] = 0.0
        self._qpos[ids] = qpos
        self._qvel[ids] = random.uniform(-0.1, 0.1, (count, self._qvel.shape[1]))
        targets = NOMINAL_POSITION.copy()
        targets[WHEEL_SLICE] = 0.0
        self._ctrl[np.ix_(ids, self._actuators)] = self._pending[ids] = targets
        self._forward_kinematics(ids)

    def _forward_kinematics(self, ids: np.ndarray | None = None) -> None:
        """Make positions and axes current. Contacts, half the cost of the stage that computes them, are left to the step."""
        flags = self._disable_flags.copy()
        self._disable_flags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self.batch.forward(ids=ids, stage=mujoco.mjtStage.mjSTAGE_POS)
        self._disable_flags[:] = flags

    def _measure(self, ids: np.ndarray) -> None:
        """Renew the attributes, and the terms of robots `ids`."""
        move(
            ids,
            self._qpos,
            self._qvel,
            self._axes,
            self._anchors,
            self._site_positions,
            self._site_rotations,
            self._joint_ids,
            self._qpos_rows,
            self._dof_rows,
            self._sites,
            self._kinematics,
            self.terms,
        )
        weigh(
            ids,
            self._kinematics["base_position"],
            self._axes,
            self._anchors,
            self._centers,
            self._principal_axes,
            self._joint_ids,
            self._nominal_masses,
            self._nominal_inertias,
            self._carries,
            self._armature,
            self.terms,
        )
        self._hand_center = self._centers[:, self._hand_body].copy(order="F")
        for name in KINEMATICS.names or ():
            setattr(self, name, self._kinematics[name].copy(order="F"))

    def _randomize(self, config: Randomization) -> None:
        batch, model, random, count = self.batch, self.model, self._random, self.count
        scale = np.ones((count, model.nbody)) * random.uniform(*config.mass_scale, (count, 1))
        scale[:, self._tool_bodies] *= random.uniform(*config.tool_mass_scale, (count, 1))
        masses, inertias = batch.expand("body_mass"), batch.expand("body_inertia")
        masses[:] = scale * self._nominal_masses
        inertias[:] = scale[:, :, None] * self._nominal_inertias
        self.mass_scale = masses.sum(axis=1) / self._nominal_masses.sum()
        arm = self._carries[ARM_SLICE.start]
        parts = np.stack([arm, 1.0 - arm])
        self.mass_scales = masses @ parts.T / (parts @ self._nominal_masses)
        friction = batch.expand("geom_friction")
        wheels = [model.geom(f"{leg}_wheel").id for leg in LEGS]
        self.wheel_friction = random.uniform(*config.wheel_friction, count)
        friction[:, wheels, 0] = self.wheel_friction[:, None]
        gains, biases = batch.expand("actuator_gainprm"), batch.expand("actuator_biasprm")
        stiffness = random.uniform(*config.gain_scale, (count, model.nu))
        gains[:, :, 0] *= stiffness
        biases[:, :, 1] *= stiffness
        # A wheel's gain is its damping: both must scale alike or its velocity would be off.
        is_wheel = np.isin(np.arange(model.nu), self._actuators[WHEEL_SLICE])
        damping = np.where(is_wheel, stiffness, random.uniform(*config.gain_scale, (count, model.nu)))
        biases[:, :, 2] *= damping
        self.gain_scales = np.stack([stiffness.mean(axis=1), damping.mean(axis=1)], axis=1)
        dry = random.uniform(*config.dry_friction_nm, count) * (random.random(count) < config.dry_friction_share)
        frictionloss = batch.expand("dof_frictionloss")
        frictionloss[:, self._dof_rows] = dry[:, None]
        batch.set_const()


def _carries(model: mujoco.MjModel, joint_ids: np.ndarray) -> np.ndarray:
    """(22, bodies): 1 where a joint carries a body."""
    carries = np.zeros((len(joint_ids), model.nbody))
    for row, joint in enumerate(joint_ids):
        for body in range(1, model.nbody):
            ancestor = body
            while ancestor not in (0, model.jnt_bodyid[joint]):
                ancestor = model.body_parentid[ancestor]
            carries[row, body] = ancestor != 0
    return carries
