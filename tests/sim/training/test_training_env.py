"""The batched environment against the single-robot code it stands for, and the laws of its contacts and rewards."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from control.command.command_record import commands, from_record, to_record
from control.command.filter import CommandFilter
from control.command.limits import CommandLimits, HandState
from control.frames import quaternion_from_rotation
from control.joints import LEG_SLICE
from control.policy.action import ActionScales
from control.policy.observation import MEMORYLESS_FORM, PAPER_FORM, RESIDUAL_FORM
from control.policy.policy_controller import PolicyController
from control.policy.policy_weights import PolicyManifest, interface, load_policy, save_policy
from control.robot_model import RobotModel
from control.timing import CONTROL_PERIOD_S
from control.types import BaseState, SensorFrame
from control.whole_body.body_terms import BODY_TERMS, body_terms
from control.whole_body.controller import ControllerInput
from control.whole_body.model_based import ModelBasedConfig, ModelBasedController
from control.whole_body.task_signals import TASK_SIGNALS, task_signals
from sim.training.batch_rotations import rotate, rotate_back
from sim.training.commands import LEAD, SLIDE, CommandRanges
from sim.training.contact_environment import HAND_INERTIA_KG
from sim.training.env import SensorNoise, TrainingEnv, TrainingEnvConfig
from sim.training.references import BatchedReferences
from sim.training.rewards import RewardScales, rewards
from sim.training.robot import NO_RANDOMIZATION, TIMESTEP_S
from sim.training.surrogate import LowPass, SurrogateParameters

SURROGATE = SurrogateParameters(6.0, 0.67, 0.0, (0.0,) * 3, (0.0,) * 3, ((0.0,) * 4,) * 3, (0.0,) * 3, 0.9)
SILENT = SensorNoise(**{field.name: 0.0 for field in fields(SensorNoise)})


@pytest.fixture(scope="module")
def model() -> RobotModel:
    return RobotModel()


def make_env(count: int = 8, **changes: object) -> TrainingEnv:
    config = TrainingEnvConfig(
        count=count,
        commands=CommandRanges(hands=40),
        randomization=NO_RANDOMIZATION,
        noise=SILENT,
        surrogate=SURROGATE,
    )
    env = TrainingEnv(replace(config, **changes))
    env._age_s[:] = 0.0
    return env


def single_input(env: TrainingEnv, index: int, model: RobotModel) -> ControllerInput:
    """What the controller of robot `index` would get in the pipeline, with the batch's measurements."""
    robot, signals = env.robot, env.signals[index]
    rotation = robot.rotation_base_to_world[index]
    heading = robot.rotation_heading_to_world[index]
    velocity = rotation.T @ heading @ signals.base_linear_velocity
    sensor = SensorFrame(
        time_s=0.0,
        orientation_wxyz=quaternion_from_rotation(rotation),
        angular_velocity=signals.angular_velocity,
        linear_acceleration=np.array([0.0, 0.0, 9.81]),
        joint_position=signals.joint_position,
        joint_velocity=signals.joint_velocity,
        joint_torque=signals.joint_torque,
    )
    model.update(rotation, sensor.joint_position, velocity, sensor.angular_velocity, sensor.joint_velocity)
    command = from_record(env.signals["command"][[index]], guidance=False)
    base = BaseState(rotation, velocity, sensor.angular_velocity, signals.base_height)
    return ControllerInput(sensor, base, model, command, signals.force_estimated_n, signals.mass_scales)


def test_the_terms_of_the_batch_are_those_of_the_robot_model(model: RobotModel):
    env = make_env(count=4)
    for _ in range(20):
        env.step(env.teacher_action())
    for robot in range(4):
        single, batch = body_terms(single_input(env, robot, model).model), env.robot.terms[[robot]]
        for name in BODY_TERMS.names or ():
            assert np.allclose(single[name], batch[name], atol=1e-9), name


def test_every_robot_of_the_batch_is_taught_by_the_model_based_controller(model: RobotModel):
    env = make_env(count=8, teacher=ModelBasedConfig())
    controllers = [ModelBasedController(model) for _ in range(8)]
    for _ in range(60):
        expected = [controller.step(single_input(env, robot, model)) for robot, controller in enumerate(controllers)]
        action = env.teacher_action()
        assert np.allclose(action, env.action_map.actions(np.array(expected)), atol=1e-8)
        assert not env.step(action).done.any()


def test_batch_and_single_robot_share_the_observed_signals(model: RobotModel):
    env = make_env(count=3)
    for _ in range(20):
        env.step(env.teacher_action())
    for index in range(3):
        single, batch = task_signals(single_input(env, index, model)), env.signals[[index]]
        for name in set(TASK_SIGNALS.names or ()) - {"command"}:
            assert np.allclose(single[name], batch[name], atol=1e-9), name
        assert np.array_equal(single["command"], batch["command"])


def test_references_of_the_batch_are_those_of_its_robots():
    random, limits, count = np.random.default_rng(3), CommandLimits(), 3
    hands = np.array([[0.55, 0.02, 0.5], [0.6, -0.1, 0.4], [0.5, 0.1, 0.6]])
    asked, batch, singles = commands(count), BatchedReferences(count, limits), [CommandFilter(limits) for _ in range(count)]
    batch.reset(np.arange(count), hands, np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)))
    for step in range(120):
        if step % 40 == 0:
            asked["mask"] = random.random((count, 3)) < 0.4
            asked["force_n"] = random.uniform(-20.0, 20.0, (count, 3))
            asked["position_m"] = hands + random.uniform(-0.1, 0.1, (count, 3))
            quaternion = random.standard_normal((count, 4))
            asked["orientation_wxyz"] = quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
            asked["base_velocity"] = random.uniform(-0.1, 0.1, (count, 3))
        forces = random.standard_normal((count, 3))
        batch.step(asked, hands, forces, CONTROL_PERIOD_S)
        for robot, single in enumerate(singles):
            hand = HandState(hands[robot], np.eye(3), forces[robot])
            applied = single.step(from_record(asked[[robot]], guidance=False), hand, CONTROL_PERIOD_S)
            assert np.array_equal(to_record(applied), batch.applied[[robot]])


def test_teacher_stands_drives_and_regulates_force_in_the_training_world():
    env = make_env(count=64)
    falls, force, velocity = 0, [], []
    for _ in range(200):
        # A hand that is asked for no force holds at a border, whatever pulls it there.
        asked = env.signals["command"]["force_n"] != 0.0
        result = env.step(env.teacher_action())
        falls += int(result.state.fallen.sum())
        late = result.segment_s > 1.0
        force.append(result.state.force_error[late][(result.mask[late] > 0.5) & asked[late]])
        velocity.append(result.state.velocity_error[late, 0])
    assert falls <= 3
    assert np.sqrt(np.mean(np.concatenate(force) ** 2)) < 5.0
    assert np.sqrt(np.mean(np.concatenate(velocity) ** 2)) < 0.12


def test_low_pass_matches_its_step_response():
    w, z, dt = 4.5, 0.67, CONTROL_PERIOD_S
    low_pass = LowPass((1,), w, z, dt)
    times = dt * np.arange(1, 101)
    response = np.array([low_pass.step(np.ones(1))[0] for _ in times])
    damped = w * np.sqrt(1 - z * z)
    exact = 1 - np.exp(-z * w * times) * (np.cos(damped * times) + z * w / damped * np.sin(damped * times))
    assert np.allclose(response, exact, atol=1e-9)


def test_springs_start_relaxed_and_pull_back():
    env = make_env(count=16)
    env.source.time_s[:] = 0.0
    env.robot.hand_velocity[:] = 0.0
    env.contacts._swing[:] = 0.0
    env.contacts._glide[:] = 0.0
    start = env.contacts.force()
    env.robot.hand_position = env.robot.hand_position + [0.0, 0.0, 0.01]
    pulled = env.contacts.force()
    assert np.abs(start[:, 2]).max() < 1e-6
    stiffness, damping = env.contacts._stiffness[:, 2], env.contacts._damping[:, 2]
    # Taken implicitly over one step for the least inertia of the hand.
    softened = stiffness / (1.0 + TIMESTEP_S / HAND_INERTIA_KG * (damping + TIMESTEP_S * stiffness))
    assert np.allclose((pulled - start)[:, 2], -0.01 * softened, atol=1e-6)


def test_steady_sliding_meets_the_whole_friction():
    env = make_env(count=64)
    rows = np.flatnonzero(env.source.kind == SLIDE)
    axes = env.source.slide_axis[rows]
    contacts, robot = env.contacts, env.robot
    moving = np.zeros((64, 3))
    moving[rows, axes] = 0.1
    robot.hand_velocity = rotate(contacts._rotation, moving)
    for _ in range(60):
        contacts.force()
    slid = rotate_back(contacts._rotation, contacts.force())[rows, axes]
    expected = -0.1 * contacts._viscous[rows, axes] - contacts._dry[rows, axes]
    assert np.allclose(slid, expected, rtol=1e-3, atol=1e-3)


def test_what_is_dragged_travels_as_its_friction_says():
    env = make_env(count=64)
    sliding = env.source.kind == SLIDE
    assert sliding.any()
    rows, axes = np.flatnonzero(sliding), env.source.slide_axis[sliding]
    amplitude, rate = env.source.wave_amplitude[rows, axes], env.source.wave_rate[rows]
    travel = amplitude / (rate * env.contacts._viscous[rows, axes])
    assert ((travel > 0.059) & (travel < 0.201)).all()


def test_rewards_are_largest_without_error_and_fixed_at_a_fall():
    env = make_env(count=4)
    state = env.step(env.teacher_action()).state
    errors = ("velocity_error", "yaw_error", "position_error", "force_error")
    zero = {name: np.zeros_like(getattr(state, name)) for name in errors}
    best = rewards(RewardScales(), replace(state, **zero))
    assert (best >= rewards(RewardScales(), state) - 1e-12).all()
    fallen = rewards(RewardScales(), replace(state, fallen=np.ones(4, bool)))
    assert np.allclose(fallen, 0.1 * np.array([-5.0, -2.0]))


def test_leading_costs_the_base_its_reward_per_newton_of_the_person_alone():
    env = make_env(count=64)
    state = env.step(env.teacher_action()).state
    led = env.source.kind == LEAD
    assert led.any() and not led.all()
    assert np.allclose(state.lead_force[led], np.linalg.norm(env._hand_force[led], axis=1)) and not state.lead_force[~led].any()
    heavier = replace(state, lead_force=state.lead_force + 2.0)
    change = rewards(RewardScales(), heavier) - rewards(RewardScales(), state)
    assert np.allclose(change[~state.fallen], [-0.1 * 2.0 * RewardScales().lead, 0.0])


def test_ended_episodes_hand_over_their_last_observation():
    env = make_env(count=4, episode_s=0.2)
    for _ in range(12):
        result = env.step(env.teacher_action())
        assert result.last_observation.shape == (len(result.ended), env.observation_size)
        assert result.done[result.ended].all()
    assert np.isfinite(env.observation).all()


@pytest.mark.parametrize("form", [PAPER_FORM, MEMORYLESS_FORM])
def test_what_the_memoryless_imitate_remembers_nothing_that_they_do_not_see(form: str):
    """Whatever has been integrated before."""
    env, other = (make_env(count=4, form=form) for _ in range(2))
    for name in ("position_integral", "force_integral", "yaw_integral"):
        other.memory.values[name] = 0.3
    expected = env.teacher_action()
    assert np.abs(expected).max() > 0.01
    assert np.allclose(other.teacher_action(), expected, atol=1e-12)
    full = make_env(count=4, form=form, teacher=ModelBasedConfig())
    full.memory.values["position_integral"] = 0.3
    assert not np.allclose(full.teacher_action(), expected, atol=0.1)


def test_a_residual_policy_that_corrects_nothing_is_the_teacher():
    plain, corrected = make_env(count=4, teacher=ModelBasedConfig()), make_env(count=4, form=RESIDUAL_FORM)
    for _ in range(10):
        plain.step(plain.teacher_action())
        corrected.step(np.zeros((4, 22)))
    assert np.allclose(plain.robot.joint_position, corrected.robot.joint_position, atol=1e-9)
    largest = ActionScales().correction_limit
    corrected.step(np.full((4, 22), 50.0))
    teacher = plain.teacher_action()[:, LEG_SLICE]
    assert np.allclose(corrected._action[:, LEG_SLICE], np.clip(teacher + largest, -8.0, 8.0), atol=1e-6)


def test_training_corrects_as_the_policy_does_on_the_robot(tmp_path: Path, model: RobotModel):
    env = make_env(count=8, form=RESIDUAL_FORM)
    action = np.random.default_rng(4).uniform(-1.5, 1.5, 22)
    layers = (env.observation_size, 22)
    arrays = {"weight_0": np.zeros((22, layers[0])), "bias_0": action}
    save_policy(tmp_path, PolicyManifest("policy", RESIDUAL_FORM, interface(RESIDUAL_FORM), layers), arrays)
    controllers = [PolicyController(*load_policy("policy", tmp_path), model) for _ in range(8)]
    for _ in range(15):
        expected = [controller.step(single_input(env, robot, model)) for robot, controller in enumerate(controllers)]
        assert not env.step(np.tile(action, (8, 1))).done.any()
        assert np.allclose(env.action_map.targets(env._action), expected, atol=1e-5)
