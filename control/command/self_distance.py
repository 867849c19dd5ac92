"""How near the arm is to the rest of the robot, from the shapes in the robot's MJCF."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from control.joints import ARM_JOINT_NAMES, ARM_SLICE
from control.paths import ROBOT_MJCF
from control.robot_model import RobotModel

ARM_PARTS = ("arm_link3", "arm_link4", "arm_link5", "arm_link6", "end_effector_stem", "end_effector")
"""Shapes of the arm that can reach the others; the first two links turn above the base."""
BODY_PARTS = (
    *("base_trunk", "base_head", "arm_base"),
    *(f"{leg}_{part}" for leg in ("FL", "FR") for part in ("hip", "thigh", "calf", "wheel")),
    *(f"{leg}_{part}" for leg in ("RL", "RR") for part in ("hip", "thigh")),
)
"""Shapes that the arm can reach."""

_DAMPING_M = 0.04
"""Of the inverse kinematics, like the arm's own."""

_LONGEST_M = 1.0
"""No point of arm or legs lies farther than this from a joint that moves it."""


@dataclass(frozen=True, slots=True)
class Nearest:
    """Where the arm is nearest to the rest of the robot.

    Attributes:
        distance_m: negative where they overlap.
        parts: names of the two shapes, the arm's first.
        point_m: (3,) on the arm, world-aligned, from the base origin.
        away: (3,) unit vector, world-aligned, from the body to the arm.
        moving_joints: how many of the arm's joints, counted from the base, move the point.
    """

    distance_m: float
    parts: tuple[str, str]
    point_m: np.ndarray
    away: np.ndarray
    moving_joints: int


class SelfDistance:
    """Distance between arm and body at the model's last configuration."""

    STATE = ("_distance_m", "_measured_at")

    def __init__(self, model: RobotModel, mjcf: Path = ROBOT_MJCF) -> None:
        """`mjcf` is the one of `model`."""
        self._model = model
        rigid = model.pinocchio_model
        self._shapes = pin.buildGeomFromMJCF(rigid, str(mjcf), pin.GeometryType.COLLISION)
        index = {shape.name: number for number, shape in enumerate(self._shapes.geometryObjects)}
        self._parts = [(arm, body) for arm in ARM_PARTS for body in BODY_PARTS]
        for arm, body in self._parts:
            self._shapes.addCollisionPair(pin.CollisionPair(index[arm], index[body]))
        self._data = self._shapes.createData()
        carrying = {arm: rigid.names[self._shapes.geometryObjects[index[arm]].parentJoint] for arm in ARM_PARTS}
        self._moving = {arm: 1 + ARM_JOINT_NAMES.index(joint) for arm, joint in carrying.items()}
        self._distance_m = 0.0
        self._measured_at = np.full_like(model.joint_configuration, np.inf)

    def nearest_within(self, distance_m: float) -> Nearest | None:
        """The nearest pair, or None where it lies farther apart than `distance_m`.

        Measured only where the joints have turned far enough since the last time to bring the arm that near.
        """
        turned = float(np.abs(self._model.joint_configuration - self._measured_at).sum())
        if self._distance_m - _LONGEST_M * turned > distance_m:
            return None
        nearest = self.nearest()
        self._distance_m, self._measured_at = nearest.distance_m, self._model.joint_configuration.copy()
        return nearest if nearest.distance_m <= distance_m else None

    def nearest(self) -> Nearest:
        """The nearest pair; some 0.3 ms."""
        pin.updateGeometryPlacements(self._model.pinocchio_model, self._model.pinocchio_data, self._shapes, self._data)
        pin.computeDistances(self._shapes, self._data)
        results = self._data.distanceResults
        distances = [result.min_distance for result in results]
        number = int(np.argmin(distances))
        result, parts = results[number], self._parts[number]
        return Nearest(
            distances[number],
            parts,
            np.array(result.getNearestPoint1()),
            -np.array(result.normal),
            self._moving[parts[0]],
        )

    def closing_speed(self, nearest: Nearest, twist: np.ndarray) -> float:
        """Speed, m/s, at which the arm nears the body there when the hand moves with a twist relative to the base.

        The joint velocities are the damped least-squares ones, J^T (J J^T + d^2)^-1 t.

        Args:
            nearest: of the same configuration.
            twist: (6,) linear m/s and angular rad/s of the hand, world-aligned.
        """
        jacobian = self._hand_jacobian()
        normal = jacobian @ jacobian.T + _DAMPING_M**2 * np.eye(6)
        return -self.rate(nearest, jacobian.T @ np.linalg.solve(normal, twist))

    def rate(self, nearest: Nearest, arm_velocity: np.ndarray) -> float:
        """Change of the distance there, m/s, under joint velocities (6,), rad/s, of the arm."""
        moving = np.where(np.arange(6) < nearest.moving_joints, arm_velocity, 0.0)
        linear, angular = np.split(self._hand_jacobian() @ moving, 2)
        return float(nearest.away @ (linear + np.cross(angular, nearest.point_m - self._model.end_effector_position)))

    def _hand_jacobian(self) -> np.ndarray:
        return self._model.end_effector_jacobian[:, self._model.joint_rows[ARM_SLICE]]
