"""Schema of a recording that is shown."""

from typing import Literal

from server.answers.schema import Answer


class ReplayAnswer(Answer):
    """Where it stands."""

    time_s: float
    """s since the recording's start, also the `time_s` of the state"""
    duration_s: float
    """s, of the whole"""
    state: Literal["playing", "paused"]
    """paused at the end, too"""
    speed: float
    """1: as it happened"""
