"""Schemas of what only a simulation does."""

from typing import Literal

from server.answers.schema import Answer, Vector3


class RunAnswer(Answer):
    """Whether the simulation runs."""

    state: Literal["running", "paused"]
    """also under a latched e-stop"""
    speed: float
    """simulated over wall-clock time, as asked"""


class StepAnswer(Answer):
    """The ticks are done."""

    time_s: float
    """s, simulated time after them"""


class ResetAnswer(Answer):
    """The robot is back."""

    seed: int | None
    """of the sensors' errors; null: as before"""
    keyframe: str
    """posture at the start"""


class SceneParameter(Answer):
    """Something of the scene that can be changed while it runs."""

    name: str
    """in PUT and PATCH; carries the unit"""
    value: float
    """now"""
    default: float
    """when nothing else is said"""
    minimum: float
    """of its range"""
    maximum: float
    """of its range"""


class SceneAnswer(Answer):
    """The scene."""

    name: str
    """of the scene"""
    available: list[str]
    """that can be chosen"""
    parameters: list[SceneParameter]
    """of this scene"""


class MismatchAnswer(Answer):
    """How the simulated robot's masses differ from the model that the estimator knows."""

    mass_scale: float | None
    """factor on the mass of every link; null on hardware"""
    per_link: dict[str, float]
    """further factor by link"""
    payload_kg: float | None
    """kg, of a point that the hand carries; null on hardware"""
    payload_center_m: Vector3 | None
    """m, where, in the end effector's frame; null on hardware"""
    mass_scale_true: float | None
    """mass of the whole robot over the model's; null on hardware"""
