"""The training environment as a baseline sees it: histories of its frames, targets of its estimation head, its rewards."""

from dataclasses import dataclass, replace

import numpy as np

from control.baselines.baseline_weights import METHODS
from control.baselines.history import History
from control.baselines.method import OBSERVED, TARGET_SCALES
from control.policy.observation import PAPER_FORM, ObservationScales
from sim.training.baselines.rewards import HandRewards, hand_reward
from sim.training.batch_rotations import rotate_back
from sim.training.env import TrainingEnv, TrainingEnvConfig
from sim.training.rewards import RewardInput, rewards

_UNREWARDED_HAND = {"position": 0.0, "position_fine": 0.0, "orientation_fine": 0.0, "force": 0.0, "force_fine": 0.0}
_CENTER = np.array(ObservationScales().position_center_m)
_LARGEST_TARGET = 8.0


@dataclass(frozen=True, slots=True)
class BaselineEnvConfig:
    """Attributes:
    method: of control.baselines.baseline_weights.METHODS.
    world: the policy's training world, with the baseline's range of forces.
    hand: rewards of the hand.
    """

    method: str
    world: TrainingEnvConfig
    hand: HandRewards


class BaselineEnv(TrainingEnv):
    """n robots; `observation` (n, frames * frame size) is a history, and `privileged` ends with the targets."""

    def __init__(self, config: BaselineEnvConfig) -> None:
        """
        Raises:
            SurrogateError: no surrogate is given and none has been fitted.
        """
        self._method = METHODS[config.method]
        self._hand_rewards = config.hand
        self._history = History(config.world.count, self._method.frames, self._method.frame_size)
        self._scales = replace(config.world.rewards, **_UNREWARDED_HAND)
        super().__init__(replace(config.world, form=PAPER_FORM))

    @property
    def observation_size(self) -> int:
        """Length of an observation."""
        return self._method.frames * self._method.frame_size

    @property
    def ages(self) -> np.ndarray:
        """(n,) frames of each robot's history."""
        return self._history.ages

    @property
    def targets(self) -> np.ndarray:
        """(n, k) float32, scaled: what the estimation head is to say."""
        robot = self.robot
        heading = robot.rotation_heading_to_world
        values = {
            "base_velocity": rotate_back(heading, robot.base_linear_velocity),
            "hand_position": self._true_hand() - _CENTER,
            "anchor": self.contacts.anchors() - _CENTER,
            "force": self._hand_force,
            "base_force": np.zeros_like(self._hand_force),
            "gains": robot.gain_scales - 1.0,
            "friction": robot.wheel_friction[:, None],
        }
        scaled = [TARGET_SCALES[name] * values[name] for name in self._method.targets]
        return np.clip(np.concatenate(scaled, axis=1), -_LARGEST_TARGET, _LARGEST_TARGET).astype(np.float32)

    def _observe(self) -> None:
        self.signals = self._sense()
        self.memory.step(self.signals)  # for the teacher
        self._history.push(self._frames(self.signals, slice(None)))
        self.observation = self._history.flat
        self.privileged = self._privileged()

    def _observe_fresh(self, ids: np.ndarray) -> None:
        self._hand[ids] = self._measured_hand(ids)
        signals = self.signals[ids] = self._sense(ids)
        self._history.restart(ids, self._frames(signals, ids))
        self.observation = self._history.flat
        self.privileged = self._privileged()

    def _frames(self, signals: np.ndarray, ids: np.ndarray | slice) -> np.ndarray:
        memories = self.memory.values[ids]
        return self._method.frame(OBSERVED.assemble(signals, memories, self._action[ids], self._phase[ids]))

    def _privileged(self) -> np.ndarray:
        return np.concatenate([super()._privileged(), self.targets], axis=1)

    def _reward(self, state: RewardInput) -> np.ndarray:
        both = rewards(self._scales, state)
        mask = self.references.applied["mask"]
        earned = hand_reward(self._method.name, self._hand_rewards, state, mask, self._hand_force)
        both[:, 1] += np.where(state.fallen, 0.0, earned)
        return both
