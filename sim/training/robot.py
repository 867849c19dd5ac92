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
    JOINT_COUNT,
    JOINT_NAMES,
    LEGS,
    NOMINAL_BASE_HEIGHT_M,
    NOMINAL_POSITION,
    TORQUE_LIMIT,
    WHEEL_CENTER_FRAMES,
    WHEEL_HALF_WIDTH_M,
    WHEEL_RADIUS_M,
    WHEEL_SLICE,
)
from control.timing import CONTROL_PERIOD_S
from sim import scenes
from sim.training.batch_rotations import cross, headings, rotate, rotate_back, rotations_from_quaternions

TIMESTEP_S = 0.01
SUBSTEPS = round(CONTROL_PERIOD_S / TIMESTEP_S)
LEG_OF_JOINT = [joint // 3 for joint in range(WHEEL_SLICE.start)] + list(range(len(LEGS)))
"""The leg that each joint of legs and wheels belongs to."""


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
        axes, anchors: (n, 22, 3) of the joints. body_positions: (n, bodies, 3), centres of mass.
        arm_inertial_rotations: (n, 7, 3, 3), principal axes of the arm's links and the tool.
        hand_position, hand_velocity: (n, 3); hand_rotation (n, 3, 3). hand_jacobian: (n, 6, 3), by arm joint.
        contact_positions: (n, 4, 3), lowest points of the wheels.
        contact_jacobian: (n, 16, 3), of the contact that a joint of legs and wheels moves (LEG_OF_JOINT).
        rolling_velocity: (n, 3) m/s, of the base if those points stand still on average (control.estimation.rolling_contact).
        mass_scale: (n,) total mass over nominal.
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
    axes: np.ndarray
    anchors: np.ndarray
    body_positions: np.ndarray
    arm_inertial_rotations: np.ndarray
    hand_position: np.ndarray
    hand_velocity: np.ndarray
    hand_rotation: np.ndarray
    hand_jacobian: np.ndarray
    hand_velocity_from_arm: np.ndarray
    contact_positions: np.ndarray
    contact_jacobian: np.ndarray
    rolling_velocity: np.ndarray

    def __init__(self, count: int, threads: int, randomization: Randomization, random: np.random.Generator) -> None:
        self.count = count
        self._random = random
        self.model = model = training_model()
        self.nominal_dry_friction = scenes.build("free").model.dof_frictionloss[
            [model.joint(name).dofadr[0] for name in JOINT_NAMES]
        ]
        self.nominal_masses = model.body_mass.copy()
        self.nominal_inertias = model.body_inertia.copy()
        self.batch = batch = Batch(model, nsim=count, nthread=threads)
        joints = [model.joint(name) for name in JOINT_NAMES]
        self.joint_ids = np.array([joint.id for joint in joints])
        self._qpos_rows = np.array([joint.qposadr[0] for joint in joints])
        self._dof_rows = np.array([joint.dofadr[0] for joint in joints])
        self._actuators = np.array([model.actuator(name).id for name in JOINT_NAMES])
        self._hand_body = model.body("end_effector").id
        self.arm_bodies = [model.joint(name).bodyid[0] for name in ARM_JOINT_NAMES] + [self._hand_body]
        self._qpos, self._qvel, self._ctrl = batch.bind("qpos"), batch.bind("qvel"), batch.bind("ctrl")
        self._wrenches, self._actuator_force = batch.bind("xfrc_applied"), batch.bind("actuator_force")
        self._disable_flags = batch.expand("opt.disableflags")
        hand, wheels = model.site("end_effector").id, [model.site(name).id for name in WHEEL_CENTER_FRAMES]
        # What kinematics gather from the batch, and where its components lie in a robot's row.
        self._gathered = {
            "axes": (batch.bind("xaxis"), _component_rows(self.joint_ids, 3)),
            "anchors": (batch.bind("xanchor"), _component_rows(self.joint_ids, 3)),
            "body_positions": (batch.bind("xipos"), _component_rows(np.arange(model.nbody), 3)),
            "arm_inertial_rotations": (batch.bind("ximat"), _component_rows(np.array(self.arm_bodies), 3, 3)),
            "hand_position": (batch.bind("site_xpos"), _component_rows(hand, 3)),
            "hand_rotation": (batch.bind("site_xmat"), _component_rows(hand, 3, 3)),
            "wheel_centers": (batch.bind("site_xpos"), _component_rows(np.array(wheels), 3)),
        }
        self.late = random.random(count) < randomization.late_share
        self._randomize(randomization)
        self._pending = np.zeros((count, JOINT_COUNT), order="F")
        everyone = np.arange(count)
        self._place(everyone)
        vars(self).update(self._kinematics(everyone), joint_torque=np.zeros((count, JOINT_COUNT), order="F"))

    def reset(self, ids: np.ndarray) -> None:
        """Put robots on their wheels near the nominal posture, facing anywhere."""
        self._place(ids)
        for name, fresh in (self._kinematics(ids) | {"joint_torque": np.zeros((len(ids), JOINT_COUNT))}).items():
            values = getattr(self, name).copy(order="F")
            values[ids] = fresh
            setattr(self, name, values)

    def set_targets(self, targets: np.ndarray) -> None:
        """Joint targets (n, 22) for the steps to come; late robots keep their old ones through the next step."""
        self._ctrl[:, self._actuators] = np.where(self.late[:, None], self._pending, targets)
        self._pending = targets.copy(order="F")

    def apply_hand_force(self, force: np.ndarray) -> None:
        """Force (n, 3), N, in world, of the environment on the hand until it is set again."""
        body = self._hand_body
        self._wrenches[:, body, :3] = force
        self._wrenches[:, body, 3:] = cross(self.hand_position - self.body_positions[:, body], force)

    def step(self, refresh: bool) -> None:
        """Advance TIMESTEP_S. Without `refresh` only base and joint states and a first-order hand position are current."""
        self.batch.step()
        if refresh:
            # Before kinematics, which leave other robots' forces there.
            torque = np.clip(_gather(self._actuator_force, self._actuators), -TORQUE_LIMIT, TORQUE_LIMIT)
            self._forward_kinematics()
            vars(self).update(self._kinematics(slice(None)), joint_torque=torque)
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

    def _kinematics(self, ids: np.ndarray | slice) -> dict[str, np.ndarray]:
        """Attributes by name, of robots `ids`."""
        qpos, qvel = self._qpos[ids], self._qvel[ids]
        base_position, base_linear_velocity = _gather(qpos, np.arange(3)), _gather(qvel, np.arange(3))
        rotation = rotations_from_quaternions(qpos[:, 3:7])
        angular_velocity_in_base = _gather(qvel, np.arange(3, 6))
        angular_velocity = rotate(rotation, angular_velocity_in_base)
        joint_velocity = _gather(qvel, self._dof_rows)
        gathered = {name: _gather(field[ids], rows) for name, (field, rows) in self._gathered.items()}
        axes, anchors, hand_position = gathered["axes"], gathered["anchors"], gathered["hand_position"]
        hand_jacobian = cross(axes[:, ARM_SLICE], hand_position[:, None] - anchors[:, ARM_SLICE])
        from_arm = rotate_back(hand_jacobian, joint_velocity[:, ARM_SLICE])
        from_base = base_linear_velocity + cross(angular_velocity, hand_position - base_position)
        contacts = gathered.pop("wheel_centers") + _lowest_point(axes[:, WHEEL_SLICE])
        moving = slice(0, len(LEG_OF_JOINT))
        contact_jacobian = cross(axes[:, moving], contacts[:, LEG_OF_JOINT] - anchors[:, moving])
        from_legs = rotate_back(contact_jacobian, joint_velocity[:, moving]) / len(LEGS)
        return gathered | {
            "base_position": base_position,
            "rotation_base_to_world": rotation,
            "rotation_heading_to_world": headings(rotation),
            "base_linear_velocity": base_linear_velocity,
            "base_angular_velocity": angular_velocity,
            "angular_velocity_in_base": angular_velocity_in_base,
            "joint_position": _gather(qpos, self._qpos_rows),
            "joint_velocity": joint_velocity,
            "hand_velocity": from_base + from_arm,
            "hand_jacobian": hand_jacobian,
            "hand_velocity_from_arm": from_arm,
            "contact_positions": contacts,
            "contact_jacobian": contact_jacobian,
            "rolling_velocity": -cross(angular_velocity, contacts.mean(axis=1) - base_position) - from_legs,
        }

    def _randomize(self, config: Randomization) -> None:
        batch, model, random, count = self.batch, self.model, self._random, self.count
        scale = np.ones((count, model.nbody)) * random.uniform(*config.mass_scale, (count, 1))
        scale[:, self.arm_bodies[-2:]] *= random.uniform(*config.tool_mass_scale, (count, 1))
        masses, inertias = batch.expand("body_mass"), batch.expand("body_inertia")
        masses[:] = scale * self.nominal_masses
        inertias[:] = scale[:, :, None] * self.nominal_inertias
        self.mass_scale = masses.sum(axis=1) / self.nominal_masses.sum()
        friction = batch.expand("geom_friction")
        wheels = [model.geom(f"{leg}_wheel").id for leg in LEGS]
        friction[:, wheels, 0] = random.uniform(*config.wheel_friction, (count, 1))
        gains, biases = batch.expand("actuator_gainprm"), batch.expand("actuator_biasprm")
        stiffness = random.uniform(*config.gain_scale, (count, model.nu))
        gains[:, :, 0] *= stiffness
        biases[:, :, 1] *= stiffness
        # A wheel's gain is its damping: both must scale alike or its velocity would be off.
        is_wheel = np.isin(np.arange(model.nu), self._actuators[WHEEL_SLICE])
        biases[:, :, 2] *= np.where(is_wheel, stiffness, random.uniform(*config.gain_scale, (count, model.nu)))
        dry = random.uniform(*config.dry_friction_nm, count) * (random.random(count) < config.dry_friction_share)
        frictionloss = batch.expand("dof_frictionloss")
        frictionloss[:, self._dof_rows] = dry[:, None]
        batch.set_const()


def _gather(values: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Components `rows` of robots' rows (n, ...), in Fortran order: shape (n, *reversed(rows.shape))."""
    return values.reshape(len(values), -1).T[rows].T


def _component_rows(items: np.ndarray | int, *shape: int) -> np.ndarray:
    """Rows for `_gather` that yield `items` (k,) or one item of `shape` each: (n, k, *shape) or (n, *shape)."""
    size = int(np.prod(shape))
    return (np.asarray(items)[..., None] * size + np.arange(size)).reshape(*np.shape(items), *shape).T


def _lowest_point(axes: np.ndarray) -> np.ndarray:
    """Lowest point (n, 4, 3) of the wheel ellipsoids from their centres, axes (n, 4, 3), see control.robot_model."""
    flattening = WHEEL_HALF_WIDTH_M**2 - WHEEL_RADIUS_M**2
    tilt = axes[..., 2:]
    offset = -flattening * tilt * axes
    offset[..., 2] -= WHEEL_RADIUS_M**2
    return offset / np.sqrt(WHEEL_RADIUS_M**2 + flattening * tilt * tilt)
