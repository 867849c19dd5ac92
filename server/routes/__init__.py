"""The REST interface, one module per group of calls."""

from server.routes import command, hardware, history, recordings, replay, safety, selection, simulation, system, wrenches

ROUTERS = (
    system.router,
    command.router,
    safety.router,
    simulation.router,
    selection.router,
    wrenches.router,
    history.router,
    recordings.router,
    replay.router,
    hardware.router,
)
