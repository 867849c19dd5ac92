"""Zhi et al. 2025, "Learning a Unified Policy for Position and Force Control in Legged Loco-Manipulation" (UniFP), here.

32 frames of history; an encoder whose features feed the actor beside the newest frame, and a head that estimates from the
features alone. The hand's goal is shifted by (f_ext + f_cmd) / K, K = 200 N/m.

What differs from the published controller, because the robot does: wheels are velocity targets and their angles are not
observed, the gait's phase is ours. On a force axis the goal is where the hand is, which our command filter gives: a goal that
stays would bear a force only by lagging f / K behind, 4 cm for 8 N. Goals are Cartesian, orientation is a quaternion. Forces on
the base are off, as in the released code: their command and their estimate are zero.
"""

from collections.abc import Mapping

import numpy as np

from control.baselines.force_signs import zhi_command
from control.baselines.method import OBSERVED, arrays_of
from control.joints import JOINT_COUNT
from control.policy.actor import Actor

ENCODER_HIDDEN = (512, 256, 128)
FEATURES = 64
HEAD_HIDDEN = (128, 64)
ACTOR_HIDDEN = (512, 256, 128)
STIFFNESS = 200.0
"""N/m, K."""

_BETWEEN = (
    "angular_velocity",
    "leg_position",
    "arm_position",
    "leg_velocity",
    "wheel_velocity",
    "arm_velocity",
    "previous_action",
    "gait_phase",
    "base_velocity_command",
    "position_command",
    "orientation_command",
)


class ZhiNetwork:
    """Encoder, head, and an actor on the newest frame and the features."""

    def __init__(self, layers: dict[str, tuple[int, ...]], frame_size: int, arrays: Mapping[str, np.ndarray]) -> None:
        self._encoder = Actor(layers["encoder"], arrays_of(arrays, "encoder"))
        self._head = Actor(layers["head"], arrays_of(arrays, "head"))
        self._actor = Actor(layers["actor"], arrays_of(arrays, "actor"))
        self._newest = -frame_size

    def __call__(self, history: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `control.baselines.method.Network`."""
        features = self._encoder(history)
        features = np.where(features < 0.0, np.expm1(np.minimum(features, 0.0)), features)
        return self._actor(np.concatenate([history[self._newest :], features])), self._head(features)


class Zhi:
    """See `control.baselines.method.Method`. Estimates: base velocity, position of the hand, force on hand and on base."""

    name = "zhi"
    frames = 32
    targets: Mapping[str, int] = {"base_velocity": 3, "hand_position": 3, "force": 3, "base_force": 3}

    def __init__(self) -> None:
        self.frame_size = self.frame(np.zeros((1, OBSERVED.size), np.float32)).shape[1]

    def frame(self, observed: np.ndarray) -> np.ndarray:
        """See `Method.frame`."""
        groups = OBSERVED.groups
        x, y, z = observed[:, groups["gravity"]].T
        leaning = np.stack([np.arctan2(-y, -z), np.arctan2(x, np.hypot(y, z))], axis=1)
        between = [observed[:, groups[name]] for name in _BETWEEN]
        force = zhi_command(observed[:, groups["force_command"]])
        return np.concatenate([leaning, *between, force, np.zeros_like(force)], axis=1, dtype=np.float32)

    def layers(self) -> dict[str, tuple[int, ...]]:
        """See `Method.layers`."""
        return {
            "encoder": (self.frames * self.frame_size, *ENCODER_HIDDEN, FEATURES),
            "head": (FEATURES, *HEAD_HIDDEN, sum(self.targets.values())),
            "actor": (self.frame_size + FEATURES, *ACTOR_HIDDEN, JOINT_COUNT),
        }

    def network(self, arrays: Mapping[str, np.ndarray]) -> ZhiNetwork:
        """See `Method.network`."""
        return ZhiNetwork(self.layers(), self.frame_size, arrays)
