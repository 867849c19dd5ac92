"""Who commands whom: the lease as callers see it, and a line in the audit log for whatever they ask for."""

import functools
import inspect
from collections.abc import Callable, Mapping
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar

from server.audit import Audit
from server.caller import CALLER
from server.lease import Lease


class Leadership:
    """Any thread may call; the caller is the one of its context.

    Args:
        stop: called where an operator loses the lease: what it had set in motion stands still.
    """

    def __init__(self, stop: Callable[[], None]) -> None:
        self._stop = stop
        self._lease = Lease()
        self._audit = Audit()

    def settle(self) -> None:
        """Notice who has fallen silent; call it often."""
        lapsed = self._lease.lapsed()
        if lapsed is not None:
            self._stop()
            self._audit.note(lapsed, "lost the lease", {})
        self._audit.settle()

    def seen(self) -> tuple[str | None, bool, float | None]:
        """The lease as the caller sees it; see Lease.seen_by."""
        return self._lease.seen_by(CALLER.get())

    def require(self) -> None:
        """
        Raises:
            RefusedError: another holds the lease; the message names it.
        """
        self._lease.require(CALLER.get())

    def take(self, operator: str, *, take_over: bool) -> str:
        """Give the lease to the caller; its token.

        Raises:
            RefusedError: another holds it, and `take_over` is not set.
        """
        known = self.seen()[:2] == (operator, True)
        holder, loser = self._lease.take(operator, CALLER.get(), take_over=take_over)
        if loser is not None:
            self._stop()
        if not known:
            who = f"{operator} ({CALLER.get().words})"
            self._audit.note(who, "take_lease", {} if loser is None else {"over_from": loser})
        return holder.token

    def release(self) -> None:
        """Give the caller's lease back.

        Raises:
            RefusedError: another holds it.
        """
        operator = self.seen()[0]
        if self._lease.release(CALLER.get()):
            self._stop()
            self._audit.note(str(operator), "release_lease", {})

    def note(self, call: str, asked: Mapping[str, Any], refusal: str = "") -> None:
        """A line in the audit log, in the caller's name."""
        operator, yours, _ = self.seen()
        words = CALLER.get().words
        self._audit.note(f"{operator} ({words})" if yours else words, call, asked, refusal)


class _Led(Protocol):
    leadership: Leadership


Self = TypeVar("Self", bound=_Led)
Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def needs_lease(method: Callable[Concatenate[Self, Arguments], Result]) -> Callable[Concatenate[Self, Arguments], Result]:
    """Decorator of a command: only for the holder of the lease, if anyone holds it, and with a line in the audit log."""
    call = method.__name__.lstrip("_")
    names = list(inspect.signature(method).parameters)[1:]

    @functools.wraps(method)
    def as_holder(self: Self, /, *args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        asked = dict(zip(names, args, strict=False)) | kwargs
        try:
            self.leadership.require()
            result = method(self, *args, **kwargs)
        except (ValueError, RuntimeError) as error:
            self.leadership.note(call, asked, str(error))
            raise
        self.leadership.note(call, asked)
        return result

    return as_holder
