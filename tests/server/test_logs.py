"""Logs for people and for machines, and options from the environment."""

import json
import logging
import pickle
import sys
from collections.abc import Iterator

import pytest

from server.audit import Audit
from server.command_line import parser
from server.logs import REPEATED_S, JsonLines, LogConfig, Repetitions, configure


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


def warning(message: str, created: float, level: int = logging.WARNING, error: Exception | None = None) -> logging.LogRecord:
    fields = {"name": "stranger", "msg": message, "levelno": level, "created": created}
    return logging.makeLogRecord(fields | {"exc_info": None if error is None else (type(error), error, None)})


def test_a_warning_that_comes_again_and_again_is_told_once_with_their_number() -> None:
    repetitions = Repetitions()
    assert repetitions.filter(warning("invalid", 100.0))
    assert not any(repetitions.filter(warning("invalid", 100.0 + 0.001 * moment)) for moment in range(5000))
    again = warning("invalid", 100.0 + REPEATED_S)
    assert repetitions.filter(again)
    assert again.getMessage() == "invalid (and 5000 more since the last such line)"
    once_more = warning("invalid", 100.0 + 2.0 * REPEATED_S)
    assert repetitions.filter(once_more) and once_more.getMessage() == "invalid"


def test_what_differs_or_is_no_warning_is_told_at_once() -> None:
    repetitions = Repetitions()
    assert all(repetitions.filter(warning(message, 1.0)) for message in ("one", "two"))
    assert all(repetitions.filter(warning("who did what", 1.0, logging.INFO)) for _ in range(9))
    assert all(repetitions.filter(warning("failed", 1.0, error=ValueError(why))) for why in ("this", "that"))
    assert not repetitions.filter(warning("failed", 1.0, error=ValueError("that")))
    refused = warning("Ada: reset refused", 1.0)
    refused.operator = "Ada"
    assert repetitions.filter(refused) and repetitions.filter(refused)


def test_many_different_warnings_take_no_more_and_more_memory() -> None:
    repetitions = Repetitions()
    assert all(repetitions.filter(warning(f"number {count}", 1.0)) for count in range(5000))
    assert len(pickle.dumps(vars(repetitions))) < 100_000


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
