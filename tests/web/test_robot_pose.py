"""Where the robot's bodies are, and which one is under a click."""

import numpy as np
import pytest

from control.frames import rotation_z
from web.robot_pose import RobotPose


@pytest.fixture(scope="module")
def pose() -> RobotPose:
    return RobotPose()


@pytest.mark.parametrize("body", ["base", "FL_calf", "arm_link2"])
def test_a_ray_through_a_body_meets_the_robot_where_it_says(pose: RobotPose, snapshot: np.void, body: str) -> None:
    snapshot["base_position"], snapshot["base_orientation_wxyz"] = [1.0, -2.0, 0.4], [np.cos(0.3), 0.0, 0.0, np.sin(0.3)]
    pose.update(snapshot)
    target = pose.pose(body)[0]
    origin = np.array([4.0, 1.0, 2.0])
    direction = (target - origin) / np.linalg.norm(target - origin)
    hit = pose.hit(origin, direction)
    assert hit is not None
    position, rotation = pose.pose(hit[0])
    reached = position + rotation @ hit[1] - origin
    np.testing.assert_allclose(np.cross(reached, direction), 0.0, atol=1e-9)
    assert 0.0 < reached @ direction <= np.linalg.norm(target - origin) + 0.2


def test_a_ray_beside_the_robot_meets_nothing(pose: RobotPose, snapshot: np.void) -> None:
    pose.update(snapshot)
    assert pose.hit(np.array([3.0, 0.0, 0.5]), np.array([1.0, 0.0, 0.0])) is None


def test_bodies_move_with_the_base(pose: RobotPose, snapshot: np.void) -> None:
    pose.update(snapshot)
    before = pose.pose("end_effector")[0] - snapshot["base_position"]
    snapshot["base_position"], snapshot["base_orientation_wxyz"] = [5.0, 1.0, 0.3], [np.cos(0.5), 0.0, 0.0, np.sin(0.5)]
    pose.update(snapshot)
    np.testing.assert_allclose(pose.pose("end_effector")[0], snapshot["base_position"] + rotation_z(1.0) @ before, atol=1e-9)
