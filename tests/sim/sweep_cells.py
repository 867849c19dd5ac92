"""Cells of a sweep for tests."""

import time


def slow(a: int, b: int, seconds: float) -> dict[str, float]:
    """Takes its time."""
    time.sleep(seconds)
    return {"sum": a + b}


def failing(a: int) -> dict[str, int]:
    """Fails for 2, until somebody mends it."""
    if a == 2:
        raise RuntimeError("two is too much")
    return {"square": a * a}
