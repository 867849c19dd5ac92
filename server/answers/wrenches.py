"""Schemas of wrenches on the simulated robot."""

from typing import Literal

from server.answers.schema import Answer, Vector3


class WrenchAnswer(Answer):
    """A wrench at work."""

    id: int
    """names it in DELETE"""
    remaining_s: float
    """s of simulated time until it ends"""
    force_n: Vector3
    """N, in `frame`, on the body, at full height"""
    duration_s: float
    """s, with both ramps"""
    torque_nm: Vector3
    """N m, in `frame`, on the body, at full height"""
    point_m: Vector3
    """m, in the body's frame: where the force acts"""
    body: str
    """that it acts on"""
    frame: Literal["world", "heading", "body"]
    """of force and torque"""
    ramp_s: float
    """s, of the rise and of the fall"""


class WrenchCreatedAnswer(Answer):
    """The wrench acts from the next tick on."""

    id: int
    """names it in DELETE"""
