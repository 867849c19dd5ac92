"""Gymnasium: `gymnasium.make("sim.gym:Forcelens/Press-v0")` and `Guidance-v0`. Needs the extra `gym`.

`make` gives the full stack, sensors, estimators, safety gate and all, for evaluation; `make_vec` the batched training world
(sim.gym_vector). Both have the same spaces: the observation of a residual policy (control.policy.observation), and its action,
which corrects the model-based controller: 22 numbers from -1 to 1 (control.policy.action). What is learned in the one world is
tried in the other. One step is a control period of 20 ms.
"""

import queue
import threading
from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np

from control.command.limits import DEFAULT_COMMAND
from control.joints import JOINT_COUNT
from control.pipeline import PipelineConfig
from control.policy.observation import RESIDUAL_FORM, Observation, ObservationScales
from control.policy.policy_controller import PolicyController
from control.timing import CONTROL_PERIOD_S
from control.types import Command
from sim.runtime.simulation import Simulation, SimulationConfig

EPISODE_STEPS = 500
FALLEN_AFTER_S = 0.5
"""Before, the safety gate may damp while the robot finds its feet."""

ACTION_COST = 0.01
RENDER_SIZE = (480, 640)

OBSERVATION_SPACE = gymnasium.spaces.Box(
    -ObservationScales().limit, ObservationScales().limit, (Observation(RESIDUAL_FORM).size,), np.float32
)
ACTION_SPACE = gymnasium.spaces.Box(-1.0, 1.0, (JOINT_COUNT,), np.float32)


class _Agent:
    """The session's policy: its decisions are made elsewhere. The session runs in a thread and waits for each of them.

    So an action acts in the very tick whose observation it was decided on, as that of every other controller.
    """

    def __init__(self, session: Simulation) -> None:
        self.session = session
        self.command = DEFAULT_COMMAND
        self._observed: queue.SimpleQueue[np.ndarray | BaseException] = queue.SimpleQueue()
        self._decided: queue.SimpleQueue[np.ndarray] = queue.SimpleQueue()
        self._ended = False
        self._thread: threading.Thread | None = None
        shipped = session.pipeline.controllers["policy"]
        assert isinstance(shipped, PolicyController)
        manifest = replace(shipped.manifest, name="agent", form=RESIDUAL_FORM)
        controller = PolicyController(manifest, self._decide, session.pipeline.model)  # pyright: ignore[reportArgumentType]
        session.pipeline.add_controller("agent", controller)
        session.select_controller("agent")

    def begin(self) -> np.ndarray:
        """Run from where the session stands to the first observation."""
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="gym-session", daemon=True)
        self._thread.start()
        return self._next()

    def act(self, action: np.ndarray) -> np.ndarray:
        """Act, and run to the next observation."""
        self._decided.put(action)
        return self._next()

    def end(self) -> None:
        """Finish the tick that waits for a decision; the session is the caller's again."""
        if self._thread is not None:
            self._ended = True
            self._decided.put(np.zeros(JOINT_COUNT, np.float32))
            self._thread.join()
            self._thread = None

    def _next(self) -> np.ndarray:
        observed = self._observed.get()
        if isinstance(observed, BaseException):
            self._thread = None
            raise observed
        return observed

    def _run(self) -> None:
        try:
            while not self._ended:
                self.session.tick(self.command).raise_failures()
        except Exception as error:
            self._observed.put(error)

    def _decide(self, observation: np.ndarray) -> np.ndarray:
        self._observed.put(observation.copy())
        return self._decided.get()


class FullStackEnv(gymnasium.Env[np.ndarray, np.ndarray], ABC):
    """One robot in the full stack; a task says what is asked and what is good.

    Args:
        render_mode: None or "rgb_array".
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["rgb_array"],
        "render_fps": round(1.0 / CONTROL_PERIOD_S),
    }
    observation_space = OBSERVATION_SPACE
    action_space = ACTION_SPACE
    scene = "free"

    def __init__(self, render_mode: str | None = None) -> None:
        self.render_mode = render_mode
        self.session = Simulation(SimulationConfig(scene=self.scene, pipeline=PipelineConfig()))
        self._agent = _Agent(self.session)
        self._renderer: Any = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """A fresh robot and a drawn task; the same seed leads to the same bytes. See gymnasium.Env."""
        super().reset(seed=seed)
        self._agent.end()
        self.session.reset(seed=int(self.np_random.integers(2**31)))
        self._agent.command = self._draw()
        return self._agent.begin(), self._info()

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Act for 20 ms. Terminates when the robot has fallen. See gymnasium.Env."""
        action = np.clip(np.asarray(action, np.float32), -1.0, 1.0)
        self._before()
        observation = self._agent.act(action)
        fallen = self.session.time_s > FALLEN_AFTER_S and self.session.output.safety.damping
        reward = -1.0 if fallen else self._reward() - ACTION_COST * float(np.mean(action**2))
        return observation, reward, bool(fallen), False, self._info()

    def render(self) -> Any:
        """A picture (480, 640, 3), uint8, in the mode "rgb_array". See gymnasium.Env."""
        if self.render_mode != "rgb_array":
            return None
        import mujoco  # its renderer needs a GL, which only pictures need

        if self._renderer is None:
            self._renderer = mujoco.Renderer(self.session.backend.model, *RENDER_SIZE)
        self._renderer.update_scene(self.session.backend.data)
        return self._renderer.render()

    def close(self) -> None:
        """See gymnasium.Env."""
        self._agent.end()
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    @abstractmethod
    def _draw(self) -> Command:
        """A command of this task, from `self.np_random`."""

    def _before(self) -> None:
        """What else happens in a step; nothing by default."""

    @abstractmethod
    def _reward(self) -> float:
        """What the last step was worth, from truth."""

    def _info(self) -> dict[str, Any]:
        """Truth, which no observation has."""
        if self.session.time_s == 0.0:
            return {}
        return {"force_true_n": self.session.truth().force_true_n.copy(), "time_s": self.session.time_s}


class PressEnv(FullStackEnv):
    """Press down on a box with 5 to 20 N, drawn anew for every episode. Reward: exp(-(error / 3 N)^2), from the true force."""

    scene = "box"

    def _draw(self) -> Command:
        self._force_n = float(self.np_random.uniform(5.0, 20.0))
        return replace(DEFAULT_COMMAND, mask=np.array([0.0, 0.0, 1.0]), force_n=np.array([0.0, 0.0, self._force_n]))

    def _reward(self) -> float:
        error = self.session.truth().force_true_n[2] - self._force_n
        return float(np.exp(-((error / 3.0) ** 2)))


class GuidanceEnv(FullStackEnv):
    """Be led: a person takes the hand along at 0.1 to 0.3 m/s, by a spring. Reward: exp(-(force / 8 N)^2)."""

    def _draw(self) -> Command:
        self._speed_mps = self.np_random.uniform(0.1, 0.3)
        self._way: np.ndarray | None = None
        return replace(DEFAULT_COMMAND, mask=np.ones(3), guidance=True)

    def _before(self) -> None:
        truth = self.session.truth()
        ahead = truth.rotation_heading_to_world[:, 0]
        if self._way is None:
            self._way = truth.end_effector_position.copy()
        self._way = self._way + self._speed_mps * CONTROL_PERIOD_S * ahead
        self.session.backend.set_drag(self._way)

    def _reward(self) -> float:
        return float(np.exp(-((np.linalg.norm(self.session.truth().force_true_n) / 8.0) ** 2)))


for _name in ("Press", "Guidance"):
    gymnasium.register(
        f"Forcelens/{_name}-v0",
        entry_point=f"sim.gym:{_name}Env",
        vector_entry_point=f"sim.gym_vector:make_{_name.lower()}",
        max_episode_steps=EPISODE_STEPS,
    )
