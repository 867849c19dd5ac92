"""REST answers against the schemas that OpenAPI publishes."""

import asyncio
import json
from functools import cache
from typing import Any

import httpx
from fastapi import FastAPI
from fastapi.routing import APIRoute
from pydantic import TypeAdapter

from server.answers.refusals import RefusalAnswer
from server.responses import ANY_CALL
from server.routes import ROUTERS

API = "/api/v1/"


def all_routes() -> list[APIRoute]:
    """Every call of REST."""
    return [route for router in ROUTERS for route in router.routes if isinstance(route, APIRoute)]


def route_of(response: httpx.Response) -> APIRoute | None:
    """The call that answered; None where no call has that method and path."""
    request = response.request
    matching = (route for route in all_routes() if route.path_regex.match(request.url.path))
    return next((route for route in matching if request.method in (route.methods or ())), None)


def schema_of(response: httpx.Response) -> Any:
    """Schema of an answer, None for no content.

    Raises:
        AssertionError: the call does not tell that it may answer with this status.
    """
    route = route_of(response)
    if route is None:
        return RefusalAnswer
    if response.status_code == (route.status_code or 200):
        return route.response_model
    told = ANY_CALL | route.responses
    assert response.status_code in told, f"{route.name} does not tell of {response.status_code}: {response.text}"
    return told[response.status_code]["model"]


def check_answer(response: httpx.Response) -> None:
    """Raises where an answer of the API does not fit its schema to the letter."""
    if not response.request.url.path.startswith(API) or response.request.method == "HEAD":
        return
    if response.headers.get("content-type") == "application/octet-stream":
        return
    response.read()
    schema = schema_of(response)
    if schema is None:
        assert response.content == b""
    else:
        check_fit(schema, response.text)


def check_fit(schema: Any, text: str) -> None:
    """Raises where a key is unknown or missing, a type is wrong, or the text is no JSON, as NaN is not."""

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is no JSON")

    json.loads(text, parse_constant=refuse)
    _adapter(schema).validate_json(text, strict=True, extra="forbid")


@cache
def _adapter(schema: Any) -> TypeAdapter[Any]:
    return TypeAdapter(schema)


def ask(app: FastAPI, method: str, path: str, **options: Any) -> httpx.Response:
    """The answer of an application that nothing serves."""

    async def exchange() -> httpx.Response:
        transport = httpx.ASGITransport(app, raise_app_exceptions=False)
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as http:
            return await http.request(method, path, **options)

    return asyncio.run(exchange())
