"""HEAD is answered wherever GET is: the same status and headers, and no body."""

import pytest

from tests.server.running_server import RunningServer


@pytest.mark.parametrize("path", ["/", "/docs", "/openapi.json", "/static/main.js", "/viser/", "/api/v1/command"])
def test_it_has_the_status_and_headers_of_get_and_no_body(server: RunningServer, path: str) -> None:
    head = server.http.head(path)
    server.http.cookies.clear()  # or it is known by the page's cookie from now on
    get = server.http.get(path)
    assert head.status_code == get.status_code == 200
    assert head.content == b"" != get.content
    for headers in (head.headers, get.headers):
        headers.pop("set-cookie", None)  # another one every time
    assert dict(head.headers) | {"date": ""} == dict(get.headers) | {"date": ""}


@pytest.mark.parametrize("path", ["state", "health", "scene", "controller", "estimator", "backend", "mismatch", "wrenches"])
def test_every_reading_call_answers_it(server: RunningServer, path: str) -> None:
    head = server.http.head(f"/api/v1/{path}")
    assert head.status_code == 200
    assert head.headers["content-type"] == "application/json"
    assert head.content == b""


@pytest.mark.parametrize(
    ("path", "host", "status"),
    [
        ("/api/v1/hardware", "localhost", 409),
        ("/api/v1/run", "localhost", 405),
        ("/nothing", "localhost", 404),
        ("/", "evil.example", 403),
    ],
)
def test_refusals_are_those_of_get(server: RunningServer, path: str, host: str, status: int) -> None:
    head = server.http.head(path, headers={"Host": host})
    assert head.status_code == status
    assert head.content == b""
