"""A console in a process of its own, as people run it."""

import os
import subprocess
import sys
from urllib.parse import urlsplit

from control.paths import ROOT
from tests.processes import children, command_line

CLOSING_S = 20.0


class ConsoleProcess:
    """`python -m server` on a free port, without a browser; ends with `close`.

    Args:
        arguments: further arguments of the command.
        port: 0 takes a free one.
        environment: variables beside the inherited ones.
    """

    def __init__(self, *arguments: str, port: int = 0, **environment: str) -> None:
        inherited = {name: value for name, value in os.environ.items() if name != "FORCELENS_TOKEN"}
        self.process = subprocess.Popen(
            [sys.executable, "-m", "server", "--no-browser", "--port", str(port), *arguments],
            cwd=ROOT,
            env=inherited | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"} | environment,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        lines = (line for line in self.process.stdout if line.startswith("Forcelens is at"))
        address = next(lines, None)
        assert address is not None, f"the console ended with status {self.process.wait()}"
        self.address = address.split()[-1].rstrip("/")

    @property
    def port(self) -> int:
        """Port of the page."""
        port = urlsplit(self.address).port
        assert port is not None
        return port

    def control_pid(self) -> int:
        """Process id of the control process, the console's spawned child."""
        spawned = [child.pid for child in children(self.process.pid) if "spawn_main" in command_line(child)]
        assert len(spawned) == 1
        return spawned[0]

    def close(self) -> None:
        """End it, by force if it does not end itself."""
        self.process.terminate()
        try:
            self.process.communicate(timeout=CLOSING_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.communicate()
