"""The loop, one turn at a time, around a session that only counts."""

import multiprocessing
import time
from collections.abc import Callable
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
import pytest

from control.command.limits import DEFAULT_COMMAND
from control.timing import CONTROL_PERIOD_S, SLOT_COUNT, TICK_S, Job, slots
from server import estop_lane
from server.control_loop import ControlLoop
from server.estop_lane import EstopLane
from server.messages import Close, Event, Outcome, Reply
from server.pacing import Pacer
from server.state import failure, faults
from sim.processes import shared_record
from sim.processes.shared_record import SharedRecord
from sim.runtime.simulation import Simulation
from sim.runtime.snapshot import SETPOINT, SNAPSHOT, Mode, command_to_record
from tests.server.fake_session import FakeSession

CONTEXT = multiprocessing.get_context("spawn")


class Bench:
    """A loop with both ends of everything it is connected to."""

    def __init__(
        self, *, paused: bool = False, state: SharedRecord | None = None, simulation: Simulation | None = None
    ) -> None:
        self.session = FakeSession()
        self.state = state or SharedRecord(shared_record.allocate(SNAPSHOT), SNAPSHOT)
        self.setpoints = SharedRecord(shared_record.allocate(SETPOINT), SETPOINT)
        self.estops = EstopLane(estop_lane.allocate())
        self.pipe, theirs = CONTEXT.Pipe()
        self.theirs: Connection = theirs
        self.pacer = Pacer(TICK_S, lambda: 0.0, lambda _: None)
        self.loop = ControlLoop(
            simulation or self.session,
            self.state,
            self.setpoints,
            self.estops,
            theirs,
            self.pacer,
            paused=paused,
            realtime=False,
        )

    def turn(self, count: int = 1) -> None:
        for _ in range(count):
            self.loop.turn()

    def send(self, event: str, /, event_id: int = 1, **arguments: Any) -> None:
        self.pipe.send(Event(event_id, event, arguments))

    def reply(self) -> Reply:
        assert self.pipe.poll(1.0)
        return self.pipe.recv()

    def ask(self, event: str, /, **arguments: Any) -> Reply:
        self.send(event, **arguments)
        self.turn()
        return self.reply()

    @property
    def snapshot(self) -> np.void:
        record = self.state.read()
        assert record is not None
        return record[0]


@pytest.fixture
def bench() -> Bench:
    bench = Bench()
    bench.turn()
    return bench


@pytest.fixture
def paused() -> Bench:
    bench = Bench(paused=True)
    bench.turn(3)
    return bench


def test_a_hold_makes_the_one_tick_that_gives_it_something_to_show(paused: Bench) -> None:
    assert paused.session.ticks == 1
    assert paused.snapshot["mode"] == Mode.PAUSED


def test_running_publishes_at_a_fixed_fraction_of_the_ticks(bench: Bench) -> None:
    before = int(bench.snapshot["sequence"])
    bench.turn(10 * SLOT_COUNT)
    assert int(bench.snapshot["sequence"]) - before == 10 * len(slots(Job.SNAPSHOT))
    assert bench.session.ticks == 1 + 10 * SLOT_COUNT


def test_pause_stops_time_and_run_goes_on(bench: Bench) -> None:
    assert bench.ask("run", state="paused", speed=None).value == {"state": "paused", "speed": 1.0}
    stopped = bench.session.ticks
    bench.turn(20)
    assert bench.session.ticks == stopped
    assert bench.ask("run", state="running", speed=2.0).value == {"state": "running", "speed": 2.0}
    assert bench.session.ticks == stopped + 1
    assert bench.snapshot["speed"] == 2.0


def test_speed_alone_leaves_a_pause_alone(paused: Bench) -> None:
    assert paused.ask("run", state=None, speed=0.5).value == {"state": "paused", "speed": 0.5}


def test_a_step_makes_exactly_its_ticks_and_answers_when_they_are_done(paused: Bench) -> None:
    before = paused.session.ticks
    paused.send("step", ticks=7)
    paused.turn(6)
    assert not paused.pipe.poll()
    paused.turn()
    assert paused.reply().value == {"time_s": pytest.approx(0.016)}
    assert paused.snapshot["time_s"] == pytest.approx(0.016)
    paused.turn(5)
    assert paused.session.ticks == before + 7


def test_a_step_is_refused_while_running_and_says_what_to_do(bench: Bench) -> None:
    reply = bench.ask("step", ticks=1)
    assert reply.outcome is Outcome.REFUSED
    assert "paused" in reply.value


def test_a_second_step_is_refused_while_one_is_under_way(paused: Bench) -> None:
    paused.send("step", ticks=3)
    paused.turn()
    reply = paused.ask("step", ticks=1)
    assert reply.outcome is Outcome.REFUSED


@pytest.mark.parametrize(
    ("event", "arguments", "said"),
    [
        ("run", {"state": "running", "speed": None}, "set running"),
        ("run", {"state": "paused", "speed": None}, "set paused"),
        ("reset", {}, "reset"),
        ("set_scene", {"name": "box"}, "set_scene"),
    ],
)
def test_what_comes_between_ends_a_step(paused: Bench, event: str, arguments: dict[str, Any], said: str) -> None:
    paused.send("step", event_id=5, ticks=100)
    paused.turn()
    paused.send(event, event_id=6, **arguments)
    paused.turn()
    replies = {reply.id: reply for reply in (paused.reply(), paused.reply())}
    assert replies[5].outcome is Outcome.REFUSED and said in replies[5].value
    assert replies[6].outcome is Outcome.DONE
    assert paused.ask("run", state="paused", speed=None).outcome is Outcome.DONE
    ticks = paused.session.ticks
    paused.turn(10)
    assert paused.session.ticks == ticks
    assert paused.ask("step", ticks=1).outcome is Outcome.DONE


def test_the_estop_ends_a_step(paused: Bench) -> None:
    paused.send("step", ticks=100)
    paused.turn()
    ticks = paused.session.ticks
    paused.estops.ask()
    paused.turn(10)
    reply = paused.reply()
    assert reply.outcome is Outcome.REFUSED and "e-stop" in reply.value
    assert paused.session.ticks == ticks


def test_steps_are_made_at_the_robots_own_pace_whatever_the_speed(paused: Bench) -> None:
    assert paused.ask("run", state="paused", speed=0.1).value == {"state": "paused", "speed": 0.1}
    paused.send("step", ticks=3)
    paused.turn()
    assert paused.pacer.period_s == 0.002
    paused.turn(2)
    assert paused.reply().outcome is Outcome.DONE
    paused.ask("run", state="running", speed=None)
    assert paused.pacer.period_s == 0.02


def clear_estop(bench: Bench) -> Reply:
    return bench.ask("clear_estop", estops=bench.estops.asked)


def test_the_estop_overtakes_whatever_waits_and_is_confirmed_by_what_is_published(paused: Bench) -> None:
    paused.send("reset", event_id=1, seed=None, keyframe="stand")
    number = paused.estops.ask()
    assert not paused.estops.taken(number)
    paused.turn()
    assert [call[0] for call in paused.session.calls if call[0] != "track_errors"] == ["estop", "reset"]
    assert paused.estops.taken(number)
    assert paused.snapshot["mode"] == Mode.ESTOP


def test_the_estop_has_its_turn_between_two_slow_events(paused: Bench) -> None:
    for number in range(3):
        paused.send("reset", event_id=number, seed=None, keyframe="stand")
    paused.turn()
    paused.estops.ask()
    paused.turn(2)
    assert [call[0] for call in paused.session.calls if call[0] != "track_errors"] == ["reset", "estop", "reset", "reset"]


def test_the_estop_is_told_as_latched_while_the_past_is_made_again_and_acts_on_what_comes_of_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    simulation = Simulation()
    bench = Bench(simulation=simulation)
    bench.turn(300)
    there = simulation.backend.data.qpos.copy()
    bench.turn(100)
    bench.ask("run", state="paused", speed=None)
    tick, told = simulation.tick_setpoint, list[tuple[bool, bool, bool]]()

    def watched(*inputs: Any) -> None:
        if not told:
            bench.estops.ask()
        told.append((bench.estops.pending, bench.snapshot["mode"] == Mode.ESTOP, simulation.pipeline.estop_latched))
        tick(*inputs)

    monkeypatch.setattr(simulation, "tick_setpoint", watched)
    assert bench.ask("branch", time_s=300 * TICK_S).outcome is Outcome.DONE
    assert told[0] == (True, False, False)
    assert set(told[1:]) == {(False, True, False)}
    assert simulation.pipeline.estop_latched
    assert bench.snapshot["mode"] == Mode.ESTOP
    np.testing.assert_array_equal(simulation.backend.data.qpos, there)


def test_clearing_the_estop_in_a_hold_answers_the_hold(paused: Bench) -> None:
    paused.estops.ask()
    paused.turn()
    assert clear_estop(paused).value == {"latched": False, "mode": "paused"}


def test_whoever_pressed_learns_that_it_acted_although_another_cleared_it_at_once(paused: Bench) -> None:
    number = paused.estops.ask()
    paused.send("clear_estop", estops=number)
    paused.turn()
    assert paused.snapshot["mode"] == Mode.PAUSED
    assert paused.estops.taken(number)
    assert paused.estops.mode is Mode.ESTOP


def test_only_what_was_pressed_before_is_cleared(paused: Bench) -> None:
    paused.send("clear_estop", estops=paused.estops.asked)
    paused.estops.ask()
    paused.turn()
    reply = paused.reply()
    assert reply.outcome is Outcome.REFUSED and "again" in reply.value
    assert paused.snapshot["mode"] == Mode.ESTOP


def test_a_web_process_that_reads_no_answers_does_not_hold_the_loop(bench: Bench) -> None:
    calls, before = 4000, bench.session.ticks
    for number in range(calls):
        bench.send("select_estimator", event_id=number, name="x" * 500)
        bench.turn()
    assert bench.session.ticks == before + calls
    answered = 0
    while bench.pipe.poll(0.0) or answered < calls:
        assert bench.reply().id == answered
        answered += 1
        bench.turn()


def test_whoever_has_a_reply_also_sees_its_effect(bench: Bench) -> None:
    bench.ask("set_scene", name="box")
    assert bench.snapshot["scene"] == b"box"


@pytest.mark.parametrize(
    ("name", "arguments", "outcome", "said"),
    [
        ("drive", {"request": "stand"}, Outcome.REFUSED, "no drives to engage"),
        ("select_estimator", {"name": "x"}, Outcome.INVALID, "unknown estimator"),
        ("remove_wrench", {"key": 9}, Outcome.MISSING, "not at work"),
        ("select_controller", {"name": "x"}, Outcome.FAILED, "a defect"),
        ("no_such_event", {}, Outcome.FAILED, "no_such_event"),
    ],
)
def test_every_kind_of_error_is_answered_and_the_loop_goes_on(
    bench: Bench, name: str, arguments: dict[str, Any], outcome: Outcome, said: str
) -> None:
    reply = bench.ask(name, **arguments)
    assert reply.outcome is outcome
    assert said in reply.value
    before = bench.session.ticks
    bench.turn(3)
    assert bench.session.ticks == before + 3


def test_a_failed_backend_is_a_fault_until_a_reset(bench: Bench) -> None:
    bench.ask("set_scene", name="broken")
    bench.turn(3)
    assert bench.snapshot["mode"] == Mode.FAULT
    assert failure(bench.snapshot) == "the simulation diverged; reset it"
    assert "BACKEND_FAILED" in faults(bench.snapshot)
    refused = bench.ask("run", state="running", speed=None)
    assert refused.outcome is Outcome.REFUSED
    assert "diverged" in refused.value
    assert bench.ask("reset", seed=1, keyframe="stand").outcome is Outcome.DONE
    assert bench.snapshot["mode"] == Mode.RUNNING
    assert failure(bench.snapshot) is None and faults(bench.snapshot) == []


def test_the_estop_latches_although_the_backend_has_failed(bench: Bench) -> None:
    bench.ask("set_scene", name="broken")
    bench.estops.ask()
    bench.turn(3)
    assert bench.snapshot["mode"] == Mode.ESTOP
    assert failure(bench.snapshot) is not None
    bench.ask("reset", seed=1, keyframe="stand")
    assert bench.snapshot["mode"] == Mode.ESTOP


def test_a_changed_set_point_is_taken_at_once_with_its_age(bench: Bench) -> None:
    setpoint = np.zeros(1, SETPOINT)
    setpoint[0]["sequence"] = 5
    setpoint[0]["heartbeat_s"] = time.monotonic() - 10.0
    bench.setpoints.write(setpoint)
    bench.turn()
    assert bench.snapshot["command_sequence"] == 5
    assert bench.session.ages_s[-1] == pytest.approx(10.0, abs=5.0)


@pytest.mark.parametrize(("event", "arguments"), [("reset", {}), ("set_scene", {"name": "box"})])
@pytest.mark.parametrize("read_before", [True, False])
def test_what_was_asked_before_a_restart_does_not_act_after_it(
    paused: Bench, event: str, arguments: dict[str, Any], read_before: bool
) -> None:
    setpoint = np.zeros(1, SETPOINT)
    command_to_record(replace(DEFAULT_COMMAND, guidance=True), setpoint[0]["command"])
    setpoint[0]["sequence"] = 5
    setpoint[0]["drag_active"] = True
    paused.setpoints.write(setpoint)
    if read_before:
        paused.ask("step", ticks=1)
        assert paused.session.command.guidance and paused.session.dragged
    paused.ask(event, **arguments)
    assert not paused.session.command.guidance and not paused.session.dragged
    setpoint[0]["heartbeat_s"] = time.monotonic()
    paused.setpoints.write(setpoint)
    paused.ask("step", ticks=1)
    assert not paused.session.command.guidance and not paused.session.dragged
    assert paused.session.ages_s[-1] < 5.0
    setpoint[0]["sequence"] += 1
    paused.setpoints.write(setpoint)
    paused.ask("step", ticks=1)
    assert paused.session.command.guidance and paused.session.dragged


def test_without_any_set_point_the_default_command_holds_and_the_operator_was_never_heard(bench: Bench) -> None:
    assert bench.session.ages_s[-1] > 1e6
    assert bench.session.command.position_m.tolist() == DEFAULT_COMMAND.position_m.tolist()


def test_snapshot_numbers_go_on_after_a_restart(bench: Bench) -> None:
    last = int(bench.snapshot["sequence"])
    again = Bench(state=bench.state)
    again.turn()
    assert int(again.snapshot["sequence"]) == last + 1


def test_live_errors_are_tracked_at_50_hz(bench: Bench) -> None:
    bench.session.calls.clear()
    bench.turn(100)
    assert [call for call in bench.session.calls if call[0] == "track_errors"] == [("track_errors", CONTROL_PERIOD_S)] * 10


def close_politely(bench: Bench) -> None:
    bench.pipe.send(Close())


def vanish(bench: Bench) -> None:
    bench.pipe.close()


@pytest.mark.parametrize("end", [close_politely, vanish])
def test_the_loop_ends_with_its_web_process(bench: Bench, end: Callable[[Bench], None]) -> None:
    end(bench)
    bench.loop.run()
