"""Portela et al. 2024, "Learning Force Control for Legged Manipulation", on this robot.

Ten frames of history; a state estimator whose output, with the gripper's force, feeds the actor beside the history.

What differs from the published controller, because the robot does: wheels are velocity targets and their angles are not
observed, the gait's commands are gone and its clock is our gait phase. Theirs forces all axes or none: here the command of
the hand's position is Cartesian, its force axes hidden as theirs is in force mode, so that the mask's mixed modes can be
asked for; their flag says that some axis is on force. Orientation is a quaternion.
"""

from collections.abc import Mapping

import numpy as np

from control.baselines.force_signs import portela_command
from control.baselines.method import OBSERVED, arrays_of
from control.joints import JOINT_COUNT
from control.policy.actor import Actor

ESTIMATOR_HIDDEN = (256, 128)
ACTOR_HIDDEN = (512, 256, 128)

_BEFORE = ("gravity", "base_velocity_command")
_AFTER = (
    "orientation_command",
    "leg_position",
    "arm_position",
    "leg_velocity",
    "wheel_velocity",
    "arm_velocity",
    "previous_action",
    "gait_phase",
)


class PortelaNetwork:
    """Estimator, and an actor on history and estimates."""

    def __init__(self, layers: dict[str, tuple[int, ...]], arrays: Mapping[str, np.ndarray]) -> None:
        self._estimator = Actor(layers["estimator"], arrays_of(arrays, "estimator"))
        self._actor = Actor(layers["actor"], arrays_of(arrays, "actor"))

    def __call__(self, history: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `control.baselines.method.Network`."""
        estimates = self._estimator(history)
        return self._actor(np.concatenate([history, estimates])), estimates


class Portela:
    """See `control.baselines.method.Method`. Estimates: base velocity, the drives' gain factors, force, friction, position of
    the hand and of what the hand is tied to."""

    name = "portela"
    frames = 10
    targets: Mapping[str, int] = {"base_velocity": 3, "gains": 2, "force": 3, "friction": 1, "hand_position": 3, "anchor": 3}

    def __init__(self) -> None:
        self.frame_size = self.frame(np.zeros((1, OBSERVED.size), np.float32)).shape[1]

    def frame(self, observed: np.ndarray) -> np.ndarray:
        """See `Method.frame`."""
        groups = OBSERVED.groups
        mask = observed[:, groups["mask"]]
        parts = [observed[:, groups[name]] for name in _BEFORE]
        parts += [
            (1.0 - mask) * observed[:, groups["position_command"]],
            portela_command(observed[:, groups["force_command"]]),
            mask.max(axis=1, keepdims=True),
        ]
        return np.concatenate(parts + [observed[:, groups[name]] for name in _AFTER], axis=1, dtype=np.float32)

    def layers(self) -> dict[str, tuple[int, ...]]:
        """See `Method.layers`."""
        history, estimates = self.frames * self.frame_size, sum(self.targets.values())
        return {
            "estimator": (history, *ESTIMATOR_HIDDEN, estimates),
            "actor": (history + estimates, *ACTOR_HIDDEN, JOINT_COUNT),
        }

    def network(self, arrays: Mapping[str, np.ndarray]) -> PortelaNetwork:
        """See `Method.network`."""
        return PortelaNetwork(self.layers(), arrays)
