"""A session is offered the events of its kind; another kind's are refused with what to do."""

import pytest

from server.messages import Outcome
from server.session_events import EventError, SessionEvents, describe
from tests.server.fake_session import FakeRobotSession, FakeSession

SIMULATION_ONLY = ("reset", "set_scene", "set_mismatch", "add_wrench", "list_wrenches", "remove_wrench")


@pytest.mark.parametrize("event", SIMULATION_ONLY)
def test_what_only_a_simulation_can_do_is_refused_by_a_robot(event: str) -> None:
    with pytest.raises(EventError, match="simulation only; PUT /api/v1/backend with 'simulation' first") as refusal:
        SessionEvents(FakeRobotSession()).carry_out(event, {})
    assert refusal.value.outcome is Outcome.REFUSED


def test_a_simulation_has_no_drives() -> None:
    with pytest.raises(EventError, match="PUT /api/v1/backend with 'hardware' first") as refusal:
        SessionEvents(FakeSession()).carry_out("drive", {"request": "stand"})
    assert refusal.value.outcome is Outcome.REFUSED


def test_a_robot_is_driven_and_may_refuse() -> None:
    events = SessionEvents(FakeRobotSession())
    assert events.carry_out("drive", {"request": "sit"}) == 7
    with pytest.raises(EventError, match="latched") as refusal:
        events.carry_out("drive", {"request": "stand"})
    assert refusal.value.outcome is Outcome.REFUSED


def test_only_a_simulation_offers_scenes_and_keyframes() -> None:
    robot, simulation = describe(FakeRobotSession()), describe(FakeSession())
    assert robot["scenes"] == robot["keyframes"] == []
    assert "box" in simulation["scenes"] and simulation["keyframes"] == ["stand"]
    assert robot["controllers"] == simulation["controllers"] == ["model_based"]
