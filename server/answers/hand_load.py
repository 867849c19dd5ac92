"""Schemas of tool and tare."""

from server.answers.schema import Answer, Vector3


class ToolAnswer(Answer):
    """What the hand carries, as set or found."""

    mass_kg: float
    """kg, beyond the nominal end effector"""
    center_of_mass_m: Vector3
    """m, in the end effector's frame"""
    identifying: float | None
    """progress of the motion that finds the tool, 0 to 1; null without one"""
    message: str | None
    """why the last motion found nothing, or why the tool as told seems not to be mounted; null otherwise"""


class TareAnswer(Answer):
    """What is taken from the selected estimate."""

    offset_n: Vector3
    """N, heading"""
