"""Tasks by REST: begun, watched, taken over, aborted, and refused before anything moves."""

import pytest

from sim.tasks import TASKS
from tests.server.running_server import RunningServer

TASKS_PATH = "/api/v1/tasks"


@pytest.fixture
def boxed(server: RunningServer) -> RunningServer:
    """In scene "box"; afterwards in the free one."""
    server.http.put("/api/v1/scene", json={"name": "box", "parameters": {"mass_kg": 3.0}}).raise_for_status()
    return server


@pytest.fixture(autouse=True)
def free_again(server: RunningServer):
    yield
    server.http.put("/api/v1/scene", json={"name": "free"}).raise_for_status()


def test_the_tasks_and_their_options_are_told(server: RunningServer) -> None:
    told = {kind["name"]: kind for kind in server.http.get(TASKS_PATH).json()}
    assert set(told) == set(TASKS)
    assert told["valve"]["scene"] == "valve"
    assert told["wipe"]["options"]["force_n"] == {"default": 15.0, "minimum": 5.0, "maximum": 25.0, "unit": "N"}


def test_a_task_is_watched_and_any_command_takes_over(boxed: RunningServer) -> None:
    begun = boxed.http.post(TASKS_PATH, json={"name": "box", "options": {"press_n": 18.0}})
    assert begun.status_code == 201
    key = begun.json()["id"]
    state = boxed.wait_for(lambda state: state["command"]["position_m"][2] < 0.5)
    assert state["task"] == {**state["task"], "id": key, "name": "box", "phase": "approach", "outcome": None, "in_charge": True}
    assert state["readings"] == {"box_position_m": pytest.approx(0.0, abs=1e-3)}
    told = boxed.http.get(f"{TASKS_PATH}/current").json()
    assert told["options"]["press_n"] == 18.0 and len(told["plan_m"]) == 2
    assert boxed.http.post(TASKS_PATH, json={"name": "box"}).status_code == 409
    # A change is one of what the task commands, not of what the operator had asked before.
    answer = boxed.http.patch("/api/v1/command", json={"base_velocity": [0.0, 0.0, 0.1]}).json()
    assert answer["position_m"][2] < 0.5
    boxed.wait_for(lambda state: state["task"]["outcome"] == "aborted" and not state["task"]["in_charge"])
    assert boxed.http.get(f"{TASKS_PATH}/{key}").json()["reason"] == "the operator took over"
    assert boxed.http.delete(f"{TASKS_PATH}/{key}").status_code == 404


def test_an_aborted_task_and_one_under_the_estop_are_over(boxed: RunningServer) -> None:
    boxed.http.post(TASKS_PATH, json={"name": "box"}).raise_for_status()
    assert boxed.http.delete(f"{TASKS_PATH}/current").json()["outcome"] == "aborted"
    boxed.http.post("/api/v1/estop").raise_for_status()
    refused = boxed.http.post(TASKS_PATH, json={"name": "box"})
    assert refused.status_code == 409 and "e-stop" in refused.json()["detail"]


def test_what_cannot_begin_is_refused_with_what_to_do(boxed: RunningServer) -> None:
    wrong_scene = boxed.http.post(TASKS_PATH, json={"name": "door"})
    assert wrong_scene.status_code == 409 and "needs scene 'door'" in wrong_scene.json()["detail"]
    far = boxed.http.post(TASKS_PATH, json={"name": "box", "options": {"site_x_m": 2.0}})
    assert far.status_code == 409 and "out of reach" in far.json()["detail"]
    for body, field in (
        ({"name": "dance"}, "name"),
        ({"name": "box", "options": {"press_n": 99.0}}, "options.press_n"),
        ({"name": "box", "options": {"speed": 1.0}}, "options.speed"),
        ({"name": "box", "options": {"press_n": "strong"}}, "options.press_n"),
    ):
        invalid = boxed.http.post(TASKS_PATH, json=body)
        assert invalid.status_code == 422 and invalid.json()["detail"][0]["field"] == field
    assert (
        boxed.http.get("/api/v1/state").json()["task"] is None
        or not boxed.http.get("/api/v1/state").json()["task"]["in_charge"]
    )


def test_parameters_of_the_scene_are_told_drawn_and_changed_while_it_runs(boxed: RunningServer) -> None:
    values = {p["name"]: p["value"] for p in boxed.http.get("/api/v1/scene").json()["parameters"]}
    assert values["mass_kg"] == 3.0
    changed = boxed.http.patch("/api/v1/scene", json={"parameters": {"damping_nspm": 20.0}}).json()
    boxed.wait_for(lambda state: state["scene"] == "box")
    assert {p["name"] for p in changed["parameters"]} == {"mass_kg", "damping_nspm"}
    refused = boxed.http.patch("/api/v1/scene", json={"parameters": {"damping_nspm": 900.0}})
    assert refused.status_code == 422 and refused.json()["detail"][0]["field"] == "parameters.damping_nspm"
    drawn = boxed.http.put("/api/v1/scene", json={"name": "box", "seed": 5, "rigid": True}).json()
    assert {p["name"]: p["value"] for p in drawn["parameters"]}["mass_kg"] != 2.0
