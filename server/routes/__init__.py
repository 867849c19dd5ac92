"""The REST interface, one module per group of calls."""

from server.routes import command, hardware, safety, selection, simulation, system, tasks, wrenches

ROUTERS = (
    system.router,
    command.router,
    safety.router,
    simulation.router,
    selection.router,
    wrenches.router,
    tasks.router,
    hardware.router,
)
