"""Schemas of recordings."""

from server.answers.schema import Answer


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
