"""Makes recordings in one process: the session, the tap and the recorder's writer, without anything between them."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sim.recording import tap as tap_module
from sim.recording.body_tree import BodyTree
from sim.recording.describe import describe_session
from sim.recording.keyframes import EVERY_TICKS, Keyframes
from sim.recording.recorder import Drain, RecordingWriter
from sim.recording.tap import Heads, Tap
from sim.runtime.history import History
from sim.runtime.simulation import Simulation
from sim.runtime.snapshot import SNAPSHOT
from sim.runtime.tick_row import TickRow
from tests.sim.runtime.test_state_capture import setpoint

START_NS = 1_790_000_000_000_000_000


def record(
    session: Simulation,
    path: Path,
    ticks: int,
    deeds: dict[int, tuple[str, dict[str, Any]]] | None = None,
    between: Callable[[int], None] = lambda _: None,
    keyframes_every: int = EVERY_TICKS,
    asked: Callable[[int], np.void] = setpoint,
) -> list[np.void]:
    """Record `ticks` of a session; `deeds` are done before those ticks, in which `asked` is the set-point. The snapshots of
    every tenth tick.
    """
    tap, history, row = Tap(tap_module.allocate()), History(session), TickRow()
    keyframes = Keyframes(tap, lambda: history.newest, keyframes_every)
    described = describe_session(session)
    tap.start("test")
    metadata = {**described.metadata, "name": "test", "note": "", "started": "2026-11-28T23:15:00.000Z"}
    writer = RecordingWriter(path, replace(described, metadata=metadata), BodyTree.from_mjcf(), START_NS)
    drain = Drain(tap, writer, Heads())
    own = dict(session.own_deeds)
    snapshots = []
    for tick in range(ticks):
        if deeds and tick in deeds:
            name, arguments = deeds[tick]
            getattr(session, name)(**arguments)
            if name == "reset":
                history.clear()
            else:
                tap.put_event(name, arguments)
        session.tick_setpoint(asked(tick), 0.0)
        history.ticked(asked(tick), 0.0)
        for name in (name for name in own if session.own_deeds[name] != own[name]):
            tap.put_event(name, {})
        own = dict(session.own_deeds)
        tap.put_tick(row.write(session))
        keyframes.ticked(session.pipeline)
        if tick % 10 == 9:
            snapshot = np.zeros(1, SNAPSHOT)[0]
            session.fill(snapshot)
            tap.put_moment(snapshot)
            snapshots.append(snapshot)
        between(tick)
        drain.turn(least=250)
    while drain.turn(least=1):
        pass
    writer.close()
    return snapshots
