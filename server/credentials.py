"""What proves that somebody may use a console: its token, the cookie of a page that has shown it, or a ticket."""

import hmac
import secrets
import time
from collections.abc import Iterable

TICKET_LIFE_S = 60.0


def token_bytes(token: str) -> bytes:
    """The bytes of a token, of which a command line and the environment may hold any."""
    return token.encode(errors="surrogateescape")


class Credentials:
    """Compares in constant time.

    The cookie is derived from the token. Its name differs from that of a console with another token, because a browser sends
    a host's cookies to all of its ports. It outlives a restart, so that pages come back by themselves. It does not tell the
    token to whatever else serves on that host.

    Attributes:
        cookie_name: of the cookie that a page gets.
        cookie_value: what proves that it got it from here.

    Args:
        token: what the operator was given.
    """

    def __init__(self, token: str) -> None:
        self._token = token_bytes(token)
        self.cookie_name = f"forcelens_{self._derived('cookie name')[:16]}"
        self.cookie_value = self._derived("cookie value")
        self._tickets: dict[str, float] = {}

    def _derived(self, purpose: str) -> str:
        return hmac.digest(self._token, purpose.encode(), "sha256").hex()

    def is_token(self, given: bytes) -> bool:
        """Whether this is the token."""
        return hmac.compare_digest(given, self._token)

    def in_cookies(self, headers: Iterable[str]) -> bool:
        """Whether any of these Cookie headers holds our cookie, beside what others on this host may have put there."""
        pairs = [pair.strip().partition("=") for header in headers for pair in header.split(";")]
        ours = [value for name, _, value in pairs if name == self.cookie_name]
        return any(hmac.compare_digest(value.encode(), self.cookie_value.encode()) for value in ours)

    def issue_ticket(self) -> str:
        """What opens the page once and soon: for a browser's command line, which every user of this machine can read."""
        ticket = secrets.token_urlsafe(24)
        self._tickets[ticket] = time.monotonic() + TICKET_LIFE_S
        return ticket

    def redeem(self, given: bytes) -> bool:
        """Whether this is a ticket that still holds. It is used up now."""
        for ticket, end_s in self._tickets.items():
            if hmac.compare_digest(given, ticket.encode()):
                del self._tickets[ticket]
                return time.monotonic() < end_s
        return False
