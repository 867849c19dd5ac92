"""The robot's drives and its link, while the backend is hardware."""

from fastapi import APIRouter, Response

from server.answers.hardware import HardwareAnswer
from server.dependencies import TheOperator
from server.responses import json_response, refusals
from server.schemas import DriveRequest
from sim.backends.hardware.backend import HONESTY
from sim.backends.hardware.states import allowed_requests
from sim.backends.hardware.status import HardwareStatus

router = APIRouter(prefix="/api/v1/hardware", tags=["hardware"])


@router.get("", response_model=HardwareAnswer, responses=refusals(409))
def get_hardware(operator: TheOperator) -> Response:
    """Drives, faults, battery, motors and link. `latency_ms` is from a state's arrival to the command on the network."""
    return json_response(hardware_json(operator.robot.require()))


@router.post("", response_model=HardwareAnswer, responses=refusals(409, 413, 422, 503))
def request_drive(body: DriveRequest, operator: TheOperator) -> Response:
    """Ask the drives for a change of state; answers once it has begun. 409 where the present state forbids it."""
    return json_response(hardware_json(operator.drive(body.request)))


def hardware_json(status: HardwareStatus) -> HardwareAnswer:
    """As `GET /api/v1/hardware` answers; what was never heard is null."""
    return {
        "state": status.state.name.lower(),
        "requests": allowed_requests(status.state),
        "engaging": status.engaging,
        "progress": status.progress,
        "dry_run": status.dry_run,
        "verified": HONESTY,
        "faults": list(status.faults),
        "warnings": list(status.warnings),
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
        "motors": [
            {
                "name": motor.name,
                "temperature_c": motor.temperature_c,
                "torque_nm": motor.torque_nm,
                "lost": motor.lost,
            }
            for motor in status.motors
        ],
    }
