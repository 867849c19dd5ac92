"""Origin, host and token rules, on the middleware alone."""

import json
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import server.access
from server.access import same_origin
from server.config import ConfigError, ServerConfig
from server.credentials import Credentials
from tests.server.asgi_request import HOST, ask, guarded, send

PAGE = f"http://{HOST}"
TOKEN = "correct horse; battery"
COOKIE = Credentials(TOKEN).cookie_name


@pytest.mark.parametrize(
    ("method", "origin", "status"),
    [
        ("POST", None, 200),
        ("POST", PAGE, 200),
        ("POST", "http://127.0.0.1:8081", 403),
        ("POST", "https://evil.example", 403),
        ("POST", "null", 403),
        ("POST", "http://127.0.0.1.evil.example:8080", 403),
        ("PUT", "http://evil.example:8080", 403),
        ("GET", "https://evil.example", 200),
    ],
)
def test_changes_are_for_our_own_page(method: str, origin: str | None, status: int) -> None:
    headers = {} if origin is None else {"Origin": origin}
    assert ask(method, headers).status == status


@pytest.mark.parametrize("method", ["POST", "PATCH"])
def test_behind_a_proxy_that_rewrites_the_host_the_refusal_tells_cause_and_cure(method: str) -> None:
    refused = ask(method, {"Origin": "https://robot.example"}, host=HOST)
    assert refused.status == 403
    detail = json.loads(refused.body)["detail"]
    assert "https://robot.example" in detail and HOST in detail
    manual = (Path(server.access.__file__).parent / "README.md").read_text()
    for line in ("proxy_set_header Host $http_host;", "proxy_http_version 1.1; proxy_set_header Upgrade $http_upgrade;"):
        assert line in detail and line in manual


@pytest.mark.parametrize("host", ["localhost:1234", "127.0.0.1", "[::1]:8080"])
def test_loopback_names_are_served(host: str) -> None:
    assert ask(host=host).status == 200


@pytest.mark.parametrize("host", ["evil.example:8080", "", "127.0.0.1.evil.example"])
def test_a_rebound_name_is_refused_even_with_a_matching_origin(host: str) -> None:
    refused = ask("POST", {"Origin": f"http://{host}"}, host=host)
    assert refused.status == 403
    assert "--token" in refused.body


@pytest.mark.parametrize("origin", ["https://evil.example", "null"])
def test_sockets_check_the_origin(origin: str) -> None:
    assert ask("SOCKET", {"Origin": origin}).status == 403


@pytest.mark.parametrize("headers", [{}, {"Origin": PAGE}])
def test_sockets_of_scripts_and_of_our_page_open(headers: dict[str, str]) -> None:
    assert ask("SOCKET", headers).status == 101


@pytest.mark.parametrize(
    ("headers", "params", "status"),
    [
        ({}, {}, 401),
        ({"Authorization": "Bearer wrong"}, {}, 401),
        ({"Authorization": f"Basic {TOKEN}"}, {}, 401),
        ({}, {"token": "wrong"}, 401),
        ({"Cookie": f"{COOKIE}=wrong"}, {}, 401),
        ({"Authorization": f"Bearer {TOKEN}"}, {}, 200),
        ({}, {"token": TOKEN}, 200),
    ],
)
def test_a_token_is_required_of_every_request(headers: dict[str, str], params: dict[str, str], status: int) -> None:
    assert ask("GET", headers, query=params, token=TOKEN, host="robot.local:8080").status == status
    assert ask("SOCKET", headers, query=params, token=TOKEN).status == (101 if status == 200 else status)


def test_any_call_with_the_token_leaves_a_cookie_that_opens_sockets() -> None:
    cookie = ask(query={"token": TOKEN}, token=TOKEN).headers["set-cookie"]
    pair, *attributes = cookie.split("; ")
    assert {"HttpOnly", "SameSite=Strict", "Path=/"} <= set(attributes)
    assert ask("SOCKET", {"Cookie": pair}, token=TOKEN).status == 101
    assert ask("SOCKET", token=TOKEN).status == 401


def test_a_token_does_not_open_the_door_to_foreign_pages() -> None:
    headers = {"Authorization": f"Bearer {TOKEN}", "Origin": "https://evil.example"}
    assert ask("POST", headers, token=TOKEN).status == 403


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.5", "::", "robot.local"])
def test_other_addresses_than_loopback_need_a_token(host: str) -> None:
    with pytest.raises(ConfigError, match="FORCELENS_TOKEN"):
        ServerConfig(host=host)
    assert ServerConfig(host=host, token=TOKEN).host == host


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.5", "::1", "localhost"])
def test_loopback_needs_none(host: str) -> None:
    assert ServerConfig(host=host).token is None


def test_a_token_that_can_be_guessed_is_refused() -> None:
    with pytest.raises(ConfigError, match="too short"):
        ServerConfig(token="1234")


ODD_URLS = [
    b"http://[",
    b"http://]",
    b"//[::1",
    b"http://[::1]x:1",
    b"http://\xe2\x84\xa8",
    b"[",
    b"\x00",
    b"null",
    b"http://a@b:c",
]
odd_bytes = st.binary(max_size=40) | st.sampled_from(ODD_URLS)
cookie_bytes = st.builds(lambda name, value: name + b"=" + value, st.sampled_from([COOKIE.encode(), b"a[b]", b""]), odd_bytes)
authorization_bytes = st.builds(lambda scheme, rest: scheme + b" " + rest, st.sampled_from([b"Bearer", b"Basic"]), odd_bytes)
header = st.one_of(
    st.tuples(st.sampled_from([b"host", b"origin", b"cookie", b"authorization", b"accept"]), odd_bytes),
    st.tuples(st.just(b"cookie"), cookie_bytes),
    st.tuples(st.just(b"authorization"), authorization_bytes),
    st.tuples(st.just(b"accept"), st.just(b"text/html")),
    st.tuples(st.just(b"host"), st.just(HOST.encode())),
)
headers = st.lists(header, max_size=5)
query_bytes = st.binary(max_size=40) | st.builds(lambda value: b"token=" + value, odd_bytes)


@settings(max_examples=300, deadline=None)
@given(
    method=st.sampled_from(["GET", "POST", "SOCKET"]),
    path=st.text(max_size=8),
    query=query_bytes,
    headers=headers,
    token=st.sampled_from([None, TOKEN]),
)
def test_whatever_bytes_a_stranger_sends_the_answer_is_a_refusal(
    method: str, path: str, query: bytes, headers: list[tuple[bytes, bytes]], token: str | None
) -> None:
    status = send(guarded(token), method, path, query, headers).status
    assert status < 500
    assert token is None or status >= 400
    origins = [value.decode("latin-1") for name, value in headers if name == b"origin"]
    if method != "GET" and any(not same_origin(origin, HOST) for origin in origins):
        assert status == 403


@settings(max_examples=300, deadline=None)
@given(method=st.sampled_from(["GET", "POST", "SOCKET"]), path=st.text(max_size=8), query=query_bytes, headers=headers)
def test_nor_does_the_operator_make_it_fail(method: str, path: str, query: bytes, headers: list[tuple[bytes, bytes]]) -> None:
    cookie = f"{COOKIE}={Credentials(TOKEN).cookie_value}"
    assert send(guarded(TOKEN), method, path, query, [*headers, (b"cookie", cookie.encode())]).status < 500


@pytest.mark.parametrize("origin", [url.decode("latin-1") for url in ODD_URLS])
@pytest.mark.parametrize("method", ["POST", "SOCKET"])
def test_an_origin_that_is_no_address_is_foreign(method: str, origin: str) -> None:
    headers = [(b"host", HOST.encode()), (b"origin", origin.encode("latin-1"))]
    assert send(guarded(None), method, "/", b"", headers).status == 403
    assert send(guarded(TOKEN), method, "/", b"", headers).status == 403


def test_one_foreign_origin_among_several_is_enough() -> None:
    headers = [(b"host", HOST.encode()), (b"origin", PAGE.encode()), (b"origin", b"https://evil.example")]
    assert send(guarded(None), "POST", "/", b"", headers).status == 403
