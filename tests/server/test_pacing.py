"""Arithmetic of the schedule with a clock that only the test moves."""

import pytest

from control.timing import TICK_S
from server.pacing import LATENESS_WINDOW, MINUTE_S, REST_SHARE, STATISTICS_EVERY, Pacer


class Clock:
    """Time that passes only by `advance` and `sleep`."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.slept_s: list[float] = []

    def __call__(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.slept_s.append(seconds)
        self.now_s += seconds

    def advance(self, seconds: float) -> None:
        self.now_s += seconds


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def pacer(clock: Clock) -> Pacer:
    return Pacer(TICK_S, clock, clock.sleep)


def run_ticks(pacer: Pacer, clock: Clock, count: int, work_s: float, simulated_s: float = 0.0) -> float:
    for _ in range(count):
        pacer.wait()
        clock.advance(work_s)
        simulated_s += TICK_S
        pacer.finish(simulated_s)
    return simulated_s


def test_ticks_start_one_period_apart_whatever_the_work_takes(pacer: Pacer, clock: Clock) -> None:
    start = clock.now_s
    for index, work in enumerate([0.0005, 0.0015, 0.0001, 0.0019]):
        pacer.wait()
        assert clock.now_s == pytest.approx(start + index * TICK_S)
        clock.advance(work)
        pacer.finish(0.0)
    assert pacer.statistics().overruns == 0


def test_a_missed_deadline_is_one_overrun_and_the_schedule_stays(pacer: Pacer, clock: Clock) -> None:
    start = clock.now_s
    run_ticks(pacer, clock, 1, 0.003)
    run_ticks(pacer, clock, 3, 0.0005)
    pacer.wait()
    assert clock.now_s == pytest.approx(start + 4 * TICK_S)
    assert pacer.statistics().overruns == 1
    assert pacer.statistics().rebases == 0


def test_the_share_of_overruns_is_that_of_the_window(pacer: Pacer, clock: Clock) -> None:
    for _ in range(STATISTICS_EVERY // 10):
        run_ticks(pacer, clock, 1, 0.0025)
        run_ticks(pacer, clock, 9, 0.0005)
    assert pacer.statistics().overrun_share == pytest.approx(0.1)
    run_ticks(pacer, clock, LATENESS_WINDOW, 0.0005)
    assert pacer.statistics().overrun_share == 0.0


def test_what_was_missed_a_minute_ago_counts_no_longer(pacer: Pacer, clock: Clock) -> None:
    ticks_per_minute = round(MINUTE_S / TICK_S)
    run_ticks(pacer, clock, 1, 0.0025)
    run_ticks(pacer, clock, ticks_per_minute // 2, 0.0005)
    run_ticks(pacer, clock, 1, 0.0025)
    run_ticks(pacer, clock, ticks_per_minute // 2 - STATISTICS_EVERY, 0.0005)
    assert (pacer.statistics().overruns_last_minute, pacer.statistics().overruns) == (2, 2)
    run_ticks(pacer, clock, 3 * STATISTICS_EVERY, 0.0005)
    assert (pacer.statistics().overruns_last_minute, pacer.statistics().overruns) == (1, 2)
    run_ticks(pacer, clock, ticks_per_minute // 2, 0.0005)
    assert (pacer.statistics().overruns_last_minute, pacer.statistics().overruns) == (0, 2)
    pacer.excuse()
    run_ticks(pacer, clock, 1, 0.0025)
    assert pacer.statistics().overruns_last_minute == 1


def test_falling_far_behind_drops_the_lost_time_and_says_so(pacer: Pacer, clock: Clock) -> None:
    run_ticks(pacer, clock, 1, 0.25)
    resumed = clock.now_s
    run_ticks(pacer, clock, 3, 0.0005)
    pacer.wait()
    assert clock.now_s == pytest.approx(resumed + 3 * TICK_S)
    assert pacer.statistics().rebases == 1


def test_excused_work_is_neither_overrun_nor_lateness_but_is_noted(pacer: Pacer, clock: Clock) -> None:
    run_ticks(pacer, clock, STATISTICS_EVERY - 1, 0.0005)
    pacer.wait()
    clock.advance(0.8)
    pacer.excuse()
    clock.advance(0.0005)
    pacer.finish(0.0)
    statistics = pacer.statistics()
    assert (statistics.overruns, statistics.rebases) == (0, 0)
    assert statistics.held_s == pytest.approx(0.8)
    assert statistics.lateness_p99_ms == pytest.approx(0.0, abs=1e-6)
    assert statistics.tick_median_us == pytest.approx(500.0)


def test_lateness_and_duration_are_quantiles_of_a_window(pacer: Pacer, clock: Clock) -> None:
    run_ticks(pacer, clock, STATISTICS_EVERY - 10, 0.0005)
    for _ in range(5):
        pacer.wait()
        clock.advance(0.0030)  # makes the next tick 1 ms late
        pacer.finish(0.0)
        pacer.wait()
        clock.advance(0.0005)
        pacer.finish(0.0)
    assert pacer.statistics().lateness_p99_ms == pytest.approx(1.0)
    assert pacer.statistics().tick_median_us == pytest.approx(500.0)


@pytest.mark.parametrize("speed", [0.1, 1.0, 4.0])
def test_real_time_factor_is_the_speed_when_deadlines_hold(clock: Clock, speed: float) -> None:
    pacer = Pacer(TICK_S / speed, clock, clock.sleep)
    run_ticks(pacer, clock, 1000, 0.0002)
    statistics = pacer.statistics()
    assert statistics.real_time_factor == pytest.approx(speed)
    assert statistics.rate_hz == pytest.approx(500.0 * speed)


def test_a_loop_that_cannot_keep_up_shows_it_and_still_yields(pacer: Pacer, clock: Clock) -> None:
    run_ticks(pacer, clock, 2000, 0.004)
    statistics = pacer.statistics()
    assert statistics.real_time_factor == pytest.approx(0.5 / (1.0 + REST_SHARE), rel=0.02)
    assert statistics.overruns == 2000
    assert statistics.rebases > 10
    assert len(clock.slept_s) > 100


def test_a_loop_that_cannot_keep_up_is_not_stopped_as_a_real_time_process_that_never_rests(pacer: Pacer, clock: Clock) -> None:
    """Linux gives such a one 0.95 of each second."""
    for work_s in (0.0006, 0.004):
        start, slept = clock.now_s, len(clock.slept_s)
        pacer.period_s = 0.25 * work_s
        run_ticks(pacer, clock, round(1.0 / work_s), work_s)
        assert sum(clock.slept_s[slept:]) > 0.07 * (clock.now_s - start)


def test_real_time_factor_starts_anew_when_the_simulated_time_is_reset(pacer: Pacer, clock: Clock) -> None:
    run_ticks(pacer, clock, 1000, 0.0005)
    run_ticks(pacer, clock, 100, 0.0005, simulated_s=0.0)
    assert pacer.statistics().real_time_factor == pytest.approx(1.0)
