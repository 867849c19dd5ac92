"""The REST interface, one module per group of calls."""

from server.routes import (
    command,
    hand_load,
    hardware,
    history,
    lease,
    recordings,
    replay,
    safety,
    selection,
    simulation,
    system,
    tasks,
    wrenches,
)

ROUTERS = (
    system.router,
    command.router,
    safety.router,
    lease.router,
    simulation.router,
    selection.router,
    hand_load.router,
    wrenches.router,
    tasks.router,
    history.router,
    recordings.router,
    replay.router,
    hardware.router,
)
