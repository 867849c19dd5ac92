"""The baselines at run time: signs of their forces, networks as trained, weights refused when anything differs."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from control.baselines.baseline_controller import BaselineController, make_baselines
from control.baselines.baseline_weights import METHODS, BaselineManifest, baseline_interface, load_baseline, save_baseline
from control.baselines.force_signs import goal_offset, portela_command, zhi_command
from control.baselines.history import History
from control.baselines.method import OBSERVED, TARGET_SCALES, force_estimate, target_slice
from control.baselines.zhi import STIFFNESS
from control.learning.baselines.networks import BaselineActorCritic, make_network
from control.policy.policy_weights import PolicyWeightsError
from control.robot_model import RobotModel
from control.whole_body.task_memory import TASK_MEMORY
from control.whole_body.task_signals import TASK_SIGNALS, task_signals
from tests.control.policy.test_policy import standing

NAMES = tuple(METHODS)


def trained(name: str) -> BaselineActorCritic:
    torch.manual_seed(0)
    network = make_network(name, privileged=4, std=0.1, bfloat16=False)
    with torch.no_grad():
        network.actor_head.weight *= 20.0
    return network


def write_baseline(directory: Path, name: str, stands: bool = True) -> Path:
    manifest = BaselineManifest(name, name, baseline_interface(METHODS[name]), stands=stands)
    return save_baseline(directory, manifest, trained(name).arrays())


def pressed(force_z: float) -> np.ndarray:
    """An observation (1, 89) of a hand that is asked to be pushed up with `force_z`, N."""
    signals = np.zeros(1, TASK_SIGNALS)
    signals["command"]["mask"][0, 2], signals["command"]["force_n"][0, 2] = 1.0, force_z
    signals["command"]["position_m"][0], signals["command"]["orientation_wxyz"][0, 0] = (0.5, 0.2, 0.4), 1.0
    signals["gravity"][0, 2] = -1.0
    return OBSERVED.assemble(signals, np.zeros(1, TASK_MEMORY), np.zeros((1, 22)), np.zeros(1))


def test_portela_commands_what_the_environment_does_to_the_gripper():
    pressing_down = np.array([0.0, 0.0, 20.0])
    assert np.array_equal(portela_command(pressing_down), [0.0, 0.0, 20.0])
    frame = METHODS["portela"].frame(pressed(20.0))[0]
    mine = frame[9:13]  # after gravity, base velocity and position: force, then the flag
    assert np.allclose(mine, [0.0, 0.0, 2.0, 1.0])
    assert np.allclose(frame[6:9], [-0.2, 0.8, 0.0])  # the position of a force axis is hidden


def test_zhi_commands_what_the_robot_exerts():
    pressing_down = np.array([0.0, 0.0, 20.0])
    assert np.array_equal(zhi_command(pressing_down), [0.0, 0.0, -20.0])
    # Where the environment pushes back what the robot exerts, the goal stays; in the air it goes 10 cm down.
    assert not goal_offset(pressing_down, zhi_command(pressing_down), STIFFNESS).any()
    assert np.allclose(goal_offset(np.zeros(3), zhi_command(pressing_down), STIFFNESS), [0.0, 0.0, -0.1])
    assert np.allclose(METHODS["zhi"].frame(pressed(20.0))[0, -6:], [0.0, 0.0, -2.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize("name", NAMES)
def test_estimates_are_of_the_environment_on_the_hand(name: str):
    targets = METHODS[name].targets
    estimates = np.zeros(sum(targets.values()), np.float32)
    estimates[target_slice(targets, "force")] = TARGET_SCALES["force"] * np.array([1.0, -2.0, 20.0])
    assert np.allclose(force_estimate(targets, estimates), [1.0, -2.0, 20.0], atol=1e-5)


@pytest.mark.parametrize("name", NAMES)
def test_numpy_network_equals_the_trained_one(name: str):
    network, method = trained(name), METHODS[name]
    history = np.random.default_rng(1).standard_normal(method.frames * method.frame_size).astype(np.float32)
    action, estimates = method.network(network.arrays())(history)
    with torch.no_grad():
        batch = torch.from_numpy(history)[None]
        assert np.allclose(action, network.mean(batch)[0].numpy(), atol=1e-4)
        assert np.allclose(estimates, network.estimates(batch)[0].numpy(), atol=1e-4)


@pytest.mark.parametrize("name", NAMES)
def test_policy_gradient_reaches_what_the_actor_looks_through(name: str):
    for bfloat16 in (False, True):
        network = make_network(name, privileged=4, std=0.1, bfloat16=bfloat16)
        method = METHODS[name]
        network.mean(torch.randn(3, method.frames * method.frame_size)).square().sum().backward()
        first = next(p for n, p in network.named_parameters() if n.startswith(("estimator_trunk", "encoder")))
        assert first.grad is not None
        assert first.grad.abs().sum() > 0.0
        assert {id(first)} < {id(parameter) for parameter in network.actor_parameters()}


def test_history_is_zero_before_the_start_and_oldest_first():
    history = History(2, 3, 2)
    for value in (1.0, 2.0):
        history.push(np.full((2, 2), value, np.float32))
    before = history.flat
    assert np.array_equal(before[0], [0, 0, 1, 1, 2, 2])
    history.restart(np.array([1]), np.full((1, 2), 7.0, np.float32))
    assert np.array_equal(history.flat, [[0, 0, 1, 1, 2, 2], [0, 0, 0, 0, 7, 7]])
    assert history.ages.tolist() == [2, 1]
    assert np.array_equal(before[1], [0, 0, 1, 1, 2, 2])


@pytest.mark.parametrize("name", NAMES)
def test_controller_steps_from_what_holds_the_robot_and_forgets(tmp_path: Path, name: str):
    write_baseline(tmp_path, name)
    controller, model = BaselineController(*load_baseline(name, tmp_path)), RobotModel()
    first = controller.step(standing(model))
    estimate = controller.force_estimated_n
    assert first.shape == (22,)
    assert np.isfinite(estimate).all()
    assert not np.array_equal(controller.step(standing(model)), first)
    controller.reset()
    assert not controller.force_estimated_n.any()
    assert np.array_equal(controller.step(standing(model)), first)
    assert task_signals(standing(model))["force_estimated_n"].shape == (1, 3)


def test_only_what_stands_can_be_selected(tmp_path: Path):
    write_baseline(tmp_path, "portela", stands=False)
    write_baseline(tmp_path, "zhi")
    assert set(make_baselines(tmp_path)) == {"zhi"}
    assert make_baselines(None) == {}


def test_other_weights_and_interfaces_are_refused(tmp_path: Path):
    path = write_baseline(tmp_path, "portela")
    content = json.loads(path.read_text())
    path.write_text(json.dumps(content | {"interface": content["interface"] | {"frames": 9}}))
    with pytest.raises(PolicyWeightsError, match="other frames"):
        load_baseline("portela", tmp_path)
    path.write_text(json.dumps(content | {"sha256": "0" * 64}))
    with pytest.raises(PolicyWeightsError, match="sha256"):
        load_baseline("portela", tmp_path)
    path.write_text(json.dumps(content | {"schema": 0}))
    with pytest.raises(PolicyWeightsError, match="cannot be read"):
        load_baseline("portela", tmp_path)
