"""Schemas of recordings."""

from typing import Literal

from server.answers.schema import Answer, Vector3
from server.answers.selection import ObserverGains


class RecordingAnswer(Answer):
    """A recording, under way or finished."""

    id: str
    """in the path of its calls, and the name of its file"""
    name: str
    """as given"""
    note: str
    """as given"""
    started: str
    """ISO 8601, UTC"""
    duration_s: float
    """s, of the robot's time"""
    size_bytes: int
    """of the file"""
    scene: str
    """of the simulation; `robot` on hardware"""
    complete: bool
    """it was ended in order; false while under way, or if it was cut off and lacks at most its last second"""
    gaps: int
    """how often ticks are missing in it, because the recorder was held up"""


class EstimatesCreatedAnswer(Answer):
    """An estimator has begun to run over a recording."""

    id: int
    """in the path of its result"""


class EstimatesAnswer(Answer):
    """An estimator over a recording, and what the recording's own one said then."""

    id: int
    """of this result"""
    state: Literal["running", "done", "failed"]
    """what follows `message` is null or empty until it is done"""
    estimator: str
    """which one"""
    gains: ObserverGains | None
    """of its momentum observer; null: those that it had"""
    message: str | None
    """why it failed"""
    difference_rms_n: float | None
    """N, between now and then"""
    error_rms_n: float | None
    """N, now, against the truth; null without one"""
    error_then_rms_n: float | None
    """N, then"""
    real_time_factor: float | None
    """recorded over computing time"""
    time_s: list[float]
    """s since the start, 50 Hz"""
    force_n: list[Vector3]
    """N, heading, of the environment on the robot"""
    force_then_n: list[list[float | None]]
    """the same as it was estimated then; null before the first estimate"""
