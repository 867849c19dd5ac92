"""The past of a simulation: any tick of the last minute can be gone on from, and unchanged it comes out to the byte."""

from typing import Any

import numpy as np
import pytest

from control.timing import TICK_S
from sim.runtime import history as history_module
from sim.runtime.history import History, HistoryTimeError
from sim.runtime.session import SessionError
from sim.runtime.simulation import Simulation, SimulationConfig
from sim.runtime.snapshot import SNAPSHOT
from tests.sim.runtime.test_state_capture import setpoint

END = 600
DEEDS = {
    200: (("add_wrench", {"force_n": [0.0, 5.0, 5.0], "duration_s": 0.8, "ramp_s": 0.1}),),
    337: (("select_estimator", {"name": "adaptive"}), ("set_mismatch", {"mass_scale": 1.2})),
    437: (("select_controller", {"name": "model_based"}),),
}
"""What is done after which tick."""


class Run:
    """A simulation with its history, told as the control loop tells it."""

    def __init__(self) -> None:
        self.session = Simulation(SimulationConfig(seed=11))
        self.history = History(self.session)
        self.records: dict[int, bytes] = {}

    @property
    def tick(self) -> int:
        return round(self.session.time_s / TICK_S)

    def do(self, name: str, /, **arguments: Any) -> None:
        call = getattr(self.session, name)
        call(**arguments)
        self.history.happened(call, arguments)

    def forward(self, ticks: int) -> None:
        for _ in range(ticks):
            for name, arguments in DEEDS.get(self.tick, ()):
                self.do(name, **arguments)
            asked = setpoint(self.tick)
            self.session.tick_setpoint(asked, 0.0)
            self.history.ticked(asked, 0.0)
            if self.tick % 10 == 3:
                self.do("track_errors", interval_s=0.02)
            if self.tick % 5 == 0:
                record = np.zeros(1, SNAPSHOT)[0]
                self.session.fill(record)
                record["sequence"] = self.tick
                self.history.published(record)
                self.records[self.tick] = record.tobytes()


@pytest.fixture
def ran() -> Run:
    run = Run()
    run.forward(END)
    return run


@pytest.mark.slow
def test_unchanged_it_does_to_the_byte_what_it_did(ran: Run) -> None:
    recorded = dict(ran.records)
    for branch, back in enumerate((0, 263, 100, 599, 1), start=1):
        ran.history.go_back((END - back) * TICK_S)
        assert (ran.tick, ran.history.branch) == (END - back, branch)
        ran.records.clear()
        ran.forward(min(back, 250))
        assert ran.records.items() <= recorded.items(), back
        ran.forward(END - ran.tick)


def test_a_moment_is_shown_without_touching_the_present(ran: Run) -> None:
    end_s, shown_s = ran.history.end_s, ran.history.end_s - 0.4
    ran.history.show(shown_s)
    assert ran.history.shown is not None
    assert float(ran.history.shown["time_s"]) == pytest.approx(shown_s, abs=5 * TICK_S)
    assert ran.session.time_s == pytest.approx(end_s)
    ran.forward(1)
    assert ran.history.shown is None


def test_what_is_shown_is_where_it_goes_on_by_default(ran: Run) -> None:
    ran.history.show(0.5)
    shown_s = ran.history.shown_s
    ran.history.go_back(None)
    assert ran.session.time_s == pytest.approx(shown_s)
    assert ran.history.end_s == pytest.approx(shown_s)


def test_what_it_does_not_reach_is_refused_with_its_range(ran: Run) -> None:
    for look in (ran.history.show, ran.history.go_back):
        with pytest.raises(HistoryTimeError, match=r"does not reach 9 s; 0\.002 to 1\.200 s"):
            look(9.0)
    assert ran.tick == 600


def test_a_latched_estop_stays_latched(ran: Run) -> None:
    ran.do("estop")
    ran.forward(5)
    ran.history.go_back(0.7)
    assert ran.session.pipeline.estop_latched


def test_it_forgets_what_is_older_than_its_window(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(history_module, "_WINDOW", 300)
    run = Run()
    run.forward(END + 100)
    assert run.history.end_s - run.history.start_s == pytest.approx(0.6)
    run.history.go_back(run.history.start_s)
    assert run.tick == 400


def test_going_back_again_and_again_loses_nothing_that_was_asked_before(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(history_module, "_WINDOW", 300)
    run = Run()
    run.forward(400)
    recorded = dict(run.records)
    for _ in range(3):  # more ticks than the history has room for
        run.history.go_back(150 * TICK_S)
        run.forward(250)
    run.history.go_back(120 * TICK_S)
    run.records.clear()
    run.forward(60)
    assert run.records.items() <= recorded.items()


def test_a_controller_that_does_not_say_what_it_carries_is_named() -> None:
    class Stateful:
        def reset(self) -> None: ...

        def step(self, inputs: Any) -> np.ndarray:
            return np.zeros(22)

    run = Run()
    run.session.pipeline.add_controller("own", Stateful())
    run.forward(1)
    assert "Stateful" in str(run.history.trouble)
    with pytest.raises(SessionError, match="Stateful, which does not say what it carries"):
        run.history.go_back(0.0)


def test_a_task_at_work_is_begun_again_or_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = setpoint(0)  # another sequence number would take over
    monkeypatch.setitem(globals(), "setpoint", lambda _tick: asked)
    run = Run()
    run.forward(100)
    run.do("start_task", name="guidance", options={})
    run.forward(700)
    expected = run.records[200]
    with pytest.raises(HistoryTimeError, match="a task was at work"):
        run.history.go_back(1.2)
    run.history.go_back(0.3)
    assert run.session.tasks.running
    run.history.go_back(0.1)
    assert not run.session.tasks.running
    run.do("start_task", name="guidance", options={})
    run.forward(100)
    assert run.records[200] == expected
