"""The policy at run time: its weights are refused when anything differs, and it starts where another controller left off."""

import json
import pickle
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch

from control.command.limits import DEFAULT_COMMAND
from control.joints import DAMPING, LEG_SLICE, NOMINAL_POSITION, STIFFNESS, WHEEL_SLICE
from control.learning.policy.actor_critic import HIDDEN, ActorCritic
from control.paths import WEIGHTS_DIRECTORY
from control.pipeline import PipelineConfig
from control.policy.action import ActionMap, ActionScales
from control.policy.actor import Actor
from control.policy.observation import EXTENDED_FORM, PAPER_FORM, RESIDUAL_FORM, Observation
from control.policy.policy_controller import PolicyController, make_policies
from control.policy.policy_weights import (
    PolicyManifest,
    PolicyWeightsError,
    available_policies,
    interface,
    load_policy,
    save_policy,
)
from control.robot_model import RobotModel
from control.types import BaseState, SensorFrame
from control.whole_body.controller import ControllerInput
from control.whole_body.model_based import ModelBasedController


def random_arrays(layers: tuple[int, ...], seed: int = 0) -> dict[str, np.ndarray]:
    random = np.random.default_rng(seed)
    arrays = {}
    for index, (inputs, outputs) in enumerate(pairwise(layers)):
        arrays[f"weight_{index}"] = random.standard_normal((outputs, inputs)) / np.sqrt(inputs)
        arrays[f"bias_{index}"] = 0.1 * random.standard_normal(outputs)
    return arrays


def write_policy(directory: Path, form: str = EXTENDED_FORM, meets_score: bool = True) -> Path:
    """A small random policy on disk; its manifest's path."""
    layers = (Observation(form).size, 16, 22)
    name = "policy_paper" if form == PAPER_FORM else "policy"
    manifest = PolicyManifest(name, form, interface(form), layers, meets_score=meets_score)
    return save_policy(directory, manifest, random_arrays(layers))


@pytest.fixture(scope="module")
def model() -> RobotModel:
    return RobotModel()


def standing(model: RobotModel, torque: np.ndarray | None = None) -> ControllerInput:
    sensor = SensorFrame(
        time_s=0.0,
        orientation_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
        angular_velocity=np.zeros(3),
        linear_acceleration=np.array([0.0, 0.0, 9.81]),
        joint_position=NOMINAL_POSITION.copy(),
        joint_velocity=np.zeros(22),
        joint_torque=np.zeros(22) if torque is None else torque,
    )
    model.update(np.eye(3), sensor.joint_position, np.zeros(3), np.zeros(3), np.zeros(22))
    base = BaseState(np.eye(3), np.zeros(3), np.zeros(3), 0.357)
    return ControllerInput(sensor, base, model, DEFAULT_COMMAND, np.zeros(3))


def test_numpy_actor_equals_the_trained_network():
    torch.manual_seed(0)
    network = ActorCritic(observation=30, privileged=4, actions=22, std=0.1, bfloat16=False)
    parameters = network.state_dict()
    names = [f"actor_trunk.{2 * index}" for index in range(len(HIDDEN))] + ["actor_head"]
    arrays = {f"weight_{i}": parameters[f"{name}.weight"].numpy() for i, name in enumerate(names)}
    arrays |= {f"bias_{i}": parameters[f"{name}.bias"].numpy() for i, name in enumerate(names)}
    actor = Actor((30, *HIDDEN, 22), arrays)
    observation = np.random.default_rng(1).standard_normal(30).astype(np.float32)
    with torch.no_grad():
        expected = network.mean(torch.from_numpy(observation)[None])[0].numpy()
    assert np.allclose(actor(observation), expected, atol=1e-5)


def test_saved_policy_comes_back(tmp_path: Path):
    write_policy(tmp_path)
    manifest, _ = load_policy("policy", tmp_path)
    assert manifest.form == EXTENDED_FORM
    assert available_policies(tmp_path) == ("policy",)


@pytest.mark.parametrize(
    ("key", "value", "named"),
    [
        ("joint_names", ["somebody_elses_joint"] * 22, "joint_names"),
        ("stiffness", [1.0] * 22, "stiffness"),
        ("period_s", 0.01, "period_s"),
        ("observation", {"gravity": 3}, "observation"),
        ("observation_scales", {}, "observation_scales"),
        ("action_scales", {}, "action_scales"),
    ],
)
def test_another_interface_is_refused_by_name(tmp_path: Path, key: str, value: object, named: str):
    path = write_policy(tmp_path)
    content = json.loads(path.read_text())
    content["interface"][key] = value
    path.write_text(json.dumps(content))
    with pytest.raises(PolicyWeightsError, match=named):
        load_policy("policy", tmp_path)


def test_other_numbers_than_the_manifest_describes_are_refused(tmp_path: Path):
    write_policy(tmp_path)
    with (tmp_path / "policy.npz").open("ab") as file:
        file.write(b"x")
    with pytest.raises(PolicyWeightsError, match="sha256"):
        load_policy("policy", tmp_path)


def test_missing_weights_are_named(tmp_path: Path):
    write_policy(tmp_path)
    (tmp_path / "policy.npz").unlink()
    with pytest.raises(PolicyWeightsError, match=r"policy\.npz") as refused:
        load_policy("policy", tmp_path)
    # It comes back whole from a process of an executor.
    assert str(pickle.loads(pickle.dumps(refused.value))) == str(refused.value)


@pytest.mark.parametrize("content", ["{", "{}", '{"schema": 99}'])
def test_a_damaged_manifest_is_refused(tmp_path: Path, content: str):
    write_policy(tmp_path).write_text(content)
    with pytest.raises(PolicyWeightsError, match="manifest"):
        load_policy("policy", tmp_path)


def test_every_policy_is_offered_whatever_it_scored(tmp_path: Path, model: RobotModel):
    write_policy(tmp_path, EXTENDED_FORM, meets_score=True)
    write_policy(tmp_path, PAPER_FORM, meets_score=False)
    assert set(make_policies(tmp_path, model)) == {"policy", "policy_paper"}
    assert make_policies(None, model) == {}


def test_every_shipped_policy_fits_this_code():
    for name in available_policies(WEIGHTS_DIRECTORY):
        load_policy(name, WEIGHTS_DIRECTORY)


def test_the_default_controller_scores_as_well_as_the_model_based_one():
    assert load_policy(PipelineConfig().controller)[0].meets_score


def test_the_first_observation_says_which_targets_hold_the_robot_now(tmp_path: Path, model: RobotModel):
    write_policy(tmp_path)
    controller = PolicyController(*load_policy("policy", tmp_path), model)
    torque = np.linspace(-3.0, 3.0, 22)
    controller.step(standing(model, torque))
    previous = controller.observation[controller.observation_groups["previous_action"]]
    scale = np.array([0.25] * 12 + [5.0] * 4 + [0.5] * 6)
    nominal = np.concatenate([NOMINAL_POSITION[:12], np.zeros(4), NOMINAL_POSITION[16:]])
    target = nominal + scale * previous
    carried = STIFFNESS * (target - NOMINAL_POSITION) + (STIFFNESS == 0.0) * DAMPING * target
    assert np.allclose(carried, torque, atol=1e-4)


def test_targets_follow_the_action_and_reset_forgets(tmp_path: Path, model: RobotModel):
    write_policy(tmp_path)
    controller = PolicyController(*load_policy("policy", tmp_path), model)
    first = controller.step(standing(model))
    second = controller.step(standing(model))
    assert first.shape == (22,)
    assert not np.array_equal(first, second)
    controller.reset()
    assert np.array_equal(controller.step(standing(model)), first)


def test_a_residual_policy_adds_a_bounded_correction_to_the_model_based_controller(tmp_path: Path, model: RobotModel):
    layers, limit, action_map = (Observation(RESIDUAL_FORM).size, 22), ActionScales().correction_limit, ActionMap()
    arrays = {"weight_0": np.zeros((22, layers[0])), "bias_0": np.linspace(-5.0, 5.0, 22)}
    save_policy(tmp_path, PolicyManifest("policy", RESIDUAL_FORM, interface(RESIDUAL_FORM), layers), arrays)
    controller, plain = PolicyController(*load_policy("policy", tmp_path), model), ModelBasedController(model)
    expected = np.clip(arrays["bias_0"], -limit, limit)
    for _ in range(3):
        inputs = standing(model)
        targets = controller.step(inputs)
        corrected = plain.step(inputs, action_map.reference_correction(arrays["bias_0"]))
        added = (targets - corrected) / action_map.unit
        assert np.allclose(added[LEG_SLICE], expected[LEG_SLICE], atol=1e-5)
        assert np.allclose(added[WHEEL_SLICE.start :], 0.0, atol=1e-5)
