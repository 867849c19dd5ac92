"""The REST interface, one module per group of calls."""

from server.routes import command, hardware, lease, safety, selection, simulation, system, wrenches

ROUTERS = (
    system.router,
    command.router,
    safety.router,
    lease.router,
    simulation.router,
    selection.router,
    wrenches.router,
    hardware.router,
)
