"""`forcelens`, or `python -m server`: start the console and print where it is."""

import argparse
import os
import sys
from typing import TextIO


def parser() -> argparse.ArgumentParser:
    """Arguments of the command."""
    arguments = argparse.ArgumentParser(prog="forcelens", description="Console of a robot that feels force without a sensor.")
    arguments.add_argument("--host", default="127.0.0.1", help="address to bind (default 127.0.0.1); others need a token")
    arguments.add_argument("--port", type=int, default=8080, help="TCP port (default 8080); 0 takes a free one")
    arguments.add_argument(
        "--token", default=os.environ.get("FORCELENS_TOKEN"), help="required of every request (default: FORCELENS_TOKEN)"
    )
    arguments.add_argument("--scene", default="free", help="scene to start in (default free)")
    arguments.add_argument("--controller", default="model_based", help="controller to start with (default model_based)")
    arguments.add_argument("--estimator", default="adaptive", help="force estimator to start with (default adaptive)")
    arguments.add_argument("--seed", type=int, default=0, help="of the sensors' errors (default 0)")
    arguments.add_argument("--no-browser", action="store_true", help="do not open the page")
    return arguments


def main() -> None:
    """Run the command; exit status 2 with one line on stderr when it cannot start."""
    arguments = parser().parse_args()
    # The spawned control process imports this module too and needs nothing below.
    from control.pipeline import PipelineConfig
    from server.config import ConfigError, ServerConfig
    from server.errors import ServerError
    from server.runner import PortInUseError, serve
    from sim.session import SessionConfig

    try:
        config = ServerConfig(
            host=arguments.host,
            port=arguments.port,
            token=arguments.token or None,
            open_browser=not arguments.no_browser,
            session=SessionConfig(
                scene=arguments.scene,
                seed=arguments.seed,
                pipeline=PipelineConfig(controller=arguments.controller, estimator=arguments.estimator),
            ),
        )
        serve(config, lambda address: _say(sys.stdout, f"Forcelens is at {address}"))
    except (ConfigError, PortInUseError, ServerError) as error:
        _say(sys.stderr, f"forcelens: {error}")
        sys.exit(2)
    except KeyboardInterrupt:
        _say(sys.stdout, "Forcelens has stopped")


def _say(stream: TextIO, text: str) -> None:
    stream.write(text + "\n")
    stream.flush()


if __name__ == "__main__":
    main()
