"""The REST interface, one module per group of calls."""

from server.routes import command, hand_load, hardware, lease, safety, selection, simulation, system, tasks, wrenches

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
    hardware.router,
)
