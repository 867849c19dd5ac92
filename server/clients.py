"""How many read the stream, and how many browsers show the scene."""

import contextlib
from collections import Counter
from collections.abc import Iterator


class Clients:
    """Counts open sockets by kind; on one event loop."""

    def __init__(self) -> None:
        self._open = Counter({"stream": 0, "scene": 0})

    @contextlib.contextmanager
    def one(self, kind: str) -> Iterator[None]:
        """Count one more while the context lasts."""
        self._open[kind] += 1
        try:
            yield
        finally:
            self._open[kind] -= 1

    def counts(self) -> dict[str, int]:
        """Open sockets by kind."""
        return dict(self._open)
