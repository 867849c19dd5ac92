"""WS /api/v1/stream: snapshots at the reader's rate, newest only.

A reader that is slower than its rate makes the socket refuse more, the sender waits, and the next thing it sends is the
newest snapshot of that moment: frames are skipped, none is queued. Readers of the same sections share one encoding.
"""

import asyncio
import time

from fastapi import APIRouter, WebSocket, WebSocketDisconnect

from server.control_client import ControlClient
from server.errors import InvalidFieldError
from server.responses import json_response
from server.silence import Silence, silence_of
from server.state import ALWAYS, SECTIONS, encode, state_json

RATE_RANGE_HZ = (1.0, 100.0)
DEFAULT_RATE_HZ = 30.0
REPEAT_AFTER_S = 0.5
"""An unchanged snapshot is sent again after this, so that a silent socket means a lost connection."""

Version = tuple[int, Silence]

router = APIRouter()


def parse_rate(text: str | None) -> float:
    """Rate in Hz.

    Raises:
        InvalidFieldError: not a number within RATE_RANGE_HZ.
    """
    lower, upper = RATE_RANGE_HZ
    allowed = f"{lower:g} to {upper:g} Hz"
    try:
        rate_hz = DEFAULT_RATE_HZ if text is None else float(text)
    except ValueError:
        raise InvalidFieldError("rate_hz", "must be a number", allowed) from None
    if not lower <= rate_hz <= upper:
        raise InvalidFieldError("rate_hz", "is outside the allowed range", allowed)
    return rate_hz


def parse_fields(text: str | None) -> tuple[str, ...]:
    """Sections of the state, in the order of SECTIONS, always with ALWAYS.

    Raises:
        InvalidFieldError: a name that is no section.
    """
    if text is None:
        return tuple(SECTIONS)
    asked = {name.strip() for name in text.split(",")}
    unknown = sorted(asked - set(SECTIONS))
    if unknown:
        raise InvalidFieldError("fields", f"has unknown {', '.join(map(repr, unknown))}", ", ".join(SECTIONS))
    return tuple(name for name in SECTIONS if name in asked or name in ALWAYS)


class SnapshotEncoder:
    """JSON text of the newest snapshot per set of sections, made once however many readers there are."""

    def __init__(self, client: ControlClient) -> None:
        self._client = client
        self._version: Version | None = None
        self._texts: dict[tuple[str, ...], str] = {}

    def newest(self, fields: tuple[str, ...]) -> tuple[Version, str] | None:
        """Version and text of the newest snapshot, None before the first. The version changes with the content."""
        record = self._client.snapshot()
        if record is None:
            return None
        silent = silence_of(self._client)
        version = (int(record["sequence"]), silent)
        if version != self._version:
            self._version = version
            self._texts.clear()
        text = self._texts.get(fields)
        if text is None:
            text = self._texts[fields] = encode(state_json(record, fields, silence=silent)).decode()
        return version, text


@router.websocket("/api/v1/stream")
async def stream(socket: WebSocket) -> None:
    """Send snapshots until the reader goes."""
    try:
        rate_hz = parse_rate(socket.query_params.get("rate_hz"))
        fields = parse_fields(socket.query_params.get("fields"))
    except InvalidFieldError as error:
        await socket.send_denial_response(json_response({"detail": [error.detail()]}, 422))
        return
    await socket.accept()
    sender = asyncio.create_task(_send(socket, socket.app.state.encoder, fields, 1.0 / rate_hz))
    try:
        with socket.app.state.clients.one("stream"):
            # Reading keeps pings answered and notices a reader that leaves.
            while (await socket.receive())["type"] != "websocket.disconnect":
                pass
    finally:
        sender.cancel()


async def _send(socket: WebSocket, encoder: SnapshotEncoder, fields: tuple[str, ...], period_s: float) -> None:
    sent = None
    sent_s = 0.0
    due = time.monotonic()
    try:
        while True:
            newest = encoder.newest(fields)
            if newest is not None and (newest[0] != sent or time.monotonic() - sent_s > REPEAT_AFTER_S):
                sent, sent_s = newest[0], time.monotonic()
                await socket.send_text(newest[1])
            due = max(due + period_s, time.monotonic())
            await asyncio.sleep(due - time.monotonic())
    except WebSocketDisconnect:
        return
