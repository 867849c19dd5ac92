"""The console as people run it, in processes of its own."""

import os
import subprocess
import sys
from pathlib import Path
from urllib.parse import urlsplit

ROOT = Path(__file__).resolve().parents[2]


class ConsoleProcess:
    """`python -m server`, from the announcement of its address on.

    Attributes:
        address: of the page, as printed.
        pid: of the web process.
    """

    def __init__(self, *arguments: str, port: int = 0, **environment: str) -> None:
        inherited = {name: value for name, value in os.environ.items() if name != "FORCELENS_TOKEN"}
        self._process = subprocess.Popen(
            [sys.executable, "-m", "server", "--no-browser", "--port", str(port), *arguments],
            cwd=ROOT,
            env=inherited | environment,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._process.stdout is not None
        line = next((line for line in self._process.stdout if line.startswith("Forcelens is at")), None)
        assert line is not None, f"the console ended with status {self._process.wait()}"
        self.address = line.split()[-1]
        self.pid = self._process.pid

    @property
    def port(self) -> int:
        """The page's port."""
        port = urlsplit(self.address).port
        assert port is not None
        return port

    def stop(self) -> None:
        """End it, and wait until it has ended."""
        self._process.terminate()
        self._process.communicate(timeout=20.0)
