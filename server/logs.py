"""Logs of the console's processes on standard error, as lines for people or as JSON for machines."""

import json
import logging
from dataclasses import dataclass
from datetime import UTC, datetime

LEVELS = ("debug", "info", "warning", "error")


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


def configure(config: LogConfig, process: str) -> None:
    """Log like that from this process, whose name leads every line."""
    handler = logging.StreamHandler()
    handler.setFormatter(JsonLines(process) if config.as_json else logging.Formatter(f"{process}: %(levelname)s: %(message)s"))
    logging.basicConfig(level=config.level.upper(), handlers=[handler], force=True)
