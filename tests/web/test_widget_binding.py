"""A widget and the control process agree, whoever changed the value."""

import asyncio
import threading
from collections.abc import Callable, Coroutine
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from web import widget_binding
from web.widget_binding import EDIT_GRACE_S, Binding, Worker


class Client:
    """Counts what it is told."""

    def __init__(self) -> None:
        self.notices: list[str] = []

    def add_notification(self, title: str, body: str, **_: Any) -> None:
        self.notices.append(body)


@dataclass
class Event:
    client: Client | None
    target: Any


@dataclass
class Widget:
    """What Binding needs of a Viser input: assignments fire callbacks without a client."""

    shown: Any
    callbacks: list[Callable[[Event], Coroutine[Any, Any, None]]] = field(default_factory=list)

    @property
    def value(self) -> Any:
        return self.shown

    @value.setter
    def value(self, value: Any) -> None:
        self.shown = value
        self._fire(None)

    def on_update(self, callback: Callable[[Event], Coroutine[Any, Any, None]]) -> None:
        self.callbacks.append(callback)

    def edit(self, value: Any, client: Client) -> None:
        """What Viser does when a browser changes the widget."""
        self.shown = value
        self._fire(client)

    def _fire(self, client: Client | None) -> None:
        for callback in self.callbacks:
            asyncio.run(callback(Event(client, self)))


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [100.0]
    monkeypatch.setattr(widget_binding.time, "monotonic", lambda: now[0])
    return now


@pytest.fixture
def sent() -> list[Any]:
    return []


def speed_binding(widget: Widget, send: Callable[[Any], object], worker: Worker | None = None) -> Binding:
    return Binding(widget, lambda snapshot: float(snapshot["speed"]), send, worker)


def test_an_edit_is_sent_and_survives_until_the_snapshot_agrees(clock: list[float], sent: list, snapshot: np.void) -> None:
    widget = Widget(1.0)
    binding = speed_binding(widget, sent.append)
    widget.edit(2.0, Client())
    binding.sync(snapshot)
    assert (sent, widget.value) == ([2.0], 2.0)
    clock[0] += EDIT_GRACE_S + 0.01
    snapshot["speed"] = 2.0
    binding.sync(snapshot)
    assert (sent, widget.value) == ([2.0], 2.0)


def test_an_edit_that_is_stored_but_not_yet_sent_is_not_undone(clock: list[float], sent: list, snapshot: np.void) -> None:
    widget = Widget(1.0)
    binding = speed_binding(widget, sent.append)
    binding.sync(snapshot)
    widget.shown = 2.0  # Viser has stored it and calls back next
    binding.sync(snapshot)
    assert widget.value == 2.0
    clock[0] += EDIT_GRACE_S + 0.01  # its browser is gone: nobody calls back
    binding.sync(snapshot)
    assert widget.value == 1.0


def test_a_change_from_elsewhere_shows_and_is_not_sent_back(clock: list[float], sent: list, snapshot: np.void) -> None:
    widget = Widget(1.0)
    binding = speed_binding(widget, sent.append)
    snapshot["speed"] = 0.5
    binding.sync(snapshot)
    assert (sent, widget.value) == ([], 0.5)


def test_a_refused_edit_is_explained_and_taken_back(clock: list[float], snapshot: np.void) -> None:
    def refuse(_: float) -> None:
        raise RuntimeError("the e-stop is latched; clear it first")

    widget, client = Widget(1.0), Client()
    binding = speed_binding(widget, refuse)
    widget.edit(3.0, client)
    assert client.notices == ["the e-stop is latched; clear it first"]
    clock[0] += EDIT_GRACE_S + 0.01
    binding.sync(snapshot)
    assert widget.value == 1.0


def test_a_value_that_is_not_available_leaves_the_widget_alone(clock: list[float], sent: list, snapshot: np.void) -> None:
    widget = Widget(1.0)
    snapshot["speed"] = np.nan
    speed_binding(widget, sent.append).sync(snapshot)
    assert widget.value == 1.0


def test_the_snapshot_waits_for_a_slow_edit_however_long_it_takes(clock: list[float], snapshot: np.void) -> None:
    started, release, done = threading.Event(), threading.Event(), threading.Event()

    def send(_: float) -> None:
        started.set()
        release.wait(5.0)

    worker, widget = Worker(), Widget(1.0)
    binding = speed_binding(widget, send, worker)
    widget.edit(2.0, Client())
    assert started.wait(5.0)
    clock[0] += 60.0
    binding.sync(snapshot)
    assert widget.value == 2.0
    release.set()
    worker.submit("after", done.set)
    assert done.wait(5.0)
    clock[0] += EDIT_GRACE_S + 0.01
    binding.sync(snapshot)
    assert widget.value == 1.0


def test_a_worker_acts_in_the_name_of_whoever_asked() -> None:
    asker: ContextVar[str] = ContextVar("asker", default="nobody")
    worker, seen, done = Worker(), [], threading.Event()
    for name in ("Ada", "Grace"):
        asker.set(name)
        worker.submit(name, lambda: seen.append(asker.get()))
    worker.submit("last", done.set)
    assert done.wait(10.0)
    assert seen == ["Ada", "Grace"]


def test_a_worker_runs_only_the_newest_action_of_a_key() -> None:
    worker, order, busy, release, done = Worker(), [], threading.Event(), threading.Event(), threading.Event()

    def block() -> None:
        busy.set()
        release.wait(5.0)

    worker.submit("block", block)
    assert busy.wait(5.0)
    for value in range(5):
        worker.submit("slider", lambda value=value: order.append(value))
    worker.submit("end", done.set)
    release.set()
    assert done.wait(5.0)
    assert order == [4]
