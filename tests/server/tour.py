"""Every call that a simulation answers and how calls are refused, in an order that works."""

import time
from collections.abc import Iterator
from typing import Any

import httpx

from server.caller import LEASE_HEADER
from tests.server.contract import API

FAR_AWAY = {"Origin": "https://elsewhere.example"}


def tour(http: httpx.Client) -> Iterator[httpx.Response]:
    """The answers. What is selected at the end is what was selected before; the simulation is paused."""

    def call(method: str, path: str, body: Any = None, **options: Any) -> httpx.Response:
        return http.request(method, API + path, json=body, **options)

    def call_with_bytes(method: str, path: str, body: bytes) -> httpx.Response:
        return http.request(method, API + path, content=body, headers={"Content-Type": "application/json"})

    for name in ("health", "ready", "backend", "controller", "mismatch"):
        yield call("GET", name)
    estimator = call("GET", "estimator")
    yield estimator
    yield call("PUT", "estimator", {"name": "gmo_cqp", "gains": {"k1": 6.0, "k2": 20.0}})
    call("PUT", "estimator", {"name": estimator.json()["name"]})
    yield call("PUT", "mismatch", {"mass_scale": 1.2, "per_link": {"base": 1.1}})
    call("PUT", "mismatch", {"mass_scale": 1.0})
    yield call("PUT", "estimator/tool", {"mass_kg": 0.4, "center_of_mass_m": [0.02, 0, 0]})
    yield call("GET", "estimator/tool")
    call("PUT", "estimator/tool", {"mass_kg": 0, "center_of_mass_m": [0, 0, 0]})
    for name in ("controller", "scene"):
        selected = call("GET", name).json()["name"]
        yield call("PUT", name, {"name": selected})
        yield call("GET", name)
    yield call("PUT", "backend", {"name": "simulation"})
    yield call("POST", "reset", {"seed": 7, "keyframe": "stand"})
    yield call("POST", "run", {"state": "running", "speed": 1.0})

    while call("GET", "state").json()["time_s"] < 1.2:  # the estimate rests
        time.sleep(0.05)
    yield call("POST", "estimator/tare")
    yield call("DELETE", "estimator/tare")
    yield call("POST", "estimator/tool/identify")
    yield call("PATCH", "command", {"mask": [0, 0, 1], "force_n": [0, 0, 10]})
    yield call("GET", "command")
    wrench = call("POST", "wrenches", {"force_n": [0, 0, 10], "frame": "heading", "duration_s": 60, "ramp_s": 0.3})
    yield wrench
    while (state := call("GET", "state")).json()["time_s"] < 2.5:
        time.sleep(0.05)
    yield state
    yield call("GET", "wrenches")
    key = wrench.json()["id"]
    yield call("DELETE", f"wrenches/{key}")
    yield call("DELETE", f"wrenches/{key}")

    yield call("POST", "lease", {"operator": "Ada"})
    token = {LEASE_HEADER: http.post(f"{API}lease", json={"operator": "Grace", "take_over": True}).json()["token"]}
    yield call("GET", "lease", headers=token)
    yield call("PATCH", "command", {"guidance": True})
    yield call("DELETE", "lease", headers=token)

    yield call("GET", "tasks")
    yield call("GET", "tasks/current")
    yield call("POST", "tasks", {"name": "wipe", "options": {"force_n": 15}})
    yield call("POST", "tasks", {"name": "guidance", "options": {"lead_s": 5}})
    yield call("POST", "tasks", {"name": "guidance", "options": {}})
    yield call("POST", "tasks", {"name": "guidance", "options": {"lead_s": 50}})
    yield call("GET", "tasks/1")
    yield call("DELETE", "tasks/current")
    yield call("PATCH", "scene", {"parameters": {"spring_scale": 2.0}})
    yield call("PATCH", "scene", {"parameters": {}})

    yield call("POST", "step", {"ticks": 10})
    call("POST", "run", {"state": "paused"})
    recording = call("POST", "recordings", {"name": "push", "note": "with the new gains"})
    yield recording
    yield call("POST", "step", {"ticks": 100})
    yield call("DELETE", "recordings/current")
    yield call("DELETE", "recordings/current")
    yield call("GET", "recordings")
    key = recording.json()["id"]
    yield call("GET", f"recordings/{key}")
    yield call("GET", f"recordings/{key}/download")
    estimates = call("POST", f"recordings/{key}/estimates", {"estimator": "gmo_pi", "gains": {"k1": 12.0, "k2": 80.0}})
    yield estimates
    while (result := call("GET", f"recordings/{key}/estimates/{estimates.json()['id']}")).json()["state"] == "running":
        time.sleep(0.1)
    yield result
    yield call("GET", "replay")
    yield call("PUT", "backend", {"name": "replay", "options": {"recording": key}})
    yield call("PATCH", "replay", {"time_s": 0.1, "state": "paused"})
    yield call("GET", "replay")
    yield call("PUT", "backend", {"name": "simulation"})
    call("POST", "run", {"state": "paused"})
    yield call("DELETE", f"recordings/{key}")
    yield call("POST", "step", {"ticks": 900})
    yield call("POST", "step", {"ticks": 10})
    yield call("POST", "history/seek", {"time_s": 1.2})
    yield call("GET", "history")
    yield call("POST", "history/branch", {"time_s": 1.2, "mass_scale": 1.1})
    call("PUT", "mismatch", {"mass_scale": 1.0})
    yield call("GET", "hardware")
    yield call("POST", "hardware", {"request": "engage"})
    yield call_with_bytes("PATCH", "command", b"\xff")
    yield call_with_bytes("PATCH", "command", b"{")
    yield call("PATCH", "command", {"force_n": [0, 0, 55]})
    yield call("PATCH", "command", {"force_n": [0] * 10_000})
    yield call("POST", "estop", headers=FAR_AWAY)
    yield call("GET", "nothing")
    yield call("PUT", "state")

    yield call("POST", "estop/check")
    yield call("POST", "estop/clear")
    yield call("POST", "estop")
    yield call("PATCH", "command", {"guidance": True})
    call("POST", "estop/clear")
    yield call("POST", "control/restart", {"force": True})
