"""The training environment: many robots under random commands, seen as the policy sees one (control.policy.observation).

One `step`: targets -> two physics steps with the contacts' forces -> reward from truth -> new references, estimate and
observation. What the policy and the teacher get carries sensor noise and the estimator's errors; only rewards and the
critic's privileged part see truth.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from control.command.limits import CommandLimits
from control.joints import JOINT_COUNT, NOMINAL_BASE_HEIGHT_M
from control.policy.action import ActionMap
from control.policy.observation import EXTENDED_FORM, MEMORYLESS_FORM, PAPER_FORM, RESIDUAL_FORM, Observation, advance_phase
from control.robot_model import RobotModel
from control.timing import CONTROL_PERIOD_S
from control.whole_body.arm import ArmConfig
from control.whole_body.model_based import ModelBasedConfig, ModelBasedLaw
from control.whole_body.reference_correction import CORRECTION
from control.whole_body.stance import StanceConfig
from control.whole_body.task_memory import TASK_MEMORY, TaskMemory, TaskMemoryConfig
from control.whole_body.task_signals import TASK_SIGNALS
from control.whole_body.wheels import WheelConfig
from sim.training.batch_rotations import (
    products,
    quaternions_from_rotations,
    rotate_back,
    rotation_errors,
    rotations_from_quaternions,
)
from sim.training.commands import LEAD, SLIDE, CommandRanges, CommandSource
from sim.training.contact_environment import ContactEnvironment, ContactRanges
from sim.training.references import BatchedReferences
from sim.training.rewards import RewardInput, RewardScales, rewards
from sim.training.robot import SUBSTEPS, BatchedRobot, Randomization
from sim.training.surrogate import EstimatorSurrogate, SurrogateParameters, fitted_surrogate

PRIVILEGED_SIZE = 23
_ALL = slice(None)

_MEMORYLESS = (PAPER_FORM, MEMORYLESS_FORM)


def imitated(form: str) -> ModelBasedConfig:
    """The model-based controller without what robots that imitate it cannot follow: the approach to contact, the load that axes
    in motion carry, a stance far ahead of the wheels, and integrals that observations of a form do not tell. Those grow to
    their bounds, and nobody learns anything but these. What the force integral did is left to a higher gain, braked less. From
    0.5 on a hand with all axes on force rings on a soft spring.
    """
    arm, wheels = replace(ArmConfig(), contact_share=0.0, load_gain=0.0), WheelConfig()
    if form in _MEMORYLESS:
        arm = replace(arm, integral_gain=0.0, force_integral_gain=0.0, force_gain=0.35, force_velocity_feedback=0.6)
        wheels = replace(wheels, yaw_integral_gain=0.0)
    return ModelBasedConfig(arm=arm, wheels=wheels, stance=StanceConfig(lead_m=0.01))


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """Standard deviation of the white noise on what is observed, up to twice that of the full simulation's pipeline.

    `mass_scale` is that of estimated masses, which stay wrong.
    """

    joint_position_rad: float = 1e-3
    joint_velocity_rps: float = 0.02
    joint_torque_nm: float = 0.1
    angular_velocity_rps: float = 0.007
    gravity: float = 5e-4
    hand_position_m: float = 5e-4
    hand_orientation_rad: float = 7e-4
    rolling_velocity_mps: float = 0.005
    mass_scale: float = 0.03


@dataclass(frozen=True, slots=True)
class TrainingEnvConfig:
    """What the environment is made of. `episode_s` ends episodes; fallen robots start anew at once. `teacher` is what is
    imitated, by default `imitated(form)`; a residual policy corrects the controller as it runs on the robot.
    """

    count: int = 512
    threads: int = 1
    seed: int = 0
    form: str = EXTENDED_FORM
    episode_s: float = 20.0
    fallen_gravity_z: float = -0.75
    fallen_height_m: float = 0.2
    commands: CommandRanges = field(default_factory=CommandRanges)
    contacts: ContactRanges = field(default_factory=ContactRanges)
    randomization: Randomization = field(default_factory=Randomization)
    noise: SensorNoise = field(default_factory=SensorNoise)
    rewards: RewardScales = field(default_factory=RewardScales)
    teacher: ModelBasedConfig | None = None
    surrogate: SurrogateParameters | None = None


@dataclass(frozen=True, slots=True)
class StepResult:
    """Attributes:
    reward: (n, 2) locomotion and end effector. done: (n,) bool.
    ended: (k,) robots whose time was up (not fallen), with their last observation (k, o) and privileged part (k, p):
        the value of that state, not zero, follows.
    state: what the reward was computed from. mask: (n, 3). segment_s: (n,) time since the command changed.
    """

    reward: np.ndarray
    done: np.ndarray
    ended: np.ndarray
    last_observation: np.ndarray
    last_privileged: np.ndarray
    state: RewardInput
    mask: np.ndarray
    segment_s: np.ndarray


class TrainingEnv:
    """n robots. `observation` and `privileged` are current after construction and after every `step`."""

    def __init__(self, config: TrainingEnvConfig) -> None:
        """
        Raises:
            SurrogateError: no surrogate is given and none has been fitted.
        """
        self.config, count = config, config.count
        random = self._random = np.random.default_rng(config.seed)
        self.robot = BatchedRobot(count, config.threads, config.randomization, random)
        self.source = CommandSource(count, config.commands, random)
        self.references = BatchedReferences(count, CommandLimits())
        self.contacts = ContactEnvironment(self.robot, self.source, config.contacts, random)
        surrogate = config.surrogate or fitted_surrogate()
        self.estimator = EstimatorSurrogate(surrogate, self.robot.mass_scale, random)
        self._mass_scales = self.robot.mass_scales + config.noise.mass_scale * random.standard_normal((count, 2))
        self._corrects = config.form == RESIDUAL_FORM
        teacher = config.teacher or (ModelBasedConfig() if self._corrects else imitated(config.form))
        self._teacher = ModelBasedLaw(RobotModel(), teacher, count)
        self._no_correction = np.zeros(count, CORRECTION)
        self.memory = TaskMemory(TaskMemoryConfig(), count)
        self.form = Observation(config.form)
        self.action_map = ActionMap()
        self._action = np.zeros((count, JOINT_COUNT))
        self._phase = np.zeros(count)
        self._hand_force = np.zeros((count, 3), order="F")
        # Robots start at different ages, so that they do not all start anew together.
        self._age_s = random.uniform(0.0, config.episode_s, count)
        everyone = np.arange(count)
        self._reset(everyone)
        self._draw(everyone)
        self._hand = self._measured_hand()
        self._observe()

    @property
    def observation_size(self) -> int:
        """Length of an observation."""
        return self.form.size

    def teacher_action(self) -> np.ndarray:
        """Action (n, 22) of the teacher at the current observation; call once per step."""
        return self.action_map.actions(self._teacher_targets(self._no_correction))

    def _teacher_targets(self, corrections: np.ndarray) -> np.ndarray:
        return self._teacher.targets(self.robot.terms, self.signals, self.memory.values, corrections)

    def step(self, action: np.ndarray) -> StepResult:
        """Act (n, 22) for one control period; with the residual form the action corrects the teacher's."""
        config, robot = self.config, self.robot
        action = action.astype(float)
        if self._corrects:
            targets = self._teacher_targets(self.action_map.reference_corrections(action))
            action = self.action_map.corrected_actions(targets, action)
        else:
            action = self.action_map.limited(action)
        robot.set_targets(self.action_map.targets(action))
        mean_force = np.zeros_like(self._hand_force)
        for substep in range(SUBSTEPS):
            force = self.contacts.force()
            robot.apply_hand_force(force)
            robot.step(refresh=substep == SUBSTEPS - 1)
            mean_force += force / SUBSTEPS
        self._hand_force = rotate_back(robot.rotation_heading_to_world, mean_force)
        change, self._action = action - self._action, action
        self._phase = advance_phase(self._phase)
        state = self._judge(change)
        reward = self._reward(state)
        mask, segment_s = self.references.applied["mask"].copy(), self.source.time_s.copy()

        self._age_s += CONTROL_PERIOD_S
        done = state.fallen | (self._age_s >= config.episode_s)
        ended = np.flatnonzero(done & ~state.fallen)
        self._advance_references()
        self._observe()
        last = self.observation[ended], self.privileged[ended]
        fresh = np.flatnonzero(done)
        if fresh.size:
            self._age_s[fresh] = 0.0
            self._reset(fresh)
        drawn = np.flatnonzero(done | (self.source.time_s >= self.source.duration_s))
        if drawn.size:
            self._draw(drawn)
        if fresh.size:
            self._observe_fresh(fresh)
        return StepResult(reward, done, ended, *last, state, mask, segment_s)

    def _reset(self, ids: np.ndarray) -> None:
        self.robot.reset(ids)
        self._teacher.reset(ids)
        self.memory.reset(ids)
        self.estimator.reset(ids)
        self._action[ids] = 0.0
        self._phase[ids] = 0.0
        self._hand_force[ids] = 0.0
        self.references.reset(ids, self._measured_hand(ids), self._hand_orientation(ids))

    def _draw(self, ids: np.ndarray) -> None:
        self.source.draw(ids, self._measured_hand(ids), self._hand_orientation(ids))
        self.contacts.draw(ids)

    def _measured_hand(self, ids: np.ndarray | slice = _ALL) -> np.ndarray:
        """Hands (m, 3) in heading, as kinematics give them: height above the wheels' contact points."""
        robot = self.robot
        hand = rotate_back(robot.rotation_heading_to_world[ids], robot.hand_position[ids] - robot.base_position[ids])
        hand[:, 2] += self._base_height(ids)
        return hand

    def _hand_orientation(self, ids: np.ndarray) -> np.ndarray:
        """Hands' (m, 4) wxyz in heading."""
        heading = self.robot.rotation_heading_to_world[ids]
        return quaternions_from_rotations(heading.transpose(0, 2, 1) @ self.robot.hand_rotation[ids])

    def _base_height(self, ids: np.ndarray | slice = _ALL) -> np.ndarray:
        """Heights (m,) m above the mean of the middle two contact points."""
        contacts = self.robot.contact_positions[ids, :, 2]
        middle = contacts.sum(axis=1) - contacts.max(axis=1) - contacts.min(axis=1)
        return self.robot.base_position[ids, 2] - 0.5 * middle

    def _advance_references(self) -> None:
        robot, noise = self.robot, self.config.noise
        forward = rotate_back(robot.rotation_heading_to_world, robot.base_linear_velocity)
        self.estimator.step(self._hand_force, np.stack([forward[:, 0], robot.base_angular_velocity[:, 2]]).T)
        self._hand = self._noisy(self._measured_hand(), noise.hand_position_m)
        self.source.advance(self._hand, self.estimator.force, CONTROL_PERIOD_S)
        self.references.step(self.source.commands, self._hand, self.estimator.force, CONTROL_PERIOD_S)

    def _observe(self) -> None:
        self.signals = self._sense()
        self.memory.step(self.signals)
        self.observation = self.form.assemble(self.signals, self.memory.values, self._action, self._phase)
        self.privileged = self._privileged()

    def _observe_fresh(self, ids: np.ndarray) -> None:
        """Let robots that have just started be seen in their new state; the others stay as they were seen."""
        self._hand[ids] = self._measured_hand(ids)
        signals = self.signals[ids] = self._sense(ids)
        nothing = np.zeros(len(ids), TASK_MEMORY)
        self.observation[ids] = self.form.assemble(signals, nothing, self._action[ids], self._phase[ids])
        self.privileged = self._privileged()

    def _sense(self, ids: np.ndarray | slice = _ALL) -> np.ndarray:
        """Measurements TASK_SIGNALS (m,) of robots `ids`, with noise."""
        robot, noise, applied = self.robot, self.config.noise, self.references.applied[ids]
        rotation, heading = robot.rotation_base_to_world[ids], robot.rotation_heading_to_world[ids]
        count = len(heading)
        target = products(heading, rotations_from_quaternions(applied["orientation_wxyz"]))
        velocity = rotate_back(heading, robot.rolling_velocity[ids])
        turn = rotate_back(heading, rotation_errors(target, robot.hand_rotation[ids]))
        signals = np.empty(count, TASK_SIGNALS)
        noisy = {
            "angular_velocity": (robot.angular_velocity_in_base[ids], noise.angular_velocity_rps),
            "gravity": (-rotation[:, 2], noise.gravity),
            "base_linear_velocity": (velocity, noise.rolling_velocity_mps),
            "base_height": (self._base_height(ids), noise.hand_position_m),
            "yaw_rate": (robot.base_angular_velocity[ids, 2], noise.angular_velocity_rps),
            "joint_position": (robot.joint_position[ids], noise.joint_position_rad),
            "joint_velocity": (robot.joint_velocity[ids], noise.joint_velocity_rps),
            "joint_torque": (robot.joint_torque[ids], noise.joint_torque_nm),
            "orientation_error": (turn, noise.hand_orientation_rad),
        }
        for name, (values, deviation) in noisy.items():
            signals[name] = self._noisy(values, deviation)
        signals["hand_position"] = self._hand[ids]
        signals["force_estimated_n"] = self.estimator.force[ids]
        signals["mass_scales"] = self._mass_scales[ids]
        signals["command"] = applied
        return signals

    def _privileged(self) -> np.ndarray:
        """(n, 23) truth for the critic alone."""
        robot, applied = self.robot, self.references.applied
        heading = robot.rotation_heading_to_world
        hand = self._true_hand()
        force_error = applied["mask"] * (self._hand_force - applied["force_n"])
        arm = rotate_back(heading, robot.hand_velocity_from_arm)
        parts = [
            2.0 * rotate_back(heading, robot.base_linear_velocity),
            10.0 * (robot.base_position[:, 2:] - NOMINAL_BASE_HEIGHT_M),
            4.0 * (applied["position_m"] - hand),
            self.signals["orientation_error"],
            0.1 * self._hand_force,
            0.2 * force_error,
            arm,
            self.contacts.stiffness_of_force_axes() * 0.002,
            5.0 * (robot.mass_scale[:, None] - 1.0),
        ]
        return np.clip(np.concatenate(parts, axis=1, dtype=np.float32, casting="same_kind"), -8.0, 8.0)

    def _judge(self, action_change: np.ndarray) -> RewardInput:
        robot, applied = self.robot, self.references.applied
        heading = robot.rotation_heading_to_world
        velocity = rotate_back(heading, robot.base_linear_velocity)
        target = products(heading, rotations_from_quaternions(applied["orientation_wxyz"]))
        gravity = -robot.rotation_base_to_world[:, 2]
        height = robot.base_position[:, 2]
        return RewardInput(
            velocity_error=velocity[:, :2] - applied["base_velocity"][:, :2],
            yaw_error=robot.base_angular_velocity[:, 2] - applied["base_velocity"][:, 2],
            heave=velocity[:, 2],
            height=height,
            rocking=robot.angular_velocity_in_base[:, :2],
            gravity_xy=gravity[:, :2],
            position_error=(1.0 - applied["mask"]) * (self._true_hand() - applied["position_m"]),
            orientation_error=rotation_errors(target, robot.hand_rotation),
            drags=self.source.kind == SLIDE,
            force_error=applied["mask"] * (self._hand_force - applied["force_n"]),
            lead_force=(self.source.kind == LEAD) * np.linalg.norm(self._hand_force, axis=1),
            joint_position=robot.joint_position,
            joint_velocity=robot.joint_velocity,
            joint_torque=robot.joint_torque,
            action_change=action_change,
            # Written so that a state that is not a number counts as fallen.
            fallen=~((gravity[:, 2] <= self.config.fallen_gravity_z) & (height >= self.config.fallen_height_m)),
        )

    def _reward(self, state: RewardInput) -> np.ndarray:
        return rewards(self.config.rewards, state)

    def _true_hand(self) -> np.ndarray:
        robot = self.robot
        return rotate_back(robot.rotation_heading_to_world, robot.hand_position - robot.base_position * [1.0, 1.0, 0.0])

    def _noisy(self, values: np.ndarray, deviation: float) -> np.ndarray:
        """`values` (m,) or (m, k) with white noise."""
        return values + deviation * self._random.standard_normal(values.T.shape).T
