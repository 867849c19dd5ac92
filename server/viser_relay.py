"""Viser behind our own port: its page at `/viser/`, and its websocket relayed to the server behind `web.viser_door`.

Viser's client derives the socket's address from the page's, so the page at `/viser/` connects to `/viser`.
"""

import asyncio
import contextlib
import gzip
import logging
from functools import cache

from fastapi import APIRouter, Request, Response, WebSocket

from web.viser_door import DoorClosedError, ViserDoor, Visitor
from web.viser_page import viser_page

PUBLIC_TUNNEL = b"ShareUrlRequest"
"""Type of the message by which any Viser client may have the server publish itself on the Internet."""

router = APIRouter()

_log = logging.getLogger(__name__)


@cache
def _compressed_page() -> bytes:
    return gzip.compress(viser_page(), compresslevel=6)


@router.get("/viser/", include_in_schema=False)
def page(request: Request) -> Response:
    """Viser's client. Not cached for long: it must match the installed server's version."""
    headers = {"Cache-Control": "no-cache", "Vary": "Accept-Encoding"}
    if "gzip" in request.headers.get("accept-encoding", ""):
        return Response(_compressed_page(), media_type="text/html", headers={**headers, "Content-Encoding": "gzip"})
    return Response(viser_page(), media_type="text/html", headers=headers)


@router.websocket("/viser")
async def relay(socket: WebSocket) -> None:
    """Copy messages both ways until either side ends. Waiting for a slow browser stops reading, so Viser culls."""
    door: ViserDoor = socket.app.state.scene
    try:
        async with door.connect(socket.scope.get("subprotocols", [])) as scene:
            await socket.accept(subprotocol=scene.subprotocol)
            with socket.app.state.clients.one("scene"):
                await _copy(socket, scene)
    except DoorClosedError as error:
        _log.warning("the 3-D scene does not answer: %s", error)
        await socket.close(1011)


async def _copy(socket: WebSocket, scene: Visitor) -> None:
    copies = [asyncio.create_task(_to_viser(socket, scene)), asyncio.create_task(_to_browser(scene, socket))]
    _, running = await asyncio.wait(copies, return_when=asyncio.FIRST_COMPLETED)
    for task in running:
        task.cancel()
    await asyncio.gather(*copies, return_exceptions=True)


async def _to_viser(socket: WebSocket, scene: Visitor) -> None:
    while (message := await socket.receive())["type"] != "websocket.disconnect":
        data = message.get("bytes")
        if data is not None and PUBLIC_TUNNEL in data:
            _log.warning("a browser asked Viser for a public tunnel to this robot; refused")
            continue
        try:
            await scene.send(message["text"] if data is None else data)
        except DoorClosedError:
            return


async def _to_browser(scene: Visitor, socket: WebSocket) -> None:
    with contextlib.suppress(DoorClosedError):
        while True:
            message = await scene.receive()
            if isinstance(message, str):
                await socket.send_text(message)
            else:
                await socket.send_bytes(message)
    await socket.close()
