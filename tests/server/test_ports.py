"""No door but the one: every port that the console's processes listen on, attacked without the secret."""

import sys
from collections.abc import Iterator

import httpx
import msgspec
import pytest
import websockets.sync.client
from viser import __version__ as viser_version
from websockets.exceptions import InvalidHandshake, InvalidMessage

from sim.backends.unitree.dds import dds_unavailable_because
from sim.emulator.process import EmulatorProcess
from tests.console_process import ConsoleProcess
from tests.dds_domain import dds_domain
from tests.processes import tree
from tests.server.listening import Port, tcp_ports, unix_paths

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc")

TOKEN = "a-secret-of-the-operator"
FOREIGN = "http://evil.example"
SCENE_PROTOCOL = websockets.Subprotocol(f"viser-v{viser_version}")
HARDWARE = dds_unavailable_because() is None
PATHS = [
    "/",
    "/viser",
    "/viser/",
    "/index.html",
    "/docs",
    "/openapi.json",
    "/static/main.js",
    "/api/v1/state",
    "/api/v1/stream",
]
CHANGES = [("POST", "/api/v1/estop"), ("PATCH", "/api/v1/command"), ("POST", "/api/v1/hardware"), ("PUT", "/api/v1/scene")]


@pytest.fixture(scope="module")
def robot() -> Iterator[EmulatorProcess]:
    with dds_domain() as domain:
        robot = EmulatorProcess(domain)
        yield robot
        robot.close()


@pytest.fixture(scope="module")
def console(request: pytest.FixtureRequest) -> Iterator[ConsoleProcess]:
    arguments = request.getfixturevalue("robot").arguments if HARDWARE else []
    console = ConsoleProcess(*arguments, FORCELENS_TOKEN=TOKEN)
    yield console
    console.close()


@pytest.fixture(scope="module", params=["simulation", pytest.param("hardware", marks=pytest.mark.hardware)])
def ports(request: pytest.FixtureRequest, console: ConsoleProcess) -> set[Port]:
    """Ports of web and control process, and with hardware of the I/O process too."""
    api = f"http://127.0.0.1:{console.port}/api/v1"
    before = tree(console.process.pid)
    answer = httpx.put(f"{api}/backend", json={"name": request.param}, headers=bearer(TOKEN), timeout=60.0)
    assert answer.is_success, answer.text
    processes = tree(console.process.pid)
    assert len(processes) >= 2 + (request.param == "hardware"), processes
    if request.param == "hardware":
        assert processes - before, "the I/O process"
    return tcp_ports(processes)


def bearer(token: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {token}"}


def test_they_listen_on_the_announced_port_only(console: ConsoleProcess, ports: set[Port]) -> None:
    assert ports == {Port("127.0.0.1", console.port)}
    assert unix_paths(tree(console.process.pid)) == set()


def url(scheme: str, port: Port, path: str) -> str:
    host = f"[{port.host}]" if ":" in port.host else port.host
    return f"{scheme}://{host}:{port.number}{path}"


@pytest.mark.parametrize("headers", [{}, {"Origin": FOREIGN}, {"Cookie": "forcelens_token=guess"}])
def test_without_the_secret_no_port_answers_a_request(ports: set[Port], headers: dict[str, str]) -> None:
    for port in ports:
        for method, path in [("GET", path) for path in PATHS] + CHANGES:
            refused(port, method, path, headers)


def test_nor_with_a_guess(ports: set[Port]) -> None:
    for port in ports:
        refused(port, "GET", "/?token=guess-guess", {})
        refused(port, "POST", "/api/v1/estop", bearer("guess-guess"))


def refused(port: Port, method: str, path: str, headers: dict[str, str]) -> None:
    answer = httpx.request(method, url("http", port, path), headers=headers, timeout=30.0)
    assert answer.status_code in (401, 403), (port, method, path)
    assert set(answer.json()) == {"detail"}


@pytest.mark.parametrize("origin", [None, FOREIGN])
def test_without_the_secret_no_port_opens_a_websocket(ports: set[Port], origin: str | None) -> None:
    headers = {} if origin is None else {"Origin": origin}
    for port in ports:
        for path in PATHS:
            with pytest.raises((InvalidHandshake, InvalidMessage)):
                websockets.sync.client.connect(
                    url("ws", port, path), subprotocols=[SCENE_PROTOCOL], additional_headers=headers, proxy=None
                )


def test_with_the_secret_the_scene_comes(console: ConsoleProcess) -> None:
    """Or else the refusals above would prove nothing."""
    with websockets.sync.client.connect(
        f"ws://127.0.0.1:{console.port}/viser",
        subprotocols=[SCENE_PROTOCOL],
        additional_headers=bearer(TOKEN),
        max_size=None,
        compression=None,
        proxy=None,
    ) as scene:
        scene.send(msgspec.msgpack.encode({"type": "GuiUpdateMessage", "uuid": "none", "updates": {}}))
        assert scene.subprotocol == SCENE_PROTOCOL
        assert len(scene.recv(30.0)) > 1000
