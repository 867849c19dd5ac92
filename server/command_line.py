"""The console's command line."""

import argparse
import os
import socket
import sys
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from server.logs import LEVELS, LogConfig
from sim.arguments import ARM_PORT, DDS_DOMAIN, TCP_PORT, from_environment
from sim.processes.starting import Starting

if TYPE_CHECKING:
    from server.control_spawner import ControlSpawner


def parser() -> argparse.ArgumentParser:
    """Arguments of the command."""
    arguments = argparse.ArgumentParser(
        prog="forcelens",
        description="Console of a robot that feels force without a sensor.",
        epilog="forcelens emulate --help: an emulated robot for the hardware backend; record --help: record a running "
        "console. In brackets: the variable that sets a default.",
    )
    arguments.add_argument("--host", default="127.0.0.1", help="address to bind (default 127.0.0.1); others need a token")
    arguments.add_argument("--port", type=TCP_PORT, default=8080, help="TCP port, 0 to 65535 (default 8080); 0: a free one")
    token = arguments.add_mutually_exclusive_group()
    file = "file with the token that every request needs; default: FORCELENS_TOKEN, or the file of FORCELENS_TOKEN_FILE"
    token.add_argument("--token-file", type=Path, help=file)
    token.add_argument("--token", help="the token itself; every user of this machine can read it here (ps)")
    arguments.add_argument("--scene", default="free", help="scene to start in (default free)")
    arguments.add_argument("--controller", default="policy", help="controller to start with (default policy)")
    arguments.add_argument("--estimator", default="hybrid", help="force estimator to start with (default hybrid)")
    arguments.add_argument("--seed", type=int, default=0, help="of the sensors' errors (default 0)")
    arguments.add_argument(
        "--data", type=Path, help="data folder, for recordings; default: FORCELENS_DATA, or where XDG puts it"
    )
    arguments.add_argument(
        "--data-budget", type=float, default=20.0, metavar="GB", help="most that recordings take (default 20)"
    )
    arguments.add_argument("--no-browser", action="store_true", help="do not open the page")
    arguments.add_argument("--log-level", choices=LEVELS, default="info", help="from which on it is logged (default info)")
    arguments.add_argument("--log-json", action="store_true", help="log one JSON object per line")
    robot = arguments.add_argument_group("robot", "what the hardware backend drives once it is chosen in the page or by REST")
    robot.add_argument("--domain", type=DDS_DOMAIN, default=1, help="DDS domain of the base (default 1; a real robot's is 0)")
    robot.add_argument("--interface", default="lo", help="network interface that leads to the base (default lo)")
    robot.add_argument("--arm-host", default="127.0.0.1", help="address of the arm's z1_ctrl (default 127.0.0.1)")
    robot.add_argument(
        "--arm-port", type=ARM_PORT, default=8071, help="UDP port of z1_ctrl, 1 to 65534; it answers on the next"
    )
    robot.add_argument("--allow-robot", action="store_true", help="permit domain 0, another interface than lo, a remote arm")
    from_environment(arguments, "FORCELENS", os.environ, skip=("token", "token_file"))
    return arguments


def run(words: Sequence[str], starting: Starting) -> int:
    """Run the command; returns the exit status, 2 with one line on stderr when it cannot start."""
    arguments = parser().parse_args(words)
    from server.listening import PortInUseError, listen

    try:
        with listen(arguments.host, arguments.port) as listener:
            # What takes long to import is not needed to print a help text.
            _compile(listener)
            from server.control_spawner import ControlSpawner

            with closing(ControlSpawner()) as spawner:
                spawner.spawn_ahead()
                return _serve(arguments, listener, spawner, starting)
    except PortInUseError as error:
        return _refuse(error)


def _serve(arguments: argparse.Namespace, listener: socket.socket, spawner: "ControlSpawner", starting: Starting) -> int:
    _load_no_machine_code()
    from control.pipeline import PipelineConfig
    from server.backend_choice import with_options
    from server.config import ConfigError, ServerConfig
    from server.errors import ServerError
    from server.runner import serve
    from sim.backends.hardware.config import HardwareConfig
    from sim.recording.folder import RecordingFolder, default_folder
    from sim.runtime.simulation import SimulationConfig

    def announce(address: str) -> None:
        starting.over()
        _say(sys.stdout, f"Forcelens is at {address}")

    try:
        config = ServerConfig(
            host=arguments.host,
            port=arguments.port,
            token=_token(arguments),
            open_browser=not arguments.no_browser,
            session=SimulationConfig(
                scene=arguments.scene,
                seed=arguments.seed,
                pipeline=PipelineConfig(controller=arguments.controller, estimator=arguments.estimator),
            ),
            log=LogConfig(arguments.log_level, arguments.log_json),
            recordings=RecordingFolder(
                default_folder() if arguments.data is None else arguments.data / "recordings",
                round(1e9 * arguments.data_budget),
            ),
            hardware=with_options(
                HardwareConfig(),
                {name: getattr(arguments, name) for name in ("domain", "interface", "arm_host", "arm_port", "allow_robot")},
            ),
        )
        serve(config, listener, spawner, announce)
    except (ConfigError, ServerError) as error:
        return _refuse(error)
    except KeyboardInterrupt:
        _say(sys.stdout, "Forcelens has stopped")
    return 0


def _token(arguments: argparse.Namespace) -> str | None:
    from server.config import token_of_file

    if arguments.token_file is not None:
        return token_of_file(arguments.token_file)
    # An empty variable is one that is not set; an empty argument is a mistake that would leave the door open.
    if arguments.token is not None:
        return arguments.token
    file = os.environ.get("FORCELENS_TOKEN_FILE")
    return os.environ.get("FORCELENS_TOKEN") or (token_of_file(Path(file)) if file else None)


def _compile(listener: socket.socket) -> None:
    """Compile what nobody has compiled yet; the terminal and whoever opens the page are told how far it is."""
    from server.compile_all import compile_all
    from server.waiting_page import WaitingPage, progress_text

    with WaitingPage(listener) as page:

        def tell(done: int, count: int, _module: str) -> None:
            page.tell(done, count)
            _say(sys.stderr, progress_text(done, count))

        compile_all(tell)


def _load_no_machine_code() -> None:
    """Run the few kernels that serving needs as plain Python: loading all takes seconds. The control process has its own."""
    from numba.core import config

    config.DISABLE_JIT = 1


def _refuse(error: Exception) -> int:
    _say(sys.stderr, f"forcelens: {error}")
    return 2


def _say(stream: TextIO, text: str) -> None:
    stream.write(text + "\n")
    stream.flush()
