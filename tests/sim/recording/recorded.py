"""Makes recordings in one process: the session, the tap and the recorder's writer, without anything between them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from sim.recording import tap as tap_module
from sim.recording.body_tree import BodyTree
from sim.recording.describe import describe_session, standing_attachments
from sim.recording.description import Description
from sim.recording.recorder import Drain, RecordingWriter
from sim.recording.tap import Tap
from sim.runtime.simulation import Simulation
from sim.runtime.snapshot import SNAPSHOT
from tests.sim.runtime.test_state_capture import setpoint

START_NS = 1_790_000_000_000_000_000


def record(
    session: Simulation,
    path: Path,
    ticks: int,
    deeds: dict[int, tuple[str, dict[str, Any]]] | None = None,
    between: Callable[[int], None] = lambda _: None,
) -> list[np.void]:
    """Record `ticks` of a session; `deeds` are done before those ticks. The snapshots of every tenth tick."""
    tap = Tap(tap_module.allocate())
    described = describe_session(session)
    tap.start("test")
    metadata = {**described.metadata, "name": "test", "note": "", "started": "2026-11-28T23:15:00.000Z"}
    description = Description(metadata, described.estimators, (*standing_attachments(), *described.attachments))
    writer = RecordingWriter(path, description, BodyTree.from_mjcf(), START_NS)
    drain = Drain(tap, writer, 0, 0)
    resets = session.pipeline_resets
    snapshots = []
    for tick in range(ticks):
        if deeds and tick in deeds:
            name, arguments = deeds[tick]
            getattr(session, name)(**arguments)
            if name != "reset":
                tap.put_event(name, arguments)
        session.tick_setpoint(setpoint(tick), 0.0)
        if session.pipeline_resets != resets:
            resets = session.pipeline_resets
            tap.put_event("reset", {})
        tap.put_tick(session)
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
