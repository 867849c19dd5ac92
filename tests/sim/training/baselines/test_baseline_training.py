"""Baselines in the training world: seen as on the robot, rewarded by their own laws, trained, cut off and continued."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from control.baselines.baseline_controller import BaselineController
from control.baselines.baseline_weights import METHODS, BaselineManifest, baseline_interface, load_baseline
from control.baselines.method import target_slice
from control.learning.baselines.history_ring import HistoryRing
from control.learning.baselines.networks import make_network
from control.learning.flatness import LEAST_POINTS, flattened
from control.learning.policy import dagger
from control.learning.policy.dagger import DaggerConfig
from control.learning.policy.ppo import PpoConfig
from control.robot_model import RobotModel
from sim import train_baselines
from sim.training import training_run
from sim.training.baselines import training as training_module
from sim.training.baselines.env import BaselineEnv, BaselineEnvConfig
from sim.training.baselines.rewards import PUBLISHED, RETUNED, hand_reward
from sim.training.commands import CommandRanges
from sim.training.env import TrainingEnvConfig
from sim.training.rewards import RewardInput
from sim.training.robot import NO_RANDOMIZATION
from sim.training.training_run import PolicyTrainingConfig
from sim.trials.policy_score import Score
from tests.sim.training.test_training_env import SILENT, SURROGATE, single_input

NAMES = tuple(METHODS)

TINY = PolicyTrainingConfig(
    count=8,
    imitation_steps=4,
    ppo_iterations=2,
    score_every=10,
    bfloat16=False,
    dagger=DaggerConfig(teacher_steps=2, batch=16, updates=1),
    ppo=PpoConfig(horizon=2, epochs=1, minibatches=1, critic_only=1),
)


def make_env(name: str, count: int = 6) -> BaselineEnv:
    world = TrainingEnvConfig(
        count=count, commands=CommandRanges(hands=40), randomization=NO_RANDOMIZATION, noise=SILENT, surrogate=SURROGATE
    )
    env = BaselineEnv(BaselineEnvConfig(name, world, PUBLISHED))
    env._age_s[:] = 0.0
    return env


def state(count: int, **changes: np.ndarray) -> RewardInput:
    """A batch without any error."""
    zeros = {name: np.zeros(count) for name in ("yaw_error", "heave", "height", "lead_force")}
    zeros |= {name: np.zeros((count, 2)) for name in ("velocity_error", "rocking", "gravity_xy")}
    zeros |= {name: np.zeros((count, 3)) for name in ("position_error", "orientation_error", "force_error")}
    zeros |= {name: np.zeros((count, 22)) for name in ("joint_position", "joint_velocity", "joint_torque", "action_change")}
    zeros |= {name: np.zeros(count, bool) for name in ("drags", "fallen")}
    return RewardInput(**(zeros | changes))


@pytest.mark.parametrize("name", NAMES)
def test_batch_and_controller_share_histories_and_actions(name: str):
    env, model, method = make_env(name, count=2), RobotModel(), METHODS[name]
    torch.manual_seed(1)
    network = make_network(name, privileged=4, std=0.1, bfloat16=False)
    manifest = BaselineManifest(name, name, baseline_interface(method))
    controllers = [BaselineController(manifest, method.network(network.arrays())) for _ in range(2)]
    for _ in range(method.frames + 2):
        expected = []
        for robot, controller in enumerate(controllers):
            controller._started = True  # as training starts: nothing held
            controller.step(single_input(env, robot, model))
            assert np.allclose(controller._history.flat[0], env.observation[robot], atol=1e-5)
            expected.append(controller.action)
        with torch.no_grad():
            action = network.mean(torch.from_numpy(env.observation)).numpy()
        assert np.allclose(action, expected, atol=1e-4)
        assert not env.step(np.array(expected)).done.any()


def test_targets_say_what_is_true():
    env = make_env("portela")
    for _ in range(20):
        env.step(env.teacher_action())
    targets = METHODS["portela"].targets
    assert np.allclose(env.targets[:, target_slice(targets, "force")], 0.05 * env._hand_force, atol=1e-5)
    assert np.allclose(env.targets[:, target_slice(targets, "gains")], 0.0)
    assert np.allclose(env.targets[:, target_slice(targets, "friction")], 0.8)
    sprung = env.contacts.stiffness_of_force_axes() > 0.0
    anchors = env.targets[:, target_slice(targets, "anchor")] / 4.0 + [0.55, 0.0, 0.5]
    assert np.allclose(anchors[~sprung], env.source.commands["position_m"][~sprung], atol=1e-5)
    assert env.privileged.shape[1] == 23 + 15


def test_published_tolerances_are_as_flat_as_they_are_said_to_be():
    mask, nothing = np.array([[0.0, 0.0, 1.0]] * 2), np.zeros((2, 3))
    error = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 5.0]])
    one = state(2, force_error=error)
    for name, published in (("portela", 0.905), ("zhi", 0.951)):
        for scales, ratio in ((PUBLISHED, published), (RETUNED, np.exp(-1.0))):
            # Only what the force earns: the same without what position and orientation earn.
            still = state(2, force_error=np.array([[0.0, 0.0, 1e6]] * 2)) if name == "portela" else None
            earned = hand_reward(name, scales, one, mask, error)
            other = scales.overall * scales.orientation if still is None else hand_reward(name, scales, still, mask, nothing)
            force = earned - other
            assert force[1] / force[0] == pytest.approx(ratio, abs=2e-3)


def test_the_goal_of_a_held_axis_yields_to_a_force():
    mask, force = np.zeros((2, 3)), np.array([[0.0, 10.0, 0.0]] * 2)
    yielding = state(2, position_error=np.array([[0.0, 0.05, 0.0], [0.0, 0.0, 0.0]]))
    earned = hand_reward("zhi", PUBLISHED, yielding, mask, force)
    assert earned[0] == pytest.approx(0.05 * 4.5)
    assert earned[1] < earned[0]


@pytest.mark.parametrize("capacity", [1000, 10])
def test_ring_puts_together_the_histories_that_were_seen(capacity: int):
    env = make_env("portela", count=3)
    ring = HistoryRing(env, METHODS["portela"].frames, capacity)
    seen: set[bytes] = set()
    for step in range(26):
        if step == 5:
            env._age_s[1] = 1e9  # its episode ends, and its history
        seen |= {history.tobytes() for history in env.observation}
        ring.add(torch.from_numpy(env.observation), torch.zeros(3, 22))
        env.step(env.teacher_action())
    histories, labels = ring.draw(200)
    assert labels.shape == (200, 22 + 15)
    assert {history.tobytes() for history in histories.numpy()} <= seen


def test_a_curve_has_flattened_only_when_it_is_long_and_level():
    rising = np.linspace(0.1, 0.5, LEAST_POINTS)
    assert not flattened(rising.tolist())
    assert not flattened([0.5] * (LEAST_POINTS - 1))
    assert flattened([*rising.tolist(), *[0.5] * LEAST_POINTS])


def test_one_command_trains_resumes_and_exports(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    imitations = []

    def imitate(*arguments: Any) -> float:
        imitations.append(arguments)
        return dagger.imitate(*arguments)

    def score(name: str, *_: object) -> Score:
        return Score(2.0, {"box_z_n": 3.0}, 1 if name == "portela" else 0)

    monkeypatch.setattr(training_run, "imitate", imitate)
    monkeypatch.setattr(training_module, "score_controller", score)
    monkeypatch.setattr(train_baselines, "map_unordered", lambda _, function, jobs, *__: map(function, jobs))
    monkeypatch.setattr(train_baselines, "PolicyTrainingConfig", lambda: TINY)
    monkeypatch.setattr(training_module, "CommandRanges", partial(CommandRanges, hands=20))
    monkeypatch.setattr(training_run, "save_policy_curves", lambda *_: None)
    words = ["--seeds", "0", "--run", str(tmp_path / "run"), "--no-bfloat16", "--output", str(tmp_path / "out"), "--names"]
    train_baselines.main([*words, "portela", "portela_retuned", "--ppo-iterations", "1"])
    assert load_baseline("portela_retuned", tmp_path / "out")[0].training["ppo_iterations"] == 1
    train_baselines.main([*words, "portela_retuned"])
    assert load_baseline("portela_retuned", tmp_path / "out")[0].training["ppo_iterations"] == 2
    manifest, _ = load_baseline("portela", tmp_path / "out")
    assert (manifest.training["ppo_iterations"], manifest.training["steps"]) == (1, (4 + 2) * 8)
    assert (manifest.stands, manifest.flattened, len(manifest.curve["reward"])) == (False, False, 1)
    # Its best is still the imitation, which fell when it was chosen.
    assert not load_baseline("portela_retuned", tmp_path / "out")[0].stands
    assert len(imitations) == 1
    with pytest.raises(RuntimeError, match="another training"):
        training_module.BaselineTraining(tmp_path / "run/portela/seed0", replace(TINY, form="portela", seed=5))
    torch.set_num_threads(1)
