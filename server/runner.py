"""Starts and stops the parts in order: control process, then the web server beside it."""

import socket
from collections.abc import Callable

from server.config import ServerConfig
from server.control_client import ControlClient
from server.control_process import ControlLaunch
from server.control_spawner import ControlSpawner
from server.logs import configure
from server.operator import Operator


def serve(config: ServerConfig, listener: socket.socket, spawner: ControlSpawner, announce: Callable[[str], None]) -> None:
    """Run until interrupted.

    Args:
        config: settings.
        listener: listens at the address of the settings.
        spawner: of the control process.
        announce: told the page's address once it can be opened.

    Raises:
        ControlDeadError: the control process died while starting.
    """
    configure(config.log, "console")
    launch = ControlLaunch(session=config.session, log=config.log)
    client = ControlClient(launch, spawner)
    operator = Operator(client, launch, config.hardware, config.recordings)
    client.start()
    try:
        # Takes a second to import, in which the control process starts.
        from server.web_server import run_web_server

        run_web_server(config, listener, operator, announce)
    finally:
        operator.close()
