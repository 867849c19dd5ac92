"""`forcelens record`: has a running console record, until Ctrl-C or for a time, and fetches the file."""

import argparse
import json
import os
import signal
import sys
import threading
import urllib.error
import urllib.request
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sim.arguments import TCP_PORT

TIMEOUT_S = 30.0


class ConsoleError(RuntimeError):
    """The console refused, or does not answer; the message says what to do."""


def parser() -> argparse.ArgumentParser:
    """Arguments of the command."""
    arguments = argparse.ArgumentParser(
        prog="forcelens record", description="Have a running console record, until Ctrl-C or for a time."
    )
    arguments.add_argument("--host", default="127.0.0.1", help="where the console is (default 127.0.0.1)")
    arguments.add_argument("--port", type=TCP_PORT, default=8080, help="its TCP port (default 8080)")
    arguments.add_argument("--name", default="", help="of the recording")
    arguments.add_argument("--note", default="", help="kept in the recording")
    arguments.add_argument("--seconds", type=float, help="how long, by the clock on the wall (default: until Ctrl-C)")
    arguments.add_argument("--output", type=Path, help="file to fetch it to (default: it stays in the console's data folder)")
    arguments.add_argument("--token-file", type=Path, help="file with the console's token; default: FORCELENS_TOKEN")
    return arguments


def record(words: Sequence[str]) -> int:
    """Run the command; returns the exit status, 2 with one line on stderr when the console refuses."""
    options = parser().parse_args(words)
    token = options.token_file.read_text().strip() if options.token_file else os.environ.get("FORCELENS_TOKEN")
    root = f"http://{options.host}:{options.port}/api/v1/recordings"
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    try:
        row = _call(root, "POST", token, {"name": options.name, "note": options.note})
        sys.stderr.write(f"recording {row['id']}; Ctrl-C ends it\n")
        ended.wait(options.seconds)
        row = _call(f"{root}/current", "DELETE", token)
        if options.output is not None:
            _fetch(f"{root}/{row['id']}/download", token, options.output)
    except ConsoleError as error:
        sys.stderr.write(f"forcelens record: {error}\n")
        return 2
    sys.stdout.write(json.dumps(row) + "\n")
    return 0


def _request(url: str, method: str, token: str | None, body: Any = None) -> Any:
    headers = {"Content-Type": "application/json"} | ({"Authorization": f"Bearer {token}"} if token else {})
    data = None if body is None else json.dumps(body).encode()
    try:
        return urllib.request.urlopen(urllib.request.Request(url, data, headers, method=method), timeout=TIMEOUT_S)
    except urllib.error.HTTPError as error:
        raise ConsoleError(_detail(error)) from None
    except OSError as error:
        raise ConsoleError(f"no console answers at {url}: {error}; start one with `forcelens`, or name its --port") from None


def _detail(error: urllib.error.HTTPError) -> str:
    try:
        return str(json.load(error)["detail"])
    except (ValueError, KeyError):
        return f"the console answered {error.code}"


def _call(url: str, method: str, token: str | None, body: Any = None) -> dict[str, Any]:
    with _request(url, method, token, body) as answer:
        return json.load(answer)


def _fetch(url: str, token: str | None, path: Path) -> None:
    with _request(url, "GET", token) as answer, path.open("wb") as file:
        while block := answer.read(2**20):
            file.write(block)
