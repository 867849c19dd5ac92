"""What travels through the pipe between the web process and the control process: edge events and their replies."""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any


class Outcome(StrEnum):
    """How an event ended; everything but DONE carries a message instead of a value."""

    DONE = "done"
    INVALID = "invalid"
    REFUSED = "refused"
    MISSING = "missing"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class Event:
    """Something that must happen exactly once: web process -> control process."""

    id: int
    name: str
    arguments: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Reply:
    """What came of an event: control process -> web process."""

    id: int
    outcome: Outcome
    value: Any = None


@dataclass(frozen=True, slots=True)
class Ready:
    """The control process has its session and starts to tick. `description` is what can be selected."""

    description: dict[str, Any]


@dataclass(frozen=True, slots=True)
class Fatal:
    """The control process ends because of an error that it cannot handle."""

    message: str


class Close:
    """End the control process: web process -> control process."""
