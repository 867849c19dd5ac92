"""An emulated robot in a process of its own, for scripts and tests: start it, order it about, ask what it does."""

import json
import socket
import subprocess
import sys
from typing import Any


class EmulatorProcess:
    """`python -m sim.emulator` on loopback, with a free port for the arm unless one is given; ends with `close`.

    Args:
        domain: DDS domain.
        arm_port: UDP port on which the emulated z1_ctrl listens; it answers on the next.
        options: further arguments of the command.
    """

    def __init__(self, domain: int, arm_port: int | None = None, *options: str) -> None:
        self.domain = domain
        self.arm_port = free_udp_port() if arm_port is None else arm_port
        command = [sys.executable, "-m", "sim.emulator", "--domain", str(domain), "--arm-port", str(self.arm_port), *options]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    @property
    def arguments(self) -> list[str]:
        """What leads a console to this robot."""
        return ["--domain", str(self.domain), "--arm-port", str(self.arm_port)]

    def order(self, **order: Any) -> None:
        """Send one order of sim.emulator.orders."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(order) + "\n")
        self._process.stdin.flush()

    def report(self) -> dict[str, Any]:
        """What the robot does; see sim.emulator.orders.report."""
        self.order(report=True)
        assert self._process.stdout is not None
        return json.loads(self._process.stdout.readline())

    def close(self) -> None:
        """End it."""
        self._process.kill()
        self._process.communicate()


def free_udp_port() -> int:
    """A port that, with the next, nobody uses now."""
    while True:
        with _udp_socket() as first, _udp_socket() as second:
            first.bind(("127.0.0.1", 0))
            port = first.getsockname()[1]
            try:
                second.bind(("127.0.0.1", port + 1))
            except OSError:
                continue
            return port


def _udp_socket() -> socket.socket:
    return socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
