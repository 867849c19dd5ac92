"""Why a call is refused. REST answers with `status`; the page shows the message, which says what to do."""

from typing import ClassVar


class ServerError(RuntimeError):
    """A call that was refused for a reason that its caller can act on."""

    status: ClassVar[int] = 500


class InvalidFieldError(ServerError, ValueError):
    """A value that is not allowed.

    Attributes:
        field: path of the field, like `force_n[2]`.
        allowed: range or choice in words. The problem reads on after the field: "is outside the allowed range".
    """

    status = 422

    def __init__(self, field: str, problem: str, allowed: str) -> None:
        super().__init__(f"{field} {problem}; allowed: {allowed}")
        self.field = field
        self.allowed = allowed

    def detail(self) -> dict[str, str]:
        """The entry of a 422's `detail` list."""
        return {"field": self.field, "msg": str(self), "allowed": self.allowed}


class RefusedError(ServerError):
    """The state forbids the call."""

    status = 409


class MissingError(ServerError):
    """The thing named in the path does not exist."""

    status = 404


class ControlDeadError(ServerError):
    """No control process runs."""

    status = 503


class ControlTimeoutError(ServerError, TimeoutError):
    """The control process runs but did not answer in time."""

    status = 503
