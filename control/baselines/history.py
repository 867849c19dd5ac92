"""Histories of frames, of one robot or many: zeros where there was no frame yet."""

import numpy as np


class History:
    """The last frames of n robots.

    Attributes:
        ages: (n,) number of frames since the robot started.
    """

    STATE = ("_frames", "ages")

    def __init__(self, count: int, frames: int, frame_size: int) -> None:
        self._frames = np.zeros((count, frames, frame_size), np.float32)
        self.ages = np.zeros(count, int)

    @property
    def flat(self) -> np.ndarray:
        """(n, frames * frame size) float32, oldest first; not changed by later steps."""
        return self._frames.reshape(len(self._frames), -1)

    def reset(self, ids: np.ndarray | slice = slice(None)) -> None:
        """Forget the frames of some robots."""
        self._frames = self._frames.copy()
        self._frames[ids] = 0.0
        self.ages[ids] = 0

    def push(self, frames: np.ndarray) -> None:
        """Take in the newest frames (n, frame size)."""
        moved = np.empty_like(self._frames)
        moved[:, :-1], moved[:, -1] = self._frames[:, 1:], frames
        self._frames = moved
        self.ages += 1

    def restart(self, ids: np.ndarray, frames: np.ndarray) -> None:
        """Robots `ids` (m,) start with frames (m, frame size) as their only ones."""
        self.reset(ids)
        self._frames[ids, -1] = frames
        self.ages[ids] = 1
