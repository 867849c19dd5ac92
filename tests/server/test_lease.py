"""One operator commands and the rest watch; who falls silent loses the lease; the e-stop is anyone's."""

import logging
import re
import time
from collections.abc import Iterator

import httpx
import pytest

from server.audit import ALIKE_S, Audit
from server.caller import LEASE_HEADER, Caller
from server.errors import RefusedError
from server.lease import LIFE_S, Lease
from tests.server.contract import API, all_routes, check_answer
from tests.server.running_server import RunningServer

ADA, GRACE = Caller("a", page="secret of Ada"), Caller("b", page="secret of Grace")
ANYONES = {"estop", "check_estop", "take_lease", "release_lease", "seek_history", "start_estimates"}
"""Calls that change something and need no lease, or refuse by themselves."""


class Clock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def lease(clock: Clock) -> Lease:
    return Lease(clock)


def test_anyone_may_command_while_nobody_holds_it(lease: Lease) -> None:
    lease.require(ADA)
    lease.require(Caller("script"))
    assert lease.seen_by(ADA) == (None, False, None)


def test_one_commands_and_the_others_are_told_who(lease: Lease) -> None:
    lease.take("Ada", ADA, take_over=False)
    lease.require(ADA)
    for other in (GRACE, Caller("a"), Caller("a", token="guessed"), Caller("a", page="")):
        with pytest.raises(RefusedError, match="Ada drives"):
            lease.require(other)
        with pytest.raises(RefusedError, match="Ada drives"):
            lease.take("Grace", other, take_over=False)
        with pytest.raises(RefusedError, match="Ada drives"):
            lease.release(other)
    assert lease.seen_by(GRACE)[:2] == ("Ada", False)


def test_the_token_acts_for_its_operator_from_anywhere(lease: Lease) -> None:
    holder, loser = lease.take("Ada", ADA, take_over=False)
    assert loser is None
    lease.require(Caller("elsewhere", token=holder.token))
    renewed, _ = lease.take("Ada L.", Caller("elsewhere", token=holder.token), take_over=False)
    assert renewed.token == holder.token
    lease.require(ADA)
    assert lease.seen_by(ADA)[:2] == ("Ada L.", True)


def test_taking_over_ends_the_other_lease(lease: Lease) -> None:
    before, _ = lease.take("Ada", ADA, take_over=False)
    after, loser = lease.take("Grace", GRACE, take_over=True)
    assert loser == "Ada" and after.token != before.token
    lease.require(GRACE)
    for lost in (ADA, Caller("a", token=before.token)):
        with pytest.raises(RefusedError, match="Grace drives"):
            lease.require(lost)


def test_a_word_of_the_holder_renews_it_and_silence_ends_it(lease: Lease, clock: Clock) -> None:
    assert LIFE_S < 5.0
    lease.take("Ada", ADA, take_over=False)
    for _ in range(5):
        clock.now_s += 0.9 * LIFE_S
        lease.require(ADA)
    clock.now_s += 0.9 * LIFE_S
    assert lease.lapsed() is None
    with pytest.raises(RefusedError):
        lease.require(GRACE)  # which renews nothing
    clock.now_s += 0.1 * LIFE_S
    assert (lease.lapsed(), lease.lapsed()) == ("Ada", None)
    lease.require(GRACE)


def test_alike_commands_leave_two_lines(caplog: pytest.LogCaptureFixture, clock: Clock) -> None:
    caplog.set_level(logging.INFO, "forcelens.audit")
    audit = Audit(clock)
    for index in range(60):
        audit.note("Ada", "pull", {"x": index})
        clock.now_s += ALIKE_S / 100
        audit.settle()
    audit.note("Grace", "estop", {})
    clock.now_s += ALIKE_S
    audit.settle()
    audit.settle()
    assert [record.getMessage() for record in caplog.records] == [
        "Ada: pull x=0",
        "Grace: estop",
        "Ada: pull x=59 (the last of 59 more)",
    ]


@pytest.fixture
def held(server: RunningServer) -> Iterator[RunningServer]:
    """A server whose lease another holds, as long as the test runs."""
    take(server, "Ada")
    yield server
    token = take(server, "the end", take_over=True)
    server.http.delete(f"{API}lease", headers={LEASE_HEADER: token}).raise_for_status()


def take(server: RunningServer, name: str, **options: bool) -> str:
    answer = server.http.post(f"{API}lease", json={"operator": name, **options})
    check_answer(answer)
    return answer.raise_for_status().json()["token"]


def test_whoever_watches_changes_nothing_by_any_call(held: RunningServer) -> None:
    """Also by calls that are yet to be written: they must pass `needs_lease`."""
    bodies = {
        "patch_command": {"guidance": True},
        "post_run": {"state": "paused"},
        "run": {"state": "paused"},
        "step": {"ticks": 1},
        "put_scene": {"name": "box"},
        "put_controller": {"name": "model_based"},
        "put_estimator": {"name": "adaptive"},
        "put_mismatch": {"mass_scale": 1.1},
        "put_backend": {"name": "simulation"},
        "add_wrench": {"force_n": [1, 0, 0], "frame": "world", "duration_s": 1.0},
        "request_drive": {"request": "engage"},
        "patch_scene": {"parameters": {"spring_scale": 1.0}},
        "put_tool": {"mass_kg": 0.0, "center_of_mass_m": [0, 0, 0]},
        "start_task": {"name": "wipe", "options": {}},
        "start_recording": {},
        "start_estimates": {"estimator": "adaptive"},
        "patch_replay": {"speed": 1.0},
    }
    for route in all_routes():
        for method in sorted((route.methods or set()) - {"GET"}):
            if route.name not in ANYONES:
                path = re.sub(r"{\w+}", "1", route.path)
                answer = held.http.request(method, path, json=bodies.get(route.name))
                assert (answer.status_code, "Ada drives" in answer.text) == (409, True), (route.name, answer.text)
    state = held.state()
    assert (state["mode"], state["command"]["guidance"]) == ("running", False)


def test_the_holder_commands_and_anyone_stops(held: RunningServer) -> None:
    token = {LEASE_HEADER: take(held, "Grace", take_over=True)}
    assert held.http.patch(f"{API}command", json={"force_n": [0, 0, 5]}, headers=token).status_code == 200
    assert held.http.get(f"{API}lease").json() | {"expires_s": 0} == {"operator": "Grace", "yours": False, "expires_s": 0}
    assert held.http.get(f"{API}lease", headers=token).json()["yours"]
    assert held.http.post(f"{API}estop/check").json()["may_stop"]
    assert held.http.post(f"{API}estop").json()["latched"]
    assert held.http.post(f"{API}estop/clear").status_code == 409
    assert held.http.post(f"{API}estop/clear", headers=token).status_code == 200
    assert held.http.delete(f"{API}lease", headers=token).status_code == 204


@pytest.mark.parametrize("how", ["taken over", "given back", "fell silent"])
def test_the_base_stops_when_its_operator_goes(held: RunningServer, how: str) -> None:
    token = {LEASE_HEADER: take(held, "Grace", take_over=True)}
    held.http.patch(
        f"{API}command", json={"base_velocity": [0.2, 0, 0], "force_n": [0, 0, 3]}, headers=token
    ).raise_for_status()
    held.wait_for(lambda state: state["command"]["base_velocity"] == [0.2, 0, 0])
    asked_s = time.monotonic()
    if how == "taken over":
        take(held, "Ada", take_over=True)
    elif how == "given back":
        held.http.delete(f"{API}lease", headers=token).raise_for_status()
    state = held.wait_for(lambda state: state["command"]["base_velocity"] == [0, 0, 0])
    assert state["command"]["force_n"] == [0, 0, 3], "the hand holds what it was asked for"
    if how == "fell silent":
        assert time.monotonic() - asked_s > LIFE_S - 0.5
        assert held.http.get(f"{API}lease").json()["operator"] is None


def test_a_page_is_known_by_its_cookie(server: RunningServer) -> None:
    base = f"http://127.0.0.1:{server.port}"
    with httpx.Client(base_url=base) as ada, httpx.Client(base_url=base) as grace:
        cookies = {}
        for name, page in (("ada", ada), ("grace", grace)):
            header = page.get("/").headers["set-cookie"]
            assert "HttpOnly" in header and "SameSite=Strict" in header and f"forcelens_page_{server.port}" in header
            cookies[name] = header.partition(";")[0]
            assert "set-cookie" not in page.get("/").headers, "it stays the same page"
        assert cookies["ada"] != cookies["grace"]
        ada.post(f"{API}lease", json={"operator": "Ada"}).raise_for_status()
        assert ada.patch(f"{API}command", json={"guidance": False}).status_code == 200
        assert grace.patch(f"{API}command", json={"guidance": False}).status_code == 409
        assert ada.delete(f"{API}lease").status_code == 204


def test_the_audit_log_tells_who_did_what(server: RunningServer, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "forcelens.audit")
    token = {LEASE_HEADER: take(server, "Hedy")}  # Of nobody else's name: lines alike within a second become one.
    server.http.patch(f"{API}command", json={"force_n": [0, 0, 5]}, headers=token)
    server.http.put(f"{API}scene", json={"name": "moon"}, headers=token)
    server.http.patch(f"{API}command", json={"force_n": [0, 0, 1]})
    server.http.delete(f"{API}lease", headers=token)
    lines = [record.getMessage() for record in caplog.records]
    who = "Hedy (script at 127.0.0.1)"
    assert f"{who}: take_lease" in lines
    assert f"{who}: patch_command force_n=[0.0, 0.0, 5.0]" in lines
    assert any(line.startswith(f"{who}: set_scene name='moon'") and " refused: " in line for line in lines)
    assert any(line.startswith("script at 127.0.0.1: patch_command") and "refused: Hedy drives" in line for line in lines)
