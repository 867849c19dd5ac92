"""Any token works by every way of showing it; sessions of consoles are apart; an address keeps no secret."""

import html
import re
import time
from urllib.parse import urlsplit

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import server.credentials
from server.access import AccessControl
from server.credentials import Credentials, token_bytes
from server.web_server import page_address
from tests.server.asgi_request import HOST, Answer, ask, guarded, send

TOKEN = "ab+cd/ef=="
tokens = st.text(st.characters(exclude_characters="\0"), min_size=8, max_size=40).filter(lambda text: max(text) < "\ud800")
surrogate_escaped = st.binary(min_size=8, max_size=40).map(lambda data: data.decode(errors="surrogateescape"))
any_token = tokens | surrogate_escaped


def load(app: AccessControl, address: str, cookie: str | None = None) -> Answer:
    """Ask as a browser's address bar does."""
    parts = urlsplit(address)
    headers = [(b"host", parts.netloc.encode()), (b"accept", b"text/html,*/*;q=0.8")]
    headers += [] if cookie is None else [(b"cookie", cookie.encode())]
    return send(app, "GET", parts.path, parts.query.encode("ascii"), headers)


def cookie_of(answer: Answer) -> str:
    return answer.headers["set-cookie"].partition(";")[0]


@settings(max_examples=200, deadline=None)
@given(token=any_token)
def test_the_printed_address_works_for_any_token_and_leads_to_the_page_without_it(token: str) -> None:
    app = guarded(token)
    address = page_address("0.0.0.0", 8080, token)
    assert address.isascii()
    first = load(app, address)
    assert first.status == 200
    assert first.body != "done"
    second = load(app, "http://127.0.0.1:8080/", cookie_of(first))
    assert (second.status, second.body) == (200, "done")


@settings(max_examples=200, deadline=None)
@given(token=any_token)
def test_any_token_works_as_bearer(token: str) -> None:
    raw = token_bytes(token)
    # White space around a header's value is not part of it.
    assume(raw == raw.strip())
    headers = [(b"host", HOST.encode()), (b"authorization", b"Bearer " + raw)]
    assert send(guarded(token), "GET", "/", b"", headers).status == 200


@settings(max_examples=100, deadline=None)
@given(mine=any_token, yours=any_token)
def test_the_sessions_of_two_consoles_on_one_host_are_apart(mine: str, yours: str) -> None:
    assume(token_bytes(mine) != token_bytes(yours))
    jar = "; ".join(cookie_of(load(guarded(token), page_address("127.0.0.1", 8080, token))) for token in (mine, yours))
    for token in (mine, yours):
        assert load(guarded(token), "http://127.0.0.1:8080/", jar).status == 200
    assert cookie_of(load(guarded(mine), page_address("127.0.0.1", 8080, mine))) != jar.split("; ")[1]


def test_a_session_outlives_a_restart_and_does_not_tell_the_token() -> None:
    cookie = cookie_of(load(guarded(TOKEN), page_address("127.0.0.1", 8080, TOKEN)))
    assert load(guarded(TOKEN), "http://127.0.0.1:8080/", cookie).status == 200
    assert load(guarded("another token"), "http://127.0.0.1:8080/", cookie).status == 401
    assert "ab" + "+cd" not in cookie


@pytest.mark.parametrize("others", ["a[b]=1", "=", ";;", 'x="a;b', "forcelens_token=old", "\xff=\xff"])
def test_cookies_of_other_programs_on_the_host_do_no_harm(others: str) -> None:
    credentials = Credentials(TOKEN)
    ours = f"{credentials.cookie_name}={credentials.cookie_value}"
    for cookie in (f"{others}; {ours}", f"{ours}; {others}", f"{credentials.cookie_name}=stale; {ours}"):
        assert credentials.in_cookies([cookie])
        assert credentials.in_cookies([others, ours])
    assert not credentials.in_cookies([others])


@pytest.mark.parametrize(
    ("address", "target"),
    [
        ("/", "./"),
        ("/docs", "./docs"),
        ("/viser/", "./"),
        ("/below/a proxy", "./a%20proxy"),
        ("/docs?a=1&b=%26", "./docs?a=1&b=%26"),
        ("//evil.example/x", "./x"),
        ('/"><script>', "./%22%3E%3Cscript%3E"),
    ],
)
def test_a_page_with_the_token_in_its_address_becomes_the_same_without(address: str, target: str) -> None:
    path, _, rest = address.partition("?")
    query = f"token=ab%2Bcd%2Fef%3D%3D&{rest}".encode()
    answer = send(guarded(TOKEN), "GET", path, query, [(b"host", HOST.encode()), (b"accept", b"text/html")])
    found = re.search(r'content="0;url=([^"]*)"', answer.body)
    assert found
    assert html.unescape(found[1]) == target
    assert answer.headers["cache-control"] == "no-store"


def test_a_script_that_shows_the_token_in_the_address_is_answered_at_once() -> None:
    assert ask(query={"token": TOKEN}, token=TOKEN).body == "done"
    assert ask("POST", {"Accept": "text/html"}, query={"token": TOKEN}, token=TOKEN).body == "done"


def test_a_ticket_opens_the_page_once(monkeypatch: pytest.MonkeyPatch) -> None:
    credentials = Credentials(TOKEN)
    app = AccessControl(guarded(None), credentials)
    address = page_address("127.0.0.1", 8080, credentials.issue_ticket())
    assert ask(query={"token": address.partition("=")[2]}, token=TOKEN).status == 401, "of this console only"
    first = load(app, address)
    assert load(app, "http://127.0.0.1:8080/", cookie_of(first)).body == "done"
    assert load(app, address).status == 401
    late = page_address("127.0.0.1", 8080, credentials.issue_ticket())
    now = time.monotonic()
    monkeypatch.setattr(server.credentials.time, "monotonic", lambda: now + server.credentials.TICKET_LIFE_S + 1.0)
    assert load(app, late).status == 401
