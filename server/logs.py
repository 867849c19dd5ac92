"""Logs of the console's processes on standard error, as lines for people or as JSON for machines.

A warning that comes again and again is told once in REPEATED_S, with their number: bytes from strangers make one each, and
strangers shall not fill a disk.
"""

import json
import logging
import math
from dataclasses import dataclass
from datetime import UTC, datetime

LEVELS = ("debug", "info", "warning", "error")

REPEATED_S = 10.0
_MOST_KNOWN = 256
"""Different warnings, of which the oldest are forgotten."""


@dataclass(frozen=True, slots=True)
class LogConfig:
    """What is logged: from which of LEVELS on, and whether as JSON."""

    level: str = "info"
    as_json: bool = False


class JsonLines(logging.Formatter):
    """One JSON object per record: time (UTC), level, process, logger, message, of a command operator and call, traceback.

    Args:
        process: name of this process.
    """

    def __init__(self, process: str) -> None:
        super().__init__()
        self._process = process

    def format(self, record: logging.LogRecord) -> str:
        """The line."""
        line = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "process": self._process,
            "logger": record.name,
            "message": record.getMessage(),
        }
        line |= {name: getattr(record, name) for name in ("operator", "call") if hasattr(record, name)}
        if record.exc_info:
            line["traceback"] = self.formatException(record.exc_info)
        return json.dumps(line, ensure_ascii=False)


class Repetitions(logging.Filter):
    """Passes a warning or error that equals an earlier one, exception included, once in REPEATED_S. Whatever an operator did
    passes at once.
    """

    def __init__(self) -> None:
        super().__init__()
        self._held_back: dict[tuple[str, str, str], tuple[float, int]] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether to log it now; says how many were not since the last one."""
        if record.levelno < logging.WARNING or hasattr(record, "operator"):
            return True
        message = record.getMessage()
        known = (record.name, message, repr(record.exc_info[1]) if record.exc_info else "")
        logged_s, count = self._held_back.pop(known, (-math.inf, 0))
        repeated = record.created - logged_s < REPEATED_S
        self._held_back[known] = (logged_s, count + 1) if repeated else (record.created, 0)
        if len(self._held_back) > _MOST_KNOWN:
            del self._held_back[next(iter(self._held_back))]
        if count and not repeated:
            record.msg, record.args = f"{message} (and {count} more since the last such line)", ()
        return not repeated


def configure(config: LogConfig, process: str) -> None:
    """Log like that from this process, whose name leads every line."""
    handler = logging.StreamHandler()
    handler.addFilter(Repetitions())
    handler.setFormatter(JsonLines(process) if config.as_json else logging.Formatter(f"{process}: %(levelname)s: %(message)s"))
    logging.basicConfig(level=config.level.upper(), handlers=[handler], force=True)
