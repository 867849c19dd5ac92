"""A border around the robot's own body: where the arm comes near it, the references stop that would bring it nearer."""

from dataclasses import dataclass, replace

import numpy as np

from control.command.limits import HandState
from control.command.self_distance import SelfDistance
from control.frames import quaternion_from_rotation, rotation_error, rotation_from_quaternion
from control.robot_model import RobotModel
from control.timing import CONTROL_PERIOD_S
from control.types import Command


@dataclass(frozen=True, slots=True)
class SelfContactConfig:
    """Attributes:
    border_m: distance between arm and body at which references stop.
    watch_m: distance up to which it is measured exactly.
    ahead_s: the distance counts that the arm's speed leaves after this time, in which the hand brakes.
    position_gain, orientation_gain: 1/s, from the errors of the hand to where it is about to move.
    """

    border_m: float = 0.05
    watch_m: float = 0.13
    ahead_s: float = 0.25
    position_gain: float = 6.0
    orientation_gain: float = 8.0


class SelfContactBorder:
    """Holds the hand where moving on to its target would bring the arm nearer to a body that is near already.

    An arm that begins near the body, as after a fall, unfolds freely first.

    Attributes:
        distance_m: between arm and body at the last step; `watch_m` or more where they are farther apart.
    """

    STATE = ("_distance", "_unfolded", "distance_m", "_held")

    def __init__(self, config: SelfContactConfig, model: RobotModel) -> None:
        self._config, self._model = config, model
        self._distance = SelfDistance(model)
        self.reset()

    def reset(self) -> None:
        """Begin anew, as when the controller gets hold of the robot."""
        self._unfolded = False
        self.distance_m = self._config.watch_m
        self._held: tuple[np.ndarray, np.ndarray] | None = None

    def step(self, command: Command, hand: HandState) -> tuple[Command, bool]:
        """The command, with the pose at which the hand came too near where it must not move on; whether that is so.

        Args:
            command: within the limits.
            hand: measured.
        """
        config = self._config
        nearest = self._distance.nearest_within(config.watch_m)
        last, self.distance_m = self.distance_m, config.watch_m if nearest is None else nearest.distance_m
        ahead = self.distance_m + min(0.0, self.distance_m - last) * config.ahead_s / CONTROL_PERIOD_S
        self._unfolded |= self.distance_m > config.border_m
        if nearest is None or ahead > config.border_m or not self._unfolded or command.mask.all():
            self._held = None
            return command, False
        heading = self._model.rotation_heading_to_world
        rotation = rotation_from_quaternion(command.orientation_wxyz)
        linear = config.position_gain * (1.0 - command.mask) * (command.position_m - hand.position_in_heading)
        angular = config.orientation_gain * rotation_error(rotation, hand.rotation_to_heading)
        twist = np.concatenate([heading @ linear, heading @ angular])
        if self._distance.closing_speed(nearest, twist) <= 0.0:
            self._held = None
            return command, False
        if self._held is None:
            self._held = hand.position_in_heading.copy(), quaternion_from_rotation(hand.rotation_to_heading)
        position, orientation = self._held
        return replace(command, position_m=position, orientation_wxyz=orientation), True
