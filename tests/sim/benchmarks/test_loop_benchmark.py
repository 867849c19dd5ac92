"""The loop benchmark's table of stages names every job of the timetable in the slots in which it runs."""

from control.timing import SLOT_COUNT, Job, slots
from sim.benchmarks.loop_headless import ready_session
from sim.benchmarks.loop_stages import EVERY_TICK, Stopwatch, stages, watched_stages
from sim.benchmarks.report import Report
from sim.runtime.history import HALF_SECOND


def test_every_job_of_the_timetable_has_a_stage_that_runs_in_its_slots_alone() -> None:
    report = Report("loop", seed=0)
    stages(report, HALF_SECOND + SLOT_COUNT)
    rows = [row for row in report.rows if row["case"] == "stage"]
    ran: dict[str, set[int]] = {}
    for row in rows:
        text = str(row["slots"])
        ran.setdefault(str(row["job"]), set()).update(range(SLOT_COUNT) if text == "all" else map(int, text.split()))
    assert set(ran) == {EVERY_TICK, *(job.name for job in Job)}
    for job in set(Job) - {Job.SHOWN_ESTIMATE}:
        assert ran[job.name] == set(slots(job))
    assert ran[Job.SHOWN_ESTIMATE.name] <= set(slots(Job.SHOWN_ESTIMATE))
    assert sum(row["case"] == "slot" for row in report.rows) == SLOT_COUNT


def test_watching_changes_nothing_and_ends() -> None:
    session = ready_session(seed=0)
    before = [getattr(target, name) for _, _, target, name in watched_stages(session)]
    stages(Report("loop", seed=0), SLOT_COUNT)
    assert [getattr(target, name) for _, _, target, name in watched_stages(session)] == before


def test_time_within_another_watched_stage_counts_there_alone() -> None:
    stopwatch = Stopwatch()
    inner = stopwatch.watched("inner", lambda: sum(range(200_000)))
    stopwatch.watched("outer", inner)()
    assert 0.0 <= stopwatch.spent_us["outer"][0] < stopwatch.spent_us["inner"][0]
