"""The batched training world as a Gymnasium vector environment: `gymnasium.make_vec("sim.gym:Forcelens/Press-v0", 256)`.

Many robots in one process, for learning; the estimator is its fitted surrogate, sensors have plain noise, and only one kind of
segment is drawn (sim.training.commands). Spaces as in sim.gym.
"""

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from control.policy.observation import RESIDUAL_FORM
from control.timing import CONTROL_PERIOD_S
from sim.gym import ACTION_SPACE, EPISODE_STEPS, OBSERVATION_SPACE
from sim.training.commands import LEAD, TOUCH, CommandRanges
from sim.training.env import TrainingEnv, TrainingEnvConfig

KINDS = 5


class TrainingVectorEnv(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """Robots that start anew in the very step in which they fall or their time is up (`AutoresetMode.SAME_STEP`).

    The reward is the sum of the training's two. The last observation of an episode whose time was up is in
    `infos["final_obs"]`; after a fall it is zero, for what follows a fall is worth nothing.

    Args:
        num_envs: robots.
        kind: of the segments that are drawn, see sim.training.commands.
        threads: of the physics.
        seed: of the first episodes; `reset(seed=...)` draws others.
        max_episode_steps: in control periods.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "autoreset_mode": AutoresetMode.SAME_STEP
    }

    def __init__(
        self,
        num_envs: int = 1,
        *,
        kind: int,
        threads: int = 1,
        seed: int = 0,
        max_episode_steps: int = EPISODE_STEPS,
        render_mode: None = None,
    ) -> None:
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.single_observation_space, self.single_action_space = OBSERVATION_SPACE, ACTION_SPACE
        self.observation_space = batch_space(OBSERVATION_SPACE, num_envs)
        self.action_space = batch_space(ACTION_SPACE, num_envs)
        shares = tuple(float(each == kind) for each in range(KINDS))
        self._config: dict[str, Any] = {
            "count": num_envs,
            "threads": threads,
            "form": RESIDUAL_FORM,
            "episode_s": max_episode_steps * CONTROL_PERIOD_S,
            "commands": CommandRanges(kind_shares=shares),
        }
        self._seed = seed
        self._env: TrainingEnv | None = None

    @property
    def training(self) -> TrainingEnv:
        """The training world itself; made by the first `reset`."""
        if self._env is None:
            self._env = TrainingEnv(TrainingEnvConfig(seed=self._seed, **self._config))
        return self._env

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Fresh robots at different ages, so that they do not all start anew together. See VectorEnv."""
        given = seed[0] if isinstance(seed, list) else seed
        # Without a seed other robots than before, but the same for the same history.
        self._seed = self._seed + 1 if given is None else given
        self._env = None
        return self.training.observation.copy(), {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Act for 20 ms. See VectorEnv."""
        env = self.training
        result = env.step(np.clip(actions, -1.0, 1.0))
        truncated = np.zeros(self.num_envs, bool)
        truncated[result.ended] = True
        infos: dict[str, Any] = {}
        if result.done.any():
            final = np.zeros_like(env.observation)
            final[result.ended] = result.last_observation
            infos = {"final_obs": final, "_final_obs": result.done}
        return env.observation.copy(), result.reward.sum(axis=1), result.done & ~truncated, truncated, infos


def make_press(num_envs: int = 1, **options: Any) -> TrainingVectorEnv:
    """Robots that press against something stiff."""
    return TrainingVectorEnv(num_envs, kind=TOUCH, **options)


def make_guidance(num_envs: int = 1, **options: Any) -> TrainingVectorEnv:
    """Robots that are led by the hand."""
    return TrainingVectorEnv(num_envs, kind=LEAD, **options)
