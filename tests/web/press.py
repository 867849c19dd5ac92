"""What a browser does to widgets."""

import asyncio
from types import SimpleNamespace
from typing import Any

import viser

CLIENT = SimpleNamespace(client_id=0, add_notification=lambda *_, **__: None)


def press(button: viser.GuiButtonHandle, client: Any = CLIENT) -> None:
    """Click a button."""
    _fire(button, client)


def edit(widget: Any, value: Any, client: Any = CLIENT) -> None:
    """Enter a value."""
    widget._impl.value = value
    _fire(widget, client)


def _fire(widget: Any, client: Any) -> None:
    for callback in list(widget._impl.update_cb):
        asyncio.run(callback(SimpleNamespace(client=client, client_id=client.client_id, target=widget)))
