"""The e-stop's lane: whoever asked may be held until it has acted, for a moment and a small share of the time."""

import types

import pytest

from server import estop_lane
from server.estop_lane import HELD_S, HELD_SHARE, EstopLane
from sim.runtime.snapshot import Mode


class Clock:
    """Time that passes while somebody sleeps."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.after_sleep = lambda: None

    def monotonic(self) -> float:
        return self.now_s

    def sleep(self, duration_s: float) -> None:
        self.now_s += duration_s
        self.after_sleep()


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(estop_lane, "time", types.SimpleNamespace(monotonic=clock.monotonic, sleep=clock.sleep))
    return clock


@pytest.fixture
def lane() -> EstopLane:
    return EstopLane(estop_lane.allocate())


def test_the_caller_goes_on_as_soon_as_the_estop_has_acted(lane: EstopLane, clock: Clock) -> None:
    number = lane.ask()
    clock.after_sleep = lambda: lane.take(number, Mode.ESTOP) if clock.now_s > 0.5 * HELD_S else None
    lane.hold_until_taken(number)
    assert lane.taken(number) and 0.5 * HELD_S < clock.now_s < 0.75 * HELD_S


def test_a_dead_control_process_holds_nobody_for_long(lane: EstopLane, clock: Clock) -> None:
    lane.hold_until_taken(lane.ask())
    assert HELD_S <= clock.now_s < 1.2 * HELD_S


def test_presses_without_end_hold_for_a_small_share_of_the_time(lane: EstopLane, clock: Clock) -> None:
    held_s = 0.0
    while clock.now_s < 10.0:
        began_s = clock.now_s
        lane.hold_until_taken(lane.ask())
        held_s += clock.now_s - began_s
        clock.now_s += 0.001
    assert held_s <= 1.1 * HELD_SHARE * clock.now_s
