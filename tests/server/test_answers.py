"""Every answer has a schema, real answers fit it, and the examples in the documentation are such answers."""

import json
import re
from collections.abc import Iterator
from typing import Any, get_args

import numpy as np
import pytest
from fastapi import FastAPI
from pydantic import ValidationError

from server.answers.hardware import HardwareAnswer
from server.answers.schema import EXAMPLES
from server.answers.state import StateAnswer
from server.app import create_app
from server.control_client import ControlClient
from server.control_process import ControlLaunch
from server.credentials import Credentials
from server.operator import Operator
from server.responses import refusals
from server.routes.hardware import hardware_json
from server.state import SECTIONS, encode
from sim.backends.hardware.records import IO_STATE
from sim.backends.hardware.status import status_from_record
from tests.server.contract import API, all_routes, ask, check_answer, check_fit, route_of
from tests.server.running_server import RunningServer
from tests.server.tour import tour
from web.viser_door import ViserDoor

TOKEN = "a token for the tests"
NEED_A_ROBOT = {"get_hardware", "request_drive"}
"""tests/server/test_hardware_console.py holds them against their schema."""


@pytest.fixture(scope="module")
def app() -> FastAPI:
    """Without a control process."""
    launch = ControlLaunch()
    return create_app(Operator(ControlClient(launch), launch), scene=ViserDoor(), credentials=Credentials(TOKEN))


@pytest.fixture(scope="module")
def calls(app: FastAPI) -> list[dict[str, Any]]:
    """Operations of the OpenAPI document."""
    return [call for methods in app.openapi()["paths"].values() for call in methods.values()]


def authorized(app: FastAPI, path: str) -> Any:
    return ask(app, "GET", path, headers={"Authorization": f"Bearer {TOKEN}"})


def test_every_call_of_a_simulation_answers_by_its_schema(server: RunningServer, calls: list[dict[str, Any]]) -> None:
    done, refused = set(), set()
    for response in tour(server.http):
        check_answer(response)
        route = route_of(response)
        if response.is_success and route is not None:
            done.add(route.name)
        else:
            refused.add(response.status_code)
    assert done == {call["operationId"] for call in calls} - NEED_A_ROBOT
    assert refused == {400, 403, 404, 405, 409, 413, 422}


def test_without_a_token_or_a_control_process_answers_have_schemas_too(app: FastAPI) -> None:
    statuses = {path: authorized(app, API + path) for path in ("health", "ready", "state", "scene")}
    for response in (*statuses.values(), ask(app, "GET", f"{API}state")):
        check_answer(response)
    assert {response.status_code for response in statuses.values()} == {503}
    assert ask(app, "GET", f"{API}state").status_code == 401


def test_a_defect_is_told_as_json(app: FastAPI, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Operator, "command", lambda _: 1 / 0)
    response = authorized(app, f"{API}command")
    assert response.status_code == 500
    assert "ZeroDivisionError" in response.json()["detail"]
    check_answer(response)


def test_a_robot_that_was_never_heard_has_nulls_by_the_schema() -> None:
    record = np.zeros(1, IO_STATE)[0]
    for name in ("battery_percent", "battery_v", "temperature", "sensors", "base_received_s", "arm_received_s"):
        record[name] = np.nan
    check_fit(HardwareAnswer, encode(hardware_json(status_from_record(record, 1.0))).decode())


def test_what_the_schema_does_not_know_does_not_fit() -> None:
    with pytest.raises(ValidationError, match="news"):
        check_fit(StateAnswer, json.dumps(EXAMPLES["StateAnswer"] | {"news": 1}))
    with pytest.raises(ValidationError, match="loop"):
        check_fit(StateAnswer, json.dumps({name: EXAMPLES["StateAnswer"][name] for name in SECTIONS if name != "loop"}))


def test_the_state_has_its_sections_in_the_order_of_the_schema() -> None:
    assert list(SECTIONS) == list(StateAnswer.__annotations__)


def test_operations_have_readable_names_of_their_own(calls: list[dict[str, Any]]) -> None:
    names = [call["operationId"] for call in calls]
    assert len(set(names)) == len(names) >= 25
    assert all(re.fullmatch(r"[a-z]+(_[a-z]+)?", name) for name in names), names
    assert {"get_state", "patch_command", "put_scene", "estop", "clear_estop", "restart_control"} <= set(names)


def schemas(content: Any) -> Iterator[str]:
    """Names of the schemas that a part of the document refers to."""
    yield from re.findall(r'"#/components/schemas/(\w+)"', json.dumps(content))


def test_every_answer_has_a_schema_and_an_example_of_it(app: FastAPI, calls: list[dict[str, Any]]) -> None:
    components = app.openapi()["components"]["schemas"]
    for call in calls:
        for status, answer in call["responses"].items():
            if status == "204" or "application/octet-stream" in answer.get("content", {}):
                continue
            assert list(schemas(answer)), (call["operationId"], status)
            if status.startswith("2"):
                assert all(components[name]["examples"] for name in schemas(answer)), call["operationId"]


def test_every_request_has_an_example(app: FastAPI, calls: list[dict[str, Any]]) -> None:
    components = app.openapi()["components"]["schemas"]
    for call in calls:
        assert all(components[name]["examples"] for name in schemas(call.get("requestBody"))), call["operationId"]


def test_every_field_of_an_answer_has_a_manual(app: FastAPI, calls: list[dict[str, Any]]) -> None:
    components = app.openapi()["components"]["schemas"]
    untold, seen = set(), set()
    waiting = {name for call in calls for name in schemas(call["responses"])}
    while waiting:
        name = waiting.pop()
        seen.add(name)
        waiting |= set(schemas(components[name])) - seen
        for field, schema in components[name]["properties"].items():
            if not any(components[part].get("description") for part in schemas(schema)) and not schema.get("description"):
                untold.add(f"{name}.{field}")
    assert not untold


def answer_schemas() -> dict[str, Any]:
    """Schemas of success by name; of a list its entries'."""
    models = [route.response_model for route in all_routes() if route.response_model is not None]
    entries = [(get_args(model) or (model,))[0] for model in models]
    return {schema.__name__: schema for schema in entries}


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_are_answers(name: str) -> None:
    schema = refusals(int(name))[int(name)]["model"] if name.isdigit() else answer_schemas()[name]
    check_fit(schema, json.dumps(EXAMPLES[name]))


def test_the_recorded_state_has_the_estimators_of_today(server: RunningServer) -> None:
    recorded = EXAMPLES["StateAnswer"]["end_effector"]["force_estimates_n"]
    assert set(recorded) == set(server.state()["end_effector"]["force_estimates_n"])
