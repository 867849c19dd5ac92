"""The web application: REST, stream, the page, and Viser behind the same port."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from anyio import to_thread
from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import FileResponse, HTMLResponse
from fastapi.staticfiles import StaticFiles

from server import stream, viser_relay
from server.access import AccessControl
from server.admission import Admission
from server.body_limit import BodyLimit
from server.build_info import build_info
from server.caller import CallerContext, caller_of, new_page_cookie
from server.clients import Clients
from server.credentials import Credentials
from server.docs_page import docs_page
from server.errors import InvalidFieldError, ServerError
from server.event_channel import MAX_PENDING
from server.head import HeadAsGet
from server.metrics import CONTENT_TYPE, Metrics
from server.operator import Operator
from server.responses import ANY_CALL, json_response
from server.routes import ROUTERS
from server.security_headers import SecurityHeaders
from server.validation import invalid_fields
from web.viser_door import ViserDoor
from web.viser_page import STATIC

HEARTBEAT_PERIOD_S = 0.05
SPARE_THREADS = 40
"""Beside those of calls that all wait for a control process that hangs."""


def create_app(operator: Operator, *, scene: ViserDoor, credentials: Credentials | None = None) -> FastAPI:
    """The application around one operator.

    Args:
        operator: acts on a control process that is already started.
        scene: the way to the 3-D scene's server.
        credentials: what every request must prove itself by, None for nothing.
    """
    build = build_info()
    app = FastAPI(
        title="Forcelens",
        version=build.version,
        docs_url=None,
        redoc_url=None,
        lifespan=_lifespan,
        responses=ANY_CALL,
        generate_unique_id_function=lambda route: route.name,
    )
    app.state.build = build
    app.state.operator = operator
    app.state.encoder = stream.SnapshotEncoder(operator.client)
    app.state.scene = scene
    app.state.clients = clients = Clients()
    metrics = Metrics(operator, clients, build)
    app.add_exception_handler(RequestValidationError, _invalid_request)
    app.add_exception_handler(ServerError, _refused)
    app.add_exception_handler(Exception, _failed)
    for router in ROUTERS:
        app.include_router(router)
    app.include_router(stream.router)
    app.include_router(viser_relay.router)
    app.add_api_route("/", _page, include_in_schema=False)
    app.add_api_route("/docs", lambda: HTMLResponse(docs_page(app.openapi())), include_in_schema=False)
    app.add_api_route("/metrics", lambda: Response(metrics.text(), media_type=CONTENT_TYPE), include_in_schema=False)
    app.mount("/static", StaticFiles(directory=STATIC), name="static")
    app.add_middleware(BodyLimit)
    app.add_middleware(CallerContext)
    app.add_middleware(Admission)
    app.add_middleware(AccessControl, credentials=credentials)
    app.add_middleware(SecurityHeaders)
    app.add_middleware(HeadAsGet)
    return app


def _page(request: Request) -> Response:
    response = FileResponse(STATIC / "index.html", headers={"Cache-Control": "no-cache"})
    if caller_of(request.scope).page is None:
        response.headers.append("Set-Cookie", new_page_cookie(request.headers.get("host", "")))
    return response


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    to_thread.current_default_thread_limiter().total_tokens = MAX_PENDING + SPARE_THREADS
    heart = asyncio.create_task(_beat(app.state.operator))
    try:
        yield
    finally:
        heart.cancel()


async def _beat(operator: Operator) -> None:
    """Proof to the control process that this event loop, which an e-stop needs, still turns."""
    while True:
        operator.heartbeat()
        await asyncio.sleep(HEARTBEAT_PERIOD_S)


async def _invalid_request(_: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    return json_response({"detail": [invalid.detail() for invalid in invalid_fields(error.errors())]}, 422)


async def _refused(_: Request, error: Exception) -> Response:
    assert isinstance(error, ServerError)
    if isinstance(error, InvalidFieldError):
        return json_response({"detail": [error.detail()]}, 422)
    return json_response({"detail": str(error)}, error.status)


async def _failed(_: Request, error: Exception) -> Response:
    """After this answer the error goes on to the log, with its traceback."""
    return json_response({"detail": f"a defect in this call ({type(error).__name__}); the console's log tells more"}, 500)
