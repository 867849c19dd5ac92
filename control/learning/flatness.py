"""Whether a learning curve has flattened, by a rule that is the same for every training."""

from collections.abc import Sequence

import numpy as np

LEAST_POINTS = 100
"""A shorter curve has not been seen to flatten."""

TOLERANCE = 0.01


def flattened(rewards: Sequence[float]) -> bool:
    """Whether the last quarter of a curve of at least LEAST_POINTS exceeds the quarter before by less than 1 % of itself."""
    if len(rewards) < LEAST_POINTS:
        return False
    quarter = len(rewards) // 4
    last, before = np.mean(rewards[-quarter:]), np.mean(rewards[-2 * quarter : -quarter])
    return bool(last - before < TOLERANCE * abs(last))
