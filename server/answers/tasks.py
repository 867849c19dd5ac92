"""Schemas of tasks: what the robot does by itself."""

from typing import Literal

from server.answers.schema import Answer, Vector3

OutcomeName = Literal["succeeded", "failed", "aborted"]


class TaskOption(Answer):
    """A number that shapes a task."""

    default: float
    """when it is left out"""
    minimum: float
    """of its range"""
    maximum: float
    """of its range"""
    unit: str
    """of the number, or what it means"""


class TaskKind(Answer):
    """A task that can be begun."""

    name: str
    """in POST"""
    scene: str
    """that it needs in simulation; empty: any"""
    description: str
    """what it does"""
    options: dict[str, TaskOption]
    """of POST, by name; `site_x_m`, `site_y_m` and `site_yaw_rad` say where the scene's frame lies in the robot's odometry"""


class TaskCreatedAnswer(Answer):
    """The task acts from the next control period on."""

    id: int
    """names it in GET and DELETE"""


class TaskAnswer(Answer):
    """A task that was begun. All but `readings` is as the robot estimates it."""

    id: int
    """counts tasks"""
    name: str
    """of the task"""
    options: dict[str, float]
    """all of them"""
    phase: str
    """what it does now, or did last"""
    progress: float
    """0 to 1"""
    outcome: OutcomeName | None
    """null while it is at work"""
    reason: str | None
    """why it failed or was aborted"""
    metrics: dict[str, float | None]
    """what there is to say about it; names carry units"""
    readings: dict[str, float]
    """of the scene, as long as it was at work; empty on a robot"""
    plan_m: list[Vector3]
    """m, in the robot's odometry: a line that shows what is meant"""
