"""Every answer, refusals too, keeps pages of others out."""

import pytest

from tests.server.running_server import RunningServer


@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("GET", "/"),
        ("GET", "/docs"),
        ("GET", "/static/main.js"),
        ("GET", "/api/v1/state"),
        ("GET", "/no"),
        ("PATCH", "/api/v1/command"),
    ],
)
@pytest.mark.parametrize("host", ["localhost", "evil.example"])
def test_nobody_may_frame_or_reinterpret_an_answer(server: RunningServer, method: str, path: str, host: str) -> None:
    headers = server.http.request(method, path, headers={"Host": host}, json=[]).headers
    assert headers["content-security-policy"] == "frame-ancestors 'none'"
    assert headers["x-frame-options"] == "DENY"
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["referrer-policy"] == "same-origin"


def test_the_scene_stands_in_a_frame_of_our_own_page(server: RunningServer) -> None:
    headers = server.http.get("/viser/").headers
    assert headers["content-security-policy"] == "frame-ancestors 'self'"
    assert headers["x-frame-options"] == "SAMEORIGIN"


def test_the_page_may_ask_whether_its_estop_would_be_heard(server: RunningServer) -> None:
    before = server.state()["mode"]
    assert server.http.post("/api/v1/estop/check").json() == {"may_stop": True}
    assert server.http.post("/api/v1/estop/check", headers={"Origin": "http://["}).status_code == 403
    assert server.state()["mode"] == before
