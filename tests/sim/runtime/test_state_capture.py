"""The law of captured state: take, run, put back, run gives the same bytes; and nothing that changes goes unnamed."""

import hashlib
from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from control.command.limits import DEFAULT_COMMAND
from control.state.capture import Moment, StateError, is_frozen, scratch_names, state_names
from sim import scenes
from sim.runtime.simulation import Simulation, SimulationConfig
from sim.runtime.snapshot import SETPOINT, SNAPSHOT, command_to_record

PERIOD = 10
"""Ticks between two changes of what is asked."""


def setpoint(tick: int) -> np.void:
    """What an operator asks at a tick: everything that can be asked, sooner or later, and pulls at the hand."""
    phase = tick // 60
    command = replace(
        DEFAULT_COMMAND,
        mask=np.array([phase % 2, phase // 2 % 2, phase // 3 % 2], float),
        force_n=np.array([5.0, -5.0, 8.0]),
        base_velocity=np.array([0.3 * (phase % 3 == 1), 0.0, 0.4 * (phase % 4 == 2)]),
        guidance=phase % 5 == 4,
    )
    record = np.zeros(1, SETPOINT)[0]
    record["sequence"] = phase
    command_to_record(command, record["command"])
    record["drag_active"] = phase % 3 == 0
    record["drag_target_in_world"] = (0.7, 0.1, 0.6)
    return record


def happen(session: Simulation, tick: int) -> None:
    """What else happens at a tick."""
    names, controllers = session.pipeline.estimator_names, session.pipeline.controller_names
    match tick % 200:
        case 20:
            session.add_wrench(force_n=[4.0, -3.0, 6.0], duration_s=0.3, ramp_s=0.1)
        case 50:
            session.select_estimator(names[tick // 200 % len(names)])
        case 70:
            session.set_mismatch(1.0 + 0.1 * (tick // 200 % 3))
        case 90:
            session.select_controller(controllers[tick // 200 % len(controllers)])
        case 130:
            session.select_estimator("gmo_cqp", 8.0, 30.0)
        case 150:
            session.estop()
        case 160:
            session.clear_estop()


def run(session: Simulation, first: int, count: int, *, events: bool = True) -> list[bytes]:
    """Digest of the snapshot after every tick."""
    digests = []
    record = np.zeros(1, SNAPSHOT)
    for tick in range(first, first + count):
        if events:
            happen(session, tick)
        session.tick_setpoint(setpoint(tick), 0.0)
        if tick % 10 == 0:
            session.track_errors(0.02)
        record[0]["sequence"] = tick
        session.fill(record[0])
        digests.append(hashlib.blake2b(record.tobytes()).digest())
    return digests


def carriers(value: Any, seen: set[int]) -> Iterator[Any]:
    """Every object of ours that can be reached, whether or not anyone names it."""
    kind = type(value)
    if id(value) in seen or isinstance(value, type):
        return
    seen.add(id(value))
    if isinstance(value, dict):
        items = list(value.values())
    elif isinstance(value, list | tuple) or kind.__name__ == "deque":
        items = list(value)
    elif kind.__module__.split(".")[0] in {"control", "sim"} and not is_frozen(kind):
        yield value
        items = list(attributes(value).values())
    else:
        return
    for item in items:
        yield from carriers(item, seen)


def attributes(carrier: Any) -> dict[str, Any]:
    slots = [name for base in type(carrier).__mro__ for name in vars(base).get("__slots__", ())]
    return {**getattr(carrier, "__dict__", {}), **{name: getattr(carrier, name) for name in slots if hasattr(carrier, name)}}


def content(value: Any) -> Any:
    """What an attribute holds, comparable later on; objects of ours by their identity."""
    if isinstance(value, np.ndarray):
        return (value.dtype.str, value.shape, value.tobytes())
    if isinstance(value, dict):
        return {key: content(item) for key, item in value.items()}
    if isinstance(value, list | tuple) or type(value).__name__ == "deque":
        return tuple(content(item) for item in value)
    if isinstance(value, np.random.Generator):
        return repr(value.bit_generator.state)
    if is_frozen(type(value)):
        return {field.name: content(getattr(value, field.name)) for field in fields(value)}
    return value if isinstance(value, int | float | str | bytes | type(None)) else id(value)


@pytest.mark.slow
def test_whatever_changes_is_named_as_carried_or_as_scratch() -> None:
    session = Simulation(SimulationConfig(seed=3))
    run(session, 0, 5)
    before = [
        (carrier, {name: content(value) for name, value in attributes(carrier).items()}) for carrier in carriers(session, set())
    ]
    assert len(before) > 30
    run(session, 5, 400)
    unnamed = {
        f"{type(carrier).__module__}.{type(carrier).__name__}.{name}"
        for carrier, held in before
        for name, value in attributes(carrier).items()
        if name not in (state_names(type(carrier)) or ())
        and name not in scratch_names(type(carrier))
        and content(value) != held.get(name)
    }
    assert not unnamed, "name them in STATE or SCRATCH (control.state.capture)"


def scratch(session: Simulation) -> list[tuple[np.ndarray, np.ndarray]]:
    """Every array that is said to be overwritten before it is read, and its content now."""
    arrays = (getattr(carrier, name) for carrier in carriers(session, set()) for name in scratch_names(type(carrier)))
    return [(array, array.copy()) for array in arrays if isinstance(array, np.ndarray) and array.base is None]


@pytest.mark.slow
@pytest.mark.parametrize("scene", scenes.SCENE_NAMES)
def test_take_run_put_back_run_gives_the_same_bytes(scene: str) -> None:
    session = Simulation(SimulationConfig(scene=scene, seed=7))
    start = 303
    run(session, 0, 100)
    stale = scratch(session)
    run(session, 100, start - 100)
    moment = Moment(session)
    later: dict[int, Moment] = {}
    digests: list[bytes] = []
    for tick in range(start, start + 900, 150):
        later[tick] = Moment(session)
        digests += run(session, tick, 150)
    moment.restore()
    for array, content_then in stale:
        array[...] = content_then
    assert run(session, start, 900) == digests
    for tick in (start + 450, start, start + 750):
        later[tick].restore()
        assert run(session, tick, 100) == digests[tick - start : tick - start + 100], tick


@pytest.mark.slow
def test_with_every_controller_and_estimator_in_charge() -> None:
    session = Simulation(SimulationConfig(seed=5))
    for controller in session.pipeline.controller_names:
        session.select_controller(controller)
        for estimator in session.pipeline.estimator_names:
            session.select_estimator(estimator)
            run(session, 0, 25, events=False)
            moment = Moment(session)
            first = run(session, 25, 60, events=False)
            moment.restore()
            assert run(session, 25, 60, events=False) == first, (controller, estimator)


def test_what_was_shared_is_shared_again() -> None:
    session = Simulation(SimulationConfig(seed=1))
    run(session, 0, 30, events=False)
    moment = Moment(session)
    run(session, 30, 30)
    moment.restore()
    estimators = session.pipeline.estimators
    session.select_estimator("gmo_pi", 9.0, 40.0)
    assert estimators["gmo_cqp"].momentum.gains.k1 == 9.0  # pyright: ignore[reportAttributeAccessIssue]


class Mute:
    """Says nothing of what it carries."""


class Box:
    """Carries something mute."""

    STATE = ("content",)

    def __init__(self) -> None:
        self.content = Mute()


def test_what_says_nothing_is_named() -> None:
    with pytest.raises(StateError, match=r"Box carries Mute, which does not say what it carries; name that in its STATE"):
        Moment(Box())
