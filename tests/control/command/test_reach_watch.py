"""When a hand that stands beside its reference is told."""

from dataclasses import replace

import numpy as np

from control.command.limits import DEFAULT_COMMAND
from control.command.reach_watch import AFTER_S, AWAY_M, ReachWatch
from control.timing import CONTROL_PERIOD_S

PERIODS = round(AFTER_S / CONTROL_PERIOD_S) + 2


def told(offset_m: float, drift_mps: float = 0.0, mask: tuple[float, ...] = (0.0, 0.0, 0.0)) -> bool:
    """Whether a hand `offset_m` below its reference is told after a good second, moving at `drift_mps`."""
    watch, command, answer = ReachWatch(), replace(DEFAULT_COMMAND, mask=np.array(mask)), False
    for period in range(PERIODS):
        below = offset_m - drift_mps * period * CONTROL_PERIOD_S
        answer = watch.step(command, command.position_m - [0.0, 0.0, below], CONTROL_PERIOD_S)
    return answer


def test_a_hand_that_stands_away_is_told() -> None:
    assert told(3.0 * AWAY_M)


def test_one_that_is_near_or_on_its_way_or_free_on_that_axis_is_not() -> None:
    assert not told(0.5 * AWAY_M)
    assert not told(10.0 * AWAY_M, drift_mps=0.05)
    assert not told(3.0 * AWAY_M, mask=(0.0, 0.0, 1.0))
