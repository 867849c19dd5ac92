"""Logs for people and for machines, and options from the environment."""

import json
import logging
import sys
from collections.abc import Iterator

import pytest

from server.audit import Audit
from server.command_line import parser
from server.logs import JsonLines, LogConfig, configure


@pytest.fixture
def root() -> Iterator[logging.Logger]:
    root = logging.getLogger()
    before = root.handlers[:], root.level
    yield root
    root.handlers[:], root.level = before[0], before[1]


def test_a_line_of_json_holds_who_and_what_and_the_traceback(root: logging.Logger, capsys: pytest.CaptureFixture[str]) -> None:
    configure(LogConfig("info", as_json=True), "console")
    Audit().note("Ada", "reset", {"seed": 7}, refusal="no")
    try:
        raise ValueError("ü")
    except ValueError:
        logging.getLogger("forcelens.test").exception("it\nfailed")
    logging.getLogger("forcelens.test").debug("not told")
    command, failure = map(json.loads, capsys.readouterr().err.splitlines())
    assert command["operator"] == "Ada" and command["call"] == "reset" and command["level"] == "warning"
    assert command["message"] == "Ada: reset seed=7 refused: no"
    assert failure["message"] == "it\nfailed" and "ValueError: ü" in failure["traceback"]
    assert failure["process"] == "console" and failure["time"].endswith("+00:00")
    assert isinstance(root.handlers[0].formatter, JsonLines)


def test_people_read_lines(root: logging.Logger, capsys: pytest.CaptureFixture[str]) -> None:
    configure(LogConfig("warning"), "console")
    Audit().note("Ada", "reset", {})
    logging.getLogger("forcelens.test").warning("late")
    assert capsys.readouterr().err == "console: WARNING: late\n"


def test_every_option_may_come_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    options = [action for action in parser()._actions if action.dest not in ("help", "token", "token_file")]
    given = {"FORCELENS_PORT": "9000", "FORCELENS_NO_BROWSER": "1", "FORCELENS_ARM_HOST": "10.0.0.2", "FORCELENS_SCENE": ""}
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    assert {f"FORCELENS_{action.dest.upper()}" for action in options} >= set(given)
    assert all(f"[FORCELENS_{action.dest.upper()}]" in str(action.help) for action in options)
    parsed = parser().parse_args(["--seed", "3"])
    assert (parsed.port, parsed.no_browser, parsed.arm_host, parsed.scene, parsed.seed) == (9000, True, "10.0.0.2", "free", 3)
    assert parser().parse_args(["--port", "9001"]).port == 9001, "the command line has the last word"


@pytest.mark.parametrize(
    ("name", "value"), [("PORT", "tcp://10.0.0.1:80"), ("LOG_LEVEL", "loud"), ("ALLOW_ROBOT", "maybe"), ("DOMAIN", "231")]
)
def test_what_cannot_be_is_refused_with_its_name(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str, value: str
) -> None:
    monkeypatch.setenv(f"FORCELENS_{name}", value)
    monkeypatch.setattr(sys, "argv", ["forcelens"])
    with pytest.raises(SystemExit):
        parser().parse_args([])
    assert value in capsys.readouterr().err
