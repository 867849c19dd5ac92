"""The lease: at most one operator commands, and the rest watch. While nobody holds it, anyone's commands are accepted.

It belongs to a token, which scripts show in a header, and to the browser that took it, if one did, so that the scene's widgets
act as well. Whatever its holder asks for renews it; who falls silent loses it.
"""

import hmac
import secrets
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from server.caller import Caller
from server.errors import RefusedError

LIFE_S = 4.0
"""Who is not heard for so long has lost the lease. Pages and `server.client` renew it every second."""


@dataclass(frozen=True, slots=True)
class Holder:
    """Who commands: name, secrets, and until when (monotonic s) it holds without a further word."""

    operator: str
    token: str
    page: str | None
    until_s: float

    def is_caller(self, caller: Caller) -> bool:
        """Whether the caller shows one of the secrets."""
        pairs = ((self.token, caller.token), (self.page, caller.page))
        return any(a is not None and b is not None and hmac.compare_digest(a.encode(), b.encode()) for a, b in pairs)


class Lease:
    """Any thread may call.

    Args:
        clock: monotonic time in s.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._holder: Holder | None = None
        self._lapsed: str | None = None

    def take(self, operator: str, caller: Caller, *, take_over: bool) -> tuple[Holder, str | None]:
        """Give the lease to a caller, or renew its own; the holder, and the name of the operator who lost it by this.

        Raises:
            RefusedError: another holds it, and `take_over` is not set.
        """
        with self._lock:
            before = self._current()
            ours = before is not None and before.is_caller(caller)
            if before is not None and not ours and not take_over:
                raise RefusedError(_held(before))
            token = before.token if before is not None and ours else secrets.token_urlsafe(24)
            page = caller.page or (before.page if before is not None and ours else None)
            self._holder = Holder(operator, token, page, self._clock() + LIFE_S)
            return self._holder, before.operator if before is not None and not ours else None

    def release(self, caller: Caller) -> bool:
        """Give it back; whether the caller held it.

        Raises:
            RefusedError: another holds it.
        """
        with self._lock:
            before = self._current()
            if before is not None and not before.is_caller(caller):
                raise RefusedError(_held(before))
            self._holder = None
            return before is not None

    def require(self, caller: Caller) -> None:
        """Renew the lease of its holder.

        Raises:
            RefusedError: another holds it.
        """
        with self._lock:
            holder = self._current()
            if holder is None:
                return
            if not holder.is_caller(caller):
                raise RefusedError(_held(holder))
            self._holder = replace(holder, until_s=self._clock() + LIFE_S)

    def seen_by(self, caller: Caller) -> tuple[str | None, bool, float | None]:
        """Name of the operator who holds it, whether that is the caller, and the time in s for which it holds unrenewed."""
        with self._lock:
            holder = self._current()
            if holder is None:
                return None, False, None
            return holder.operator, holder.is_caller(caller), holder.until_s - self._clock()

    def lapsed(self) -> str | None:
        """Name of an operator who fell silent and has lost the lease; told once."""
        with self._lock:
            self._current()
            lapsed, self._lapsed = self._lapsed, None
            return lapsed

    def _current(self) -> Holder | None:
        holder = self._holder
        if holder is not None and holder.until_s <= self._clock():
            self._holder, self._lapsed = None, holder.operator
        return self._holder


def _held(holder: Holder) -> str:
    return f"{holder.operator} drives and you watch; take over in the page, or by POST /api/v1/lease with take_over: true"
