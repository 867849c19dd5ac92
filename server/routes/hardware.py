"""The robot's drives and its link, while the backend is hardware."""

from dataclasses import asdict
from typing import Any

from fastapi import APIRouter, Response

from server.dependencies import TheOperator
from server.responses import answers, json_response
from server.schemas import DriveRequest
from sim.backends.hardware.backend import HONESTY
from sim.backends.hardware.states import allowed_requests
from sim.backends.hardware.status import HardwareStatus

router = APIRouter(prefix="/api/v1/hardware", tags=["hardware"])

_STATUS = {
    "state": "damped",
    "requests": ["stand", "damp", "release"],
    "engaging": False,
    "progress": 0.0,
    "dry_run": False,
    "verified": HONESTY,
    "faults": [],
    "warnings": [],
    "message": "",
    "battery": {"percent": 80, "voltage_v": 28.6},
    "link": {
        "io_age_ms": 1.1,
        "base_age_ms": 1.2,
        "arm_age_ms": 1.2,
        "latency_ms": 0.2,
        "worst_period_ms": 2.2,
        "states_received": 5000,
        "states_missed": 0,
        "bad_messages": 0,
        "frames_sent": 3000,
        "foreign_writers": 0,
        "realtime_scheduling": True,
    },
    "motors": [{"name": "FL_hip", "temperature_c": 36.0, "torque_nm": 1.4, "lost": 0}],
}


@router.get("", responses=answers(_STATUS))
def status(operator: TheOperator) -> Response:
    """Drives, faults, battery, motors and link. `latency_ms` is from a state's arrival to the command on the network."""
    return json_response(hardware_json(operator.robot.require()))


@router.post("", responses=answers(_STATUS))
def drive(body: DriveRequest, operator: TheOperator) -> Response:
    """Ask the drives for a change of state; answers once it has begun. 409 where the present state forbids it."""
    return json_response(hardware_json(operator.robot.drive(body.request)))


def hardware_json(status: HardwareStatus) -> dict[str, Any]:
    """As `GET /api/v1/hardware` answers; what was never heard is null."""
    return {
        "state": status.state.name.lower(),
        "requests": allowed_requests(status.state),
        "engaging": status.engaging,
        "progress": status.progress,
        "dry_run": status.dry_run,
        "verified": HONESTY,
        "faults": status.faults,
        "warnings": status.warnings,
        "message": status.message,
        "battery": {"percent": status.battery_percent, "voltage_v": status.battery_v},
        "link": {
            "io_age_ms": 1e3 * status.io_age_s,
            "base_age_ms": 1e3 * status.base_age_s,
            "arm_age_ms": 1e3 * status.arm_age_s,
            "latency_ms": status.tick_work_ms,
            "worst_period_ms": status.worst_period_ms,
            "states_received": status.states_received,
            "states_missed": status.states_missed,
            "bad_messages": status.bad_messages,
            "frames_sent": status.frames_sent,
            "foreign_writers": status.foreign_writers,
            "realtime_scheduling": status.realtime_scheduling,
        },
        "motors": [asdict(motor) for motor in status.motors],
    }
