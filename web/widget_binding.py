"""Two-way link between a widget and one value of the snapshot, so that the page, REST and every other browser agree."""

import threading
import time
from collections.abc import Callable
from contextvars import copy_context
from typing import Any

import numpy as np
import viser

from web.sink import notify

EDIT_GRACE_S = 0.6
"""An edit needs a moment to come back in the snapshot; until then the snapshot must not undo it."""


def attempt(action: Callable[[], object], client: viser.ClientHandle | None) -> None:
    """Do what a client asked for; tell it when that is refused."""
    try:
        action()
    except (ValueError, RuntimeError) as refusal:
        notify(client, str(refusal))


def text(field: str) -> Callable[[np.void], str]:
    """Reader of a text field of a SNAPSHOT record."""
    return lambda snapshot: snapshot[field].decode()


class Worker:
    """Runs actions that wait for the control process, off Viser's event loop. Of one key only the newest is kept."""

    def __init__(self) -> None:
        self._wake = threading.Condition()
        self._actions: dict[object, Callable[[], None]] = {}
        threading.Thread(target=self._run, name="console-worker", daemon=True).start()

    def submit(self, key: object, action: Callable[[], None]) -> None:
        """Run `action` soon, in the order in which keys were first submitted."""
        context = copy_context()  # whoever asks for it
        with self._wake:
            self._actions[key] = lambda: context.run(action)
            self._wake.notify()

    def _run(self) -> None:
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._actions)
                action = self._actions.pop(next(iter(self._actions)))
            action()


class Binding:
    """Sends what an operator enters, and shows what the control process reports."""

    def __init__(
        self,
        widget: Any,
        read: Callable[[np.void], Any],
        send: Callable[[Any], object],
        worker: Worker | None = None,
    ) -> None:
        """
        Args:
            widget: a Viser input with `value` and `on_update`.
            read: the value of a SNAPSHOT record, in the widget's type; NaN where there is none.
            send: acts on a value that an operator entered; may refuse with a ValueError or RuntimeError.
            worker: where `send` runs if it waits for an answer; otherwise on Viser's event loop.
        """
        self.widget = widget
        self._read = read
        self._send = send
        self._hold_until_s = 0.0
        self._known = widget.value

        # `async` without awaits: Viser keeps the order of those callbacks only.
        @widget.on_update
        async def _(event: viser.GuiEvent) -> None:
            # Our own assignments in `sync` also fire updates; those carry no client.
            if event.client is None:
                return
            value, client = event.target.value, event.client
            self._known = value
            if worker is None:
                self._act(value, client)
            else:
                self._hold_until_s = np.inf
                worker.submit(self, lambda: self._act(value, client))

    def _act(self, value: Any, client: viser.ClientHandle) -> None:
        try:
            attempt(lambda: self._send(value), client)
        finally:
            self._hold_until_s = time.monotonic() + EDIT_GRACE_S

    def sync(self, snapshot: np.void) -> None:
        """Show the value of a SNAPSHOT record, unless it was edited a moment ago."""
        if time.monotonic() < self._hold_until_s:
            return
        value = self._read(snapshot)
        shown = self.widget.value
        if shown != self._known:
            # Viser stores an edit before it calls back: showing the snapshot now would undo what is not yet sent.
            self._known = shown
            self._hold_until_s = max(self._hold_until_s, time.monotonic() + EDIT_GRACE_S)
            return
        if isinstance(value, float):
            if not np.isfinite(value) or abs(value - shown) < 1e-9:
                return
        elif value == shown:
            return
        self.widget.value = self._known = value
