"""What a task may see at one moment: estimates alone, in the frame of the site where it works.

The frame of a site lies on the ground: a scene is built in it with the robot at its origin, x ahead. Where it lies is believed,
not known: its pose in the robot's odometry is an option of every task.
"""

from dataclasses import dataclass, replace

import numpy as np

from control.faults import Fault
from control.frames import rotation_z
from control.pipeline import PipelineOutput
from control.types import Command


@dataclass(frozen=True, slots=True)
class Site:
    """Believed pose of a site's frame in the odometry's: m, m, rad."""

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0

    def in_odometry(self, points_m: np.ndarray) -> np.ndarray:
        """Points (n, 3) of the site's frame in the odometry's."""
        return points_m @ rotation_z(self.yaw_rad).T + [self.x_m, self.y_m, 0.0]


@dataclass(frozen=True, slots=True)
class TaskView:
    """Estimates at one control period, and how to command in the same frame.

    Attributes:
        time_s: of the session.
        phase_s: since the task's phase began.
        position_m: (2,) of the base, in the site's frame, by odometry.
        yaw_rad: of the heading frame in the site's.
        sigma_m: standard deviation of the odometry's position.
        hand_m: (3,) in the site's frame.
        hand_in_heading_m: (3,).
        force_n: (3,) estimated, environment on hand, in the site's frame.
        force_in_heading_n: (3,) the same in heading.
        up: cosine of the tilt of the base.
        faults: of the pipeline.
        damping: the drives only damp.
    """

    time_s: float
    phase_s: float
    position_m: np.ndarray
    yaw_rad: float
    sigma_m: float
    hand_m: np.ndarray
    hand_in_heading_m: np.ndarray
    force_n: np.ndarray
    force_in_heading_n: np.ndarray
    up: float
    faults: Fault
    damping: bool

    def seen_from(self, site: Site) -> "TaskView":
        """The same in the frame of a site whose pose is one in this frame."""
        turn, origin = rotation_z(site.yaw_rad), np.array([site.x_m, site.y_m, 0.0])
        return replace(
            self,
            position_m=(self.position_m - origin[:2]) @ turn[:2, :2],
            yaw_rad=float(np.angle(np.exp(1j * (self.yaw_rad - site.yaw_rad)))),
            hand_m=(self.hand_m - origin) @ turn,
            force_n=self.force_n @ turn,
        )

    def in_heading(self, point_m: np.ndarray) -> np.ndarray:
        """A point (3,) of the site's frame in the heading frame."""
        return (np.asarray(point_m) - [*self.position_m, 0.0]) @ rotation_z(self.yaw_rad)

    def command(
        self,
        point_m: np.ndarray,
        *,
        pitch_rad: float,
        yaw_rad: float = 0.0,
        mask: tuple[int, int, int] = (0, 0, 0),
        force_n: np.ndarray | tuple[float, float, float] = (0.0, 0.0, 0.0),
        velocity: tuple[float, float] = (0.0, 0.0),
    ) -> Command:
        """A command whose parts are given in the site's frame.

        Args:
            point_m: (3,) of the hand, used on position axes.
            pitch_rad: of the tool below the horizon.
            yaw_rad: of the tool, to the left.
            mask: 1 for force, per axis of the heading frame.
            force_n: (3,) of the environment on the hand.
            velocity: of the base, m/s ahead and rad/s.
        """
        return Command(
            mask=np.array(mask, float),
            force_n=np.asarray(force_n, float) @ rotation_z(self.yaw_rad),
            position_m=self.in_heading(point_m),
            orientation_wxyz=tool(pitch_rad, yaw_rad - self.yaw_rad),
            base_velocity=np.array([velocity[0], 0.0, velocity[1]]),
        )


def tool(pitch_rad: float, yaw_rad: float = 0.0) -> np.ndarray:
    """Orientation (4,) wxyz of a hand that points ahead, turned left by the yaw, then down by the pitch."""
    cy, sy, cp, sp = np.cos(yaw_rad / 2), np.sin(yaw_rad / 2), np.cos(pitch_rad / 2), np.sin(pitch_rad / 2)
    return np.array([cy * cp, -sy * sp, cy * sp, sy * cp])


def look(output: PipelineOutput, position_m: np.ndarray, time_s: float, site: Site) -> TaskView:
    """The view after a tick that gave `output`, of a base at `position_m` (2,) in the odometry, at the beginning of a phase."""
    odometry, hand = output.odometry, output.hand
    position = (position_m - [site.x_m, site.y_m]) @ rotation_z(site.yaw_rad)[:2, :2]
    yaw = odometry.yaw_rad - site.yaw_rad
    turn = rotation_z(yaw)
    return TaskView(
        time_s=time_s,
        phase_s=0.0,
        position_m=position,
        yaw_rad=yaw,
        sigma_m=odometry.sigma_m,
        hand_m=turn @ hand.position_in_heading + [*position, 0.0],
        hand_in_heading_m=hand.position_in_heading,
        force_n=turn @ hand.force_estimated_n,
        force_in_heading_n=hand.force_estimated_n,
        up=float(output.base.rotation_base_to_world[2, 2]),
        faults=output.safety.faults,
        damping=output.safety.damping,
    )
