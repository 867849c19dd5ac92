"""Every REST call as the contract has it: what it answers and what it changes."""

import json
import math
from concurrent.futures import ThreadPoolExecutor

import httpx
import pytest

from control.joints import JOINT_COUNT, JOINT_NAMES
from control.timing import TICK_S
from server import operator
from server.backend_choice import with_options
from server.control_client import ControlClient
from server.control_process import ControlLaunch
from server.errors import RefusedError
from sim.backends.hardware.config import HardwareConfig
from sim.backends.unitree.dds import INSTALL_HINT
from tests.server.running_server import RunningServer


def strict(response: httpx.Response) -> dict:
    """The JSON of a successful answer, refusing NaN, which Python would read."""

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is no JSON")

    assert response.is_success, response.text
    return json.loads(response.text, parse_constant=refuse)


def test_health_names_version_commit_backend_and_loop(server: RunningServer) -> None:
    health = strict(server.http.get("/api/v1/health"))
    assert health["status"] == "ok"
    assert {"version", "commit", "uptime_s"} <= set(health)
    assert health["backend"] == "simulation"
    assert {"rate_hz", "real_time_factor", "overruns", "lateness_p99_ms"} <= set(health["loop"])


def test_the_state_has_every_part_of_the_contract(server: RunningServer) -> None:
    state = strict(server.http.get("/api/v1/state"))
    assert {"time_s", "wall_time_s", "sequence", "mode", "faults", "backend", "scene", "controller", "estimator"} <= set(state)
    for command in (state["command"], state["applied_command"]):
        assert set(command) == {"mask", "force_n", "position_m", "orientation_wxyz", "base_velocity", "guidance"}
    assert set(state["base"]) == {"position_m", "orientation_wxyz", "linear_velocity_mps", "angular_velocity_rps"}
    assert tuple(state["joints"]["names"]) == JOINT_NAMES
    assert all(len(state["joints"][name]) == JOINT_COUNT for name in ("position", "velocity", "torque"))
    hand = state["end_effector"]
    assert len(hand["force_estimated_n"]) == len(hand["force_true_n"]) == 3
    assert set(hand["force_estimates_n"]) >= {"gmo_pi", "gmo_cqp", "adaptive"}
    assert [contact["wheel"] for contact in state["contacts"]] == ["FL", "FR", "RL", "RR"]
    assert math.isclose(math.hypot(*state["base"]["orientation_wxyz"]), 1.0, rel_tol=1e-6)


def test_a_patch_changes_its_fields_only_and_reaches_the_robot(server: RunningServer) -> None:
    before = strict(server.http.get("/api/v1/command"))
    asked = strict(server.http.patch("/api/v1/command", json={"mask": [0, 0, 1], "force_n": [0, 0, 12.5]}))
    assert asked["mask"] == [0, 0, 1]
    assert asked["force_n"] == [0.0, 0.0, 12.5]
    assert asked["position_m"] == before["position_m"]
    assert asked["sequence"] == before["sequence"] + 1
    assert strict(server.http.get("/api/v1/command")) == asked
    state = server.wait_for(lambda state: state["command_sequence"] == asked["sequence"])
    assert state["command"]["force_n"] == [0.0, 0.0, 12.5]
    server.wait_for(lambda state: state["applied_command"]["mask"] == [0, 0, 1])


def test_what_lies_out_of_reach_is_clipped_and_the_answer_says_so(server: RunningServer) -> None:
    asked = strict(server.http.patch("/api/v1/command", json={"position_m": [0.8, 0.35, 0.95]}))
    shoulder, reach = server.operator.limits.shoulder_m, server.operator.limits.reach_m
    assert math.dist(asked["position_m"], shoulder) == pytest.approx(reach, abs=1e-3)


def test_orientations_are_normalised(server: RunningServer) -> None:
    asked = strict(server.http.patch("/api/v1/command", json={"orientation_wxyz": [0.5, 0.0, 0.5, 0.0]}))
    assert asked["orientation_wxyz"] == pytest.approx([math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0])


def test_an_empty_patch_answers_the_command(server: RunningServer) -> None:
    before = strict(server.http.get("/api/v1/command"))
    after = strict(server.http.patch("/api/v1/command", json={}))
    assert {**after, "sequence": 0} == {**before, "sequence": 0}


def test_pause_step_and_run(server: RunningServer) -> None:
    assert strict(server.http.post("/api/v1/run", json={"state": "paused"}))["state"] == "paused"
    paused = server.state()
    assert paused["mode"] == "paused"
    stepped = strict(server.http.post("/api/v1/step", json={"ticks": 25}))
    assert stepped["time_s"] == pytest.approx(paused["time_s"] + 0.05)
    assert server.state()["time_s"] == pytest.approx(stepped["time_s"])
    running = strict(server.http.post("/api/v1/run", json={"state": "running", "speed": 0.5}))
    assert running == {"state": "running", "speed": 0.5}
    assert server.state()["loop"]["speed"] == 0.5
    assert strict(server.http.post("/api/v1/run", json={"state": "running"}))["speed"] == 0.5


def test_pausing_ends_many_steps_at_a_slow_speed(server: RunningServer) -> None:
    server.http.post("/api/v1/run", json={"state": "paused", "speed": 0.1}).raise_for_status()
    before_s = server.state()["time_s"]
    with ThreadPoolExecutor(1) as pool:
        stepping = pool.submit(server.http.post, "/api/v1/step", json={"ticks": 5000})
        server.wait_for(lambda state: state["time_s"] > before_s)
        server.http.post("/api/v1/run", json={"state": "paused"}).raise_for_status()
        cut_short = stepping.result(30.0)
    assert cut_short.status_code == 409 and "set paused" in cut_short.json()["detail"]
    stopped_s = server.state()["time_s"]
    assert stopped_s < before_s + 10.0
    assert server.http.post("/api/v1/step", json={"ticks": 5}).json()["time_s"] == pytest.approx(stopped_s + 0.01)


def test_a_step_while_running_is_refused_with_what_to_do(server: RunningServer) -> None:
    refused = server.http.post("/api/v1/step", json={"ticks": 1})
    assert refused.status_code == 409
    assert "paused" in refused.json()["detail"]


@pytest.mark.parametrize("body", [None, {}, {"seed": 3}, {"seed": 3, "keyframe": "stand"}])
def test_reset_goes_back_to_time_zero_and_the_default_command(server: RunningServer, body: dict | None) -> None:
    server.http.patch("/api/v1/command", json={"base_velocity": [0.3, 0, 0]})
    server.http.post("/api/v1/run", json={"state": "paused"})
    assert server.http.post("/api/v1/reset", json=body).status_code == 200
    assert server.state()["time_s"] == pytest.approx(TICK_S)
    assert server.http.get("/api/v1/command").json()["base_velocity"] == [0.0, 0.0, 0.0]


def test_the_same_calls_after_a_reset_give_the_same_bytes_whatever_came_before(server: RunningServer) -> None:
    def story() -> dict:
        for method, path, body in (
            ("POST", "run", {"state": "paused"}),
            ("POST", "reset", {"seed": 7}),
            ("POST", "step", {"ticks": 249}),
            ("PATCH", "command", {"base_velocity": [0.3, 0, 0.2], "mask": [0, 0, 1], "force_n": [0, 0, 6]}),
            ("POST", "step", {"ticks": 500}),
        ):
            strict(server.http.request(method, f"/api/v1/{path}", json=body))
        return {name: server.state()[name] for name in ("time_s", "joints", "base", "end_effector", "applied_command")}

    first = story()
    server.http.patch("/api/v1/command", json={"guidance": True}).raise_for_status()
    server.http.post("/api/v1/run", json={"state": "running"}).raise_for_status()
    server.wait_for(lambda state: state["time_s"] > first["time_s"] + 0.5)
    assert story() == first
    assert story() == first


def test_scenes_change_and_come_back(server: RunningServer) -> None:
    scenes = strict(server.http.get("/api/v1/scene"))
    assert scenes["name"] in scenes["available"]
    for name in (scenes["available"][-1], "free"):
        assert strict(server.http.put("/api/v1/scene", json={"name": name}))["name"] == name
        assert server.state()["scene"] == name


def test_mismatch_changes_the_robot_and_not_the_estimate(server: RunningServer) -> None:
    changed = strict(server.http.put("/api/v1/mismatch", json={"mass_scale": 1.2, "per_link": {"base": 1.1}}))
    assert changed["mass_scale"] == 1.2
    assert changed["per_link"] == {"base": 1.1}
    assert changed["mass_scale_true"] > 1.2
    assert strict(server.http.get("/api/v1/mismatch")) == changed


def test_estimators_are_listed_with_their_live_errors_and_chosen_with_gains(server: RunningServer) -> None:
    server.wait_for(lambda state: state["time_s"] > 0.2)
    listed = strict(server.http.get("/api/v1/estimator"))
    assert {entry["name"] for entry in listed["available"]} >= {"gmo_pi", "gmo_cqp", "adaptive"}
    assert all(entry["error_rms_n"] >= 0.0 for entry in listed["available"])
    chosen = strict(server.http.put("/api/v1/estimator", json={"name": "gmo_cqp", "gains": {"k1": 7.0, "k2": 21.0}}))
    assert chosen["name"] == "gmo_cqp"
    assert chosen["gains"] == {"k1": 7.0, "k2": 21.0}
    assert server.state()["estimator"] == "gmo_cqp"
    assert strict(server.http.put("/api/v1/estimator", json={"name": "adaptive"}))["name"] == "adaptive"


def test_the_controller_is_listed_and_chosen(server: RunningServer) -> None:
    assert strict(server.http.put("/api/v1/controller", json={"name": "model_based"}))["name"] == "model_based"
    assert "model_based" in strict(server.http.get("/api/v1/controller"))["available"]


def test_without_its_extra_the_hardware_backend_says_how_to_get_it(
    server: RunningServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(operator, "unavailable_because", lambda: INSTALL_HINT)
    listed = strict(server.http.get("/api/v1/backend"))
    assert (listed["name"], listed["options"]) == ("simulation", {})
    assert [entry["name"] for entry in listed["available"]] == ["simulation", "hardware", "replay"]
    refused = server.http.put("/api/v1/backend", json={"name": "hardware", "options": {}})
    assert refused.status_code == 409
    assert "pip install 'forcelens[hardware]'" in refused.json()["detail"]
    assert strict(server.http.put("/api/v1/backend", json={"name": "simulation"}))["name"] == "simulation"


@pytest.mark.parametrize("options", [{"domain": 0}, {"interface": "eth0"}, {"arm_host": "192.168.123.220"}, {}])
def test_what_the_command_line_did_not_permit_no_call_permits(server: RunningServer, options: dict) -> None:
    pid = server.operator.client.pid
    body = {"name": "hardware", "options": {"allow_robot": True, **options}}
    refused = server.http.put("/api/v1/backend", json=body)
    assert refused.status_code == 409
    assert "--allow-robot" in refused.json()["detail"]
    assert server.operator.client.pid == pid
    assert strict(server.http.get("/api/v1/backend"))["name"] == "simulation"


def test_what_the_command_line_permits_a_call_may_ask_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(operator, "unavailable_because", lambda: "this is a test")  # asked after the options
    permitted = with_options(HardwareConfig(), {"allow_robot": True})
    console = operator.Operator(ControlClient(ControlLaunch()), ControlLaunch(), permitted)
    with pytest.raises(RefusedError, match="this is a test"):
        console.set_backend("hardware", allow_robot=True, domain=0)


def test_a_simulated_robot_has_no_drives_to_engage(server: RunningServer) -> None:
    for refused in (server.http.get("/api/v1/hardware"), server.http.post("/api/v1/hardware", json={"request": "engage"})):
        assert refused.status_code == 409
        assert "PUT /api/v1/backend" in refused.json()["detail"]
    assert server.state()["drive"] is None


def test_a_wrench_is_listed_felt_and_ended(server: RunningServer) -> None:
    body = {"force_n": [0, 0, -15], "frame": "heading", "duration_s": 60.0, "ramp_s": 0.1}
    created = server.http.post("/api/v1/wrenches", json=body)
    assert created.status_code == 201
    key = created.json()["id"]
    listed = strict(server.http.get("/api/v1/wrenches"))
    assert [(item["id"], item["force_n"], item["body"]) for item in listed] == [(key, [0.0, 0.0, -15.0], "end_effector")]
    server.wait_for(lambda state: abs(state["end_effector"]["force_true_n"][2] + 15.0) < 0.5)
    assert server.http.delete(f"/api/v1/wrenches/{key}").status_code == 204
    assert strict(server.http.get("/api/v1/wrenches")) == []
    assert server.http.delete(f"/api/v1/wrenches/{key}").status_code == 404


def test_wrenches_expire_by_themselves(server: RunningServer) -> None:
    server.http.post("/api/v1/run", json={"state": "paused"})
    server.http.post("/api/v1/wrenches", json={"force_n": [5, 0, 0], "frame": "world", "duration_s": 0.02})
    server.http.post("/api/v1/step", json={"ticks": 5})
    assert len(strict(server.http.get("/api/v1/wrenches"))) == 1
    server.http.post("/api/v1/step", json={"ticks": 8})
    assert strict(server.http.get("/api/v1/wrenches")) == []


def test_a_simulation_that_diverges_is_no_healthy_one_until_its_reset(server: RunningServer) -> None:
    for _ in range(40):
        body = {"force_n": [200, 0, 200], "frame": "world", "duration_s": 60.0}
        server.http.post("/api/v1/wrenches", json=body).raise_for_status()
    state = server.wait_for(lambda state: state["failure"] is not None)
    assert state["mode"] == "fault" and "BACKEND_FAILED" in state["faults"]
    health = server.http.get("/api/v1/health")
    assert (health.status_code, health.json()["status"]) == (503, "failed")
    assert "reset" in health.json()["reason"]
    server.http.post("/api/v1/reset").raise_for_status()
    state = server.wait_for(lambda state: state["mode"] == "running")
    assert state["failure"] is None and "BACKEND_FAILED" not in state["faults"]
    assert server.http.get("/api/v1/health").json()["status"] == "ok"


def test_estop_latches_survives_everything_but_its_clearing_and_forbids_commands(server: RunningServer) -> None:
    server.http.patch("/api/v1/command", json={"base_velocity": [0.2, 0, 0]})
    assert strict(server.http.post("/api/v1/estop")) == {"latched": True, "mode": "estop"}
    assert server.state()["mode"] == "estop"
    refused = server.http.patch("/api/v1/command", json={"base_velocity": [0.1, 0, 0]})
    assert refused.status_code == 409
    assert "estop/clear" in refused.json()["detail"]
    for path, body in (("reset", {}), ("run", {"state": "paused"}), ("run", {"state": "running"}), ("estop", None)):
        assert server.http.post(f"/api/v1/{path}", json=body).is_success
        assert server.state()["mode"] == "estop"
    assert strict(server.http.post("/api/v1/estop/clear"))["latched"] is False
    assert server.http.get("/api/v1/command").json()["base_velocity"] == [0.0, 0.0, 0.0]
    server.wait_for(lambda state: state["mode"] == "running")


def test_estop_works_while_paused_and_reports_the_latch(server: RunningServer) -> None:
    server.http.post("/api/v1/run", json={"state": "paused"})
    stopped = server.state()["time_s"]
    assert strict(server.http.post("/api/v1/estop")) == {"latched": True, "mode": "estop"}
    state = server.state()
    assert (state["mode"], state["time_s"]) == ("estop", stopped)


def test_restart_of_a_living_process_needs_force(server: RunningServer) -> None:
    refused = server.http.post("/api/v1/control/restart")
    assert refused.status_code == 409
    assert "force" in refused.json()["detail"]


def test_the_page_and_the_documentation_are_served(server: RunningServer) -> None:
    for path in ("/", "/docs", "/viser/"):
        response = server.http.get(path)
        assert response.status_code == 200
        assert response.headers["content-type"].startswith("text/html")
    assert server.http.get("/viser/").headers["content-encoding"] == "gzip"
    assert "content-encoding" not in server.http.get("/viser/", headers={"Accept-Encoding": "identity"}).headers
