"""The past of a simulation by REST, through both processes."""

from typing import Any

import pytest

from tests.server.contract import API, check_answer
from tests.server.running_server import RunningServer


def call(server: RunningServer, method: str, path: str, body: Any = None) -> Any:
    response = server.http.request(method, API + path, json=body)
    check_answer(response)
    return response


@pytest.fixture
def paused(server: RunningServer) -> RunningServer:
    """Two tenths of a second after a reset, under a command."""
    call(server, "POST", "run", {"state": "paused"})
    call(server, "POST", "reset", {"seed": 5})
    call(server, "POST", "step", {"ticks": 600})
    return server


def test_unchanged_the_same_comes_again_and_changed_it_does_not(paused: RunningServer) -> None:
    start = call(paused, "GET", "history").json()
    assert (start["end_s"], start["past"]) == (pytest.approx(start["time_s"]), False)
    middle_s = start["end_s"] - 0.3
    before = paused.state()
    for changes, same in (({}, True), ({"mass_scale": 1.3}, False), ({"mass_scale": 1.0}, True)):
        answer = call(paused, "POST", "history/branch", {"time_s": middle_s, **changes}).json()
        assert answer["time_s"] == answer["end_s"] == pytest.approx(middle_s)
        assert paused.state()["mode"] == "paused"
        call(paused, "POST", "step", {"ticks": 150})
        after = paused.state()
        assert after["time_s"] == pytest.approx(before["time_s"])
        assert (after["end_effector"] == before["end_effector"]) is same, changes
    assert call(paused, "GET", "mismatch").json()["mass_scale"] == 1.0


def test_what_is_selected_goes_back_too(paused: RunningServer) -> None:
    before = call(paused, "GET", "estimator").json()
    call(paused, "PUT", "estimator", {"name": "gmo_cqp", "gains": {"k1": 9.0, "k2": 30.0}})
    call(paused, "POST", "step", {"ticks": 50})
    call(paused, "POST", "history/branch", {"time_s": paused.state()["time_s"] - 0.2})
    after = call(paused, "GET", "estimator").json()
    assert (after["name"], after["gains"]) == (before["name"], before["gains"])


def test_a_moment_is_shown_and_running_shows_the_newest_again(paused: RunningServer) -> None:
    end_s = paused.state()["time_s"]
    assert call(paused, "POST", "history/seek", {"time_s": end_s - 0.25}).json()["past"]
    assert paused.state()["time_s"] == pytest.approx(end_s - 0.25, abs=0.01)
    call(paused, "POST", "step", {"ticks": 1})
    assert paused.state()["time_s"] == pytest.approx(end_s + 0.002)


@pytest.mark.parametrize(
    ("path", "body", "status", "words"),
    [
        ("seek", {"time_s": 99.0}, 422, "does not reach 99 s"),
        ("branch", {"time_s": 99.0}, 422, "does not reach 99 s"),
        ("branch", {"estimator": "nope"}, 422, "estimator 'nope' does not exist"),
        ("branch", {"mass_scale": 3.0}, 422, "0.5 to 1.5"),
        ("seek", {}, 422, "time_s is missing"),
    ],
)
def test_what_cannot_be_is_refused_and_changes_nothing(
    paused: RunningServer, path: str, body: dict[str, Any], status: int, words: str
) -> None:
    before = call(paused, "GET", "history").json()
    response = call(paused, "POST", f"history/{path}", body)
    assert (response.status_code, words in response.text) == (status, True), response.text
    assert call(paused, "GET", "history").json() == before


def test_a_running_simulation_is_not_set_back(server: RunningServer) -> None:
    response = call(server, "POST", "history/branch", {})
    assert response.status_code == 409
    assert "is running" in response.json()["detail"]
