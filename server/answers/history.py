"""Schemas of the past of a simulation."""

from server.answers.schema import Answer, Vector3
from server.answers.selection import ObserverGains


class HistoryAnswer(Answer):
    """The last minute: what can be shown again, and gone on from."""

    start_s: float | None
    """s, simulated time of the earliest moment; null where nothing is kept"""
    end_s: float | None
    """s, simulated time of the newest moment, where the simulation goes on unless it is set back"""
    time_s: float | None
    """s, simulated time of the moment that is shown"""
    past: bool
    """an earlier moment is shown than the newest"""
    branch: int
    """counts how often the simulation has gone on from an earlier moment"""
    trouble: str | None
    """why nothing is kept, such as a controller that does not say what it carries; null while it is"""


class BranchAnswer(HistoryAnswer):
    """The simulation is set back and paused; what came later is forgotten."""

    gains: ObserverGains | None
    """of the momentum observer now, as set last; null: those it starts with"""
    mass_scale: float
    """factor on the mass of every link now"""
    per_link: dict[str, float]
    """further factor by link"""
    payload_kg: float
    """kg, that the simulated hand carries now"""
    payload_center_m: Vector3
    """m, where, in the end effector's frame"""
