"""Wrong input: 422 with the field's name and its allowed range, and nothing changes."""

from typing import Any

import pytest

from tests.server.running_server import RunningServer

WRENCH = {"force_n": [1, 0, 0], "frame": "world", "duration_s": 1.0}

WRONG: list[tuple[str, str, Any, str, str]] = [
    ("PATCH", "command", {"force_n": [0, 0, 55]}, "force_n[2]", "-40 to 40 N"),
    ("PATCH", "command", {"force_n": [0, 0]}, "force_n", "3 numbers"),
    ("PATCH", "command", {"force_n": [0, 0, 0, 0]}, "force_n", "3 numbers"),
    ("PATCH", "command", {"force_n": [0, 0, True]}, "force_n[2]", "-40 to 40 N"),
    ("PATCH", "command", {"force_n": [0, "1", 0]}, "force_n[1]", "-40 to 40 N"),
    ("PATCH", "command", {"force_n": 3}, "force_n", "3 numbers"),
    ("PATCH", "command", {"force_n": None}, "force_n", "leave it out"),
    ("PATCH", "command", {"mask": [0, 0, 2]}, "mask[2]", "0 (position) or 1 (force)"),
    ("PATCH", "command", {"mask": [0, 0, True]}, "mask[2]", "0 (position) or 1 (force)"),
    ("PATCH", "command", {"mask": [0, 0, 0.5]}, "mask[2]", "0 (position) or 1 (force)"),
    ("PATCH", "command", {"mask": [0, 1]}, "mask", "3 entries"),
    ("PATCH", "command", {"position_m": [0.5, 0, 3]}, "position_m[2]", "0.1 to 0.95 m"),
    ("PATCH", "command", {"orientation_wxyz": [0, 0, 0, 0]}, "orientation_wxyz", ""),
    ("PATCH", "command", {"orientation_wxyz": [1, 0, 0]}, "orientation_wxyz", "4 numbers"),
    ("PATCH", "command", {"base_velocity": [2, 0, 0]}, "base_velocity[0]", "-0.6 to 0.6"),
    ("PATCH", "command", {"guidance": 1}, "guidance", "true or false"),
    ("PATCH", "command", {"guidance": "yes"}, "guidance", "true or false"),
    ("PATCH", "command", {"speed": 1}, "speed", ""),
    ("PATCH", "command", [1, 2], "body", ""),
    ("POST", "run", {}, "state", "required"),
    ("POST", "run", {"state": "flying"}, "state", "'running' or 'paused'"),
    ("POST", "run", {"state": "running", "speed": 9}, "speed", "0.1 to 4"),
    ("POST", "run", {"state": "running", "speed": "1"}, "speed", "0.1 to 4"),
    ("POST", "step", {"ticks": 0}, "ticks", "1 to 5000 ticks"),
    ("POST", "step", {"ticks": 1.5}, "ticks", "1 to 5000 ticks"),
    ("POST", "step", {"ticks": True}, "ticks", "1 to 5000 ticks"),
    ("POST", "step", {}, "ticks", "required"),
    ("POST", "reset", {"seed": -1}, "seed", "0 to"),
    ("POST", "reset", {"keyframe": "fly"}, "keyframe", "stand"),
    ("POST", "reset", {"seeed": 1}, "seeed", ""),
    ("POST", "control/restart", {"force": 1}, "force", "true or false"),
    ("PUT", "backend", {"name": "toaster"}, "name", "'simulation', 'hardware' or 'replay'"),
    ("PUT", "backend", {"name": "hardware", "options": {"domain": 231}}, "options.domain", "0 to 230"),
    ("PUT", "backend", {"name": "hardware", "options": {"domain": 0}}, "options.allow_robot", "real robot"),
    ("PUT", "backend", {"name": "hardware", "options": {"arm_host": "10.0.0.1"}}, "options.allow_robot", "real robot"),
    ("PUT", "backend", {"name": "hardware", "options": {"interface": "a b"}}, "options", "see the message"),
    ("PUT", "backend", {"name": "hardware", "options": {"speed": 1}}, "options.speed", ""),
    ("POST", "hardware", {"request": "jump"}, "request", "'engage'"),
    ("POST", "hardware", {}, "request", "required"),
    ("PUT", "scene", {"name": "moon"}, "name", "free"),
    ("PUT", "scene", {"name": 3}, "name", ""),
    ("PUT", "scene", {}, "name", "required"),
    ("PUT", "controller", {"name": "magic"}, "name", "model_based"),
    ("PUT", "estimator", {"name": "magic"}, "name", "adaptive"),
    ("PUT", "estimator", {"name": "adaptive", "gains": {"k1": 1.0}}, "gains.k2", "required"),
    ("PUT", "estimator", {"name": "adaptive", "gains": {"k1": -1, "k2": 1}}, "gains.k1", "0.1 to 1000"),
    ("PUT", "mismatch", {"mass_scale": 2.0}, "mass_scale", "0.5 to 1.5"),
    ("PUT", "mismatch", {"mass_scale": 1.0, "per_link": {"base": 9}}, "per_link.base", "0.5 to 1.5"),
    ("PUT", "mismatch", {"mass_scale": 1.0, "per_link": {"tail": 1.0}}, "per_link", "base"),
    ("POST", "wrenches", {**WRENCH, "force_n": [0, 0, 1e9]}, "force_n[2]", "-200 to 200 N"),
    ("POST", "wrenches", {**WRENCH, "frame": "moon"}, "frame", "'world', 'heading' or 'body'"),
    ("POST", "wrenches", {**WRENCH, "duration_s": 0}, "duration_s", "0.002 to 600 s"),
    ("POST", "wrenches", {**WRENCH, "ramp_s": 0.6}, "ramp_s", "0 to half of duration_s"),
    ("POST", "wrenches", {**WRENCH, "body": "tail"}, "body", "end_effector"),
    ("POST", "wrenches", {"force_n": [1, 0, 0], "duration_s": 1.0}, "frame", "required"),
    ("DELETE", "wrenches/abc", None, "wrench_id", ""),
]


def unchanging(state: dict) -> dict:
    """What only a call changes."""
    return {
        name: state[name] for name in ("command", "scene", "controller", "estimator", "mass_scale_true", "command_sequence")
    }


@pytest.mark.parametrize(("method", "path", "body", "field", "allowed"), WRONG)
def test_wrong_input_names_its_field_and_range_and_changes_nothing(
    server: RunningServer, method: str, path: str, body: Any, field: str, allowed: str
) -> None:
    before = server.wait_for(lambda state: state["command_sequence"] == server.operator.command()[1])
    response = server.http.request(method, f"/api/v1/{path}", json=body)
    assert response.status_code == 422, response.text
    detail = response.json()["detail"]
    assert detail[0]["field"] == field
    assert allowed in detail[0]["allowed"]
    assert field in detail[0]["msg"]
    assert unchanging(server.state()) == unchanging(before)
    assert server.state()["mode"] == "running"


@pytest.mark.parametrize("literal", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_numbers_that_are_not_finite_are_refused(server: RunningServer, literal: str) -> None:
    response = server.http.patch(
        "/api/v1/command", content=f'{{"force_n": [0, 0, {literal}]}}', headers={"Content-Type": "application/json"}
    )
    assert response.status_code == 422
    assert response.json()["detail"][0]["field"] == "force_n[2]"


def test_broken_json_is_refused(server: RunningServer) -> None:
    response = server.http.patch("/api/v1/command", content="{", headers={"Content-Type": "application/json"})
    assert response.status_code == 422
    assert "JSON" in response.json()["detail"][0]["msg"]


def test_the_scene_side_is_refused_by_the_same_checks(server: RunningServer) -> None:
    operator = server.operator
    sequence = operator.command()[1]
    with pytest.raises(ValueError, match=r"force_n\[2\].*-40 to 40 N"):
        operator.patch_command(force_n=(0.0, 0.0, 99.0))
    with pytest.raises(ValueError, match="3 finite numbers"):
        operator.set_drag((0.0, float("nan"), 0.0))
    with pytest.raises(ValueError, match=r"0\.1 to 4"):
        operator.set_run(None, 7.0)
    assert operator.command()[1] == sequence
    operator.estop()
    with pytest.raises(RuntimeError, match="estop/clear"):
        operator.patch_command(guidance=True)
