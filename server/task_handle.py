"""Tasks of the control process, for REST and for the page."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from server.control_client import ControlClient
from server.errors import InvalidFieldError
from server.fields import in_words
from server.leadership import Leadership, needs_lease
from sim.tasks import TASKS, options_of

if TYPE_CHECKING:
    from server.answers.tasks import TaskAnswer, TaskKind


class TaskHandle:
    """Begins, watches and aborts tasks.

    Args:
        client: handle on the control process.
        leadership: who may.
        sequence: number of the newest command of the operator; one with another number takes over.
    """

    def __init__(self, client: ControlClient, leadership: Leadership, sequence: Callable[[], int]) -> None:
        self.leadership = leadership
        self._client = client
        self._sequence = sequence

    def kinds(self) -> "list[TaskKind]":
        """The tasks that there are."""
        return [
            {
                "name": name,
                "scene": kind.SCENE,
                "description": kind.DESCRIPTION,
                "options": {
                    key: {"default": o.default, "minimum": o.minimum, "maximum": o.maximum, "unit": o.unit}
                    for key, o in options_of(name).items()
                },
            }
            for name, kind in TASKS.items()
        ]

    @needs_lease
    def start(self, name: str, options: Mapping[str, float]) -> int:
        """Begin a task; its id.

        Raises:
            InvalidFieldError: no such task or option, or a value out of its range.
            RefusedError: wrong scene, out of reach, another task at work, e-stop latched.
        """
        if name not in TASKS:
            raise InvalidFieldError("name", f"{name!r} does not exist", ", ".join(TASKS))
        known = options_of(name)
        for key, value in options.items():
            if key not in known:
                raise InvalidFieldError(f"options.{key}", "is unknown", ", ".join(known))
            limits = known[key].minimum, known[key].maximum
            if not limits[0] <= value <= limits[1]:
                raise InvalidFieldError(f"options.{key}", "is outside the allowed range", in_words(limits, known[key].unit))
        return self._client.call("start_task", name=name, options=dict(options), sequence=self._sequence())

    def get(self, key: int | None = None) -> "TaskAnswer":
        """A task, by default the one begun last.

        Raises:
            MissingError: there is none.
        """
        return self._client.call("get_task", key=key)

    @needs_lease
    def abort(self, key: int | None = None) -> "TaskAnswer":
        """Abort the task at work.

        Raises:
            MissingError: it is not at work.
        """
        return self._client.call("abort_task", key=key)
