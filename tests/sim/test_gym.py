"""The Gymnasium environments pass the checks of those who use them, and the same seed leads to the same bytes."""

import subprocess
import sys
import time
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium", reason='needs Gymnasium: pip install -e ".[gym]"')

from control.paths import ROOT  # noqa: E402
from sim.gym import FullStackEnv  # noqa: E402
from sim.training.env import TrainingEnv  # noqa: E402

NAMES = ("Press", "Guidance")


@pytest.fixture(params=NAMES)
def env(request: pytest.FixtureRequest) -> Iterator[Any]:
    env = gymnasium.make(f"sim.gym:Forcelens/{request.param}-v0")
    yield env
    env.close()


def actions(count: int) -> np.ndarray:
    return np.random.default_rng(4).uniform(-0.3, 0.3, (count, 22)).astype(np.float32)


def test_both_checkers_pass_without_a_warning(env: Any) -> None:
    from gymnasium.utils.env_checker import check_env

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped, skip_render_check=True)


def test_stable_baselines_checker_passes_without_a_warning(env: Any) -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker.check_env(env.unwrapped, skip_render_check=True)


def test_the_same_seed_leads_to_the_same_bytes(env: Any) -> None:
    def episode() -> bytes:
        told = [env.reset(seed=5)[0].tobytes()]
        for action in actions(12):
            observation, reward, *_ = env.step(action)
            told.append(observation.tobytes() + np.float64(reward).tobytes())
        return b"".join(told)

    first = episode()
    assert first == episode()
    assert env.reset(seed=6)[0].tobytes() != first[: len(env.reset(seed=5)[0].tobytes())]


def test_what_is_asked_happens(env: Any) -> None:
    assert isinstance(env.unwrapped, FullStackEnv)
    env.reset(seed=1)
    rewards, info = [], {}
    for _ in range(75):
        _, reward, terminated, _, info = env.step(np.zeros(22, np.float32))
        rewards.append(reward)
        assert not terminated
    assert np.mean(rewards[-15:]) > 0.3, "the model-based controller alone does it fairly well"
    assert np.linalg.norm(info["force_true_n"]) > 1.0


def test_many_robots_in_one_vector(monkeypatch: pytest.MonkeyPatch) -> None:
    envs = gymnasium.make_vec("sim.gym:Forcelens/Press-v0", 8, vectorization_mode="vector_entry_point", max_episode_steps=6)
    observation, _ = envs.reset(seed=3)
    again, _ = envs.reset(seed=3)
    assert np.array_equal(observation, again)
    assert not np.array_equal(envs.reset()[0], again)
    ended = np.zeros(8, int)
    for action in actions(7):
        observation, reward, terminated, truncated, infos = envs.step(np.tile(action, (8, 1)))
        assert envs.observation_space.contains(observation) and reward.shape == (8,)
        assert not (terminated & truncated).any()
        done = terminated | truncated
        ended += done
        assert np.array_equal(infos.get("_final_obs", np.zeros(8, bool)), done)
        if truncated.any():
            assert not np.array_equal(infos["final_obs"][truncated], observation[truncated]), (
                "the episode's last, not the next first"
            )
    assert (ended >= 1).all()
    envs.close()


def test_registering_imports_no_torch_and_no_gl() -> None:
    code = "import sys, sim.gym; assert not {'torch', 'mujoco.renderer', 'OpenGL'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


def test_the_vector_costs_little_beside_the_training_world() -> None:
    """Processor time of the wrapper's own work; the ratio of steps per second is in the manual."""
    envs = gymnasium.make_vec("sim.gym:Forcelens/Guidance-v0", 32, vectorization_mode="vector_entry_point")
    envs.reset(seed=1)
    action = np.zeros((32, 22), np.float32)
    inner = 0.0
    step = TrainingEnv.step

    def timed(self: TrainingEnv, given: np.ndarray) -> Any:
        nonlocal inner
        began = time.process_time()
        result = step(self, given)
        inner += time.process_time() - began
        return result

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(TrainingEnv, "step", timed)
        began = time.process_time()
        for _ in range(30):
            envs.step(action)
        whole = time.process_time() - began
    assert inner / whole >= 0.9
