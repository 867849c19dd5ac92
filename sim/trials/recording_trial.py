"""An estimator over a part of a recording, from a keyframe to the next one: what a sweep over recordings tries."""

from pathlib import Path

import numpy as np

from control.timing import TICK_S
from sim.recording.reader import Recording
from sim.reestimate import compared


def keyframe_times(recording: str) -> list[float]:
    """Times of a recording's keyframes, s since its start.

    Raises:
        RecordingFormatError: it is none.
    """
    opened = Recording(Path(recording))
    opened.close()
    return [TICK_S * tick for tick in opened.keyframes]


def recording_trial(recording: str, from_s: float, estimator: str, gains: str = "") -> dict[str, float | None]:
    """What the estimator says in that part, against what was estimated then and against the truth.

    Args:
        recording: path of its file.
        from_s: time of the keyframe, s since the start.
        estimator: which one.
        gains: of its momentum observer as "K1:K2", empty for those that it had.

    Raises:
        ValueError: a name or gains that do not exist.
    """
    to_s = min((time_s for time_s in keyframe_times(recording) if time_s > from_s + 0.5 * TICK_S), default=np.inf)
    part = Recording(Path(recording), from_s, to_s)
    k1, _, k2 = gains.partition(":")
    try:
        result = compared(part, estimator, (float(k1), float(k2)) if gains else None)
    finally:
        part.close()
    names = ("difference_rms_n", "error_rms_n", "error_then_rms_n", "real_time_factor")
    return {name: result.get(name) for name in names} | {"robot_minutes": len(result["time_s"]) * TICK_S / 60.0}
