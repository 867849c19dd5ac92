"""`python -m tests.server.record_examples`: records the examples of the documentation from real answers.

Needs the extra `hardware`, for an emulated robot, and an idle machine, or the loop's figures are poor. Of several answers with
one schema the last one counts.
"""

import json
import os
import signal
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, get_args

import httpx

from control.files import write_whole
from server import answers
from server.app import create_app
from server.credentials import Credentials
from server.docs_page import pretty
from sim.backends.z1.driver import Z1Config
from sim.emulator.process import EmulatorProcess
from tests.server.contract import API, ask, route_of, schema_of
from tests.server.running_server import RunningServer, running_server
from tests.server.tour import tour
from web.viser_door import ViserDoor

TARGET = Path(answers.__file__).with_name("examples.json")
DOMAIN = 1
SETTLED_S = 30.0
"""The live errors of the estimators have forgotten the start."""


def robot(http: httpx.Client) -> Iterator[httpx.Response]:
    """What only a robot answers."""
    with closing(EmulatorProcess(DOMAIN, Z1Config().command_port)) as emulator:
        options = {"domain": DOMAIN, "arm_port": emulator.arm_port, "dry_run": False}
        yield http.put(f"{API}backend", json={"name": "hardware", "options": options})
        while (status := http.get(f"{API}hardware")).json()["warnings"]:
            time.sleep(0.05)
        yield status
        http.put(f"{API}backend", json={"name": "simulation"}).raise_for_status()


def refused(server: RunningServer) -> Iterator[httpx.Response]:
    """What goes wrong outside of any call: no token, no control process."""
    guarded = create_app(server.operator, scene=ViserDoor(), credentials=Credentials("a token that is not sent"))
    yield ask(guarded, "GET", f"{API}state")
    assert server.operator.client.pid is not None
    os.kill(server.operator.client.pid, signal.SIGKILL)
    server.wait_for(lambda state: state["mode"] == "fault")
    yield server.http.patch(f"{API}command", json={"guidance": True})


def _is_json(response: httpx.Response) -> bool:
    return response.headers.get("content-type", "").startswith("application/json")


def example(response: httpx.Response) -> tuple[str, Any]:
    """Name and value of an example: of a list its first entry."""
    value = json.loads(response.text, parse_float=lambda text: round(float(text), 4))
    if not response.is_success:
        return str(response.status_code), value
    schema = schema_of(response)
    return (get_args(schema)[0].__name__, value[0]) if isinstance(value, list) else (schema.__name__, value)


def main() -> None:
    """Write the examples beside the schemas."""
    with running_server() as server:
        while server.state()["time_s"] < SETTLED_S:
            time.sleep(0.1)
        responses = [*tour(server.http), *robot(server.http), *refused(server)]
    examples = dict(example(response) for response in responses if _is_json(response) and route_of(response) is not None)
    write_whole(TARGET, pretty(dict(sorted(examples.items()))) + "\n")


if __name__ == "__main__":
    main()
