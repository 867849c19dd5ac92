"""A SNAPSHOT record as the JSON object of `GET /api/v1/state` and the stream, section by section.

What is not available is null, never NaN and never zero.
"""

import math
from collections.abc import Callable, Iterable
from typing import Any

import msgspec
import numpy as np

from control.joints import JOINT_NAMES, LEGS
from control.types import Command
from sim.backends.hardware.states import DriveState
from sim.runtime.fault_words import (
    CONTROL_PROCESS_DEAD,
    CONTROL_PROCESS_DEAD_WORDS,
    drive_fault_words,
    fault_words,
    message,
)
from sim.runtime.snapshot import Mode, on_hardware

Json = dict[str, Any]


def _vector(values: np.ndarray) -> list[float] | None:
    items = values.tolist()
    return items if all(map(math.isfinite, items)) else None


def _number(value: Any) -> float | None:
    return float(value) if math.isfinite(value) else None


def command_fields(record: np.void) -> Json:
    """A COMMAND record as the JSON object of `GET /api/v1/command`."""
    return {
        "mask": record["mask"].tolist(),
        "force_n": record["force_n"].tolist(),
        "position_m": record["position_m"].tolist(),
        "orientation_wxyz": record["orientation_wxyz"].tolist(),
        "base_velocity": record["base_velocity"].tolist(),
        "guidance": bool(record["guidance"]),
    }


def command_json(command: Command, sequence: int) -> Json:
    """A command and its sequence number as the answer of `/api/v1/command`."""
    return {
        "mask": [int(item) for item in command.mask],
        "force_n": command.force_n.tolist(),
        "position_m": command.position_m.tolist(),
        "orientation_wxyz": command.orientation_wxyz.tolist(),
        "base_velocity": command.base_velocity.tolist(),
        "guidance": command.guidance,
        "sequence": sequence,
    }


def _base(record: np.void) -> Json:
    return {
        "position_m": _vector(record["base_position"]),
        "orientation_wxyz": _vector(record["base_orientation_wxyz"]),
        "linear_velocity_mps": _vector(record["base_linear_velocity"]),
        "angular_velocity_rps": _vector(record["base_angular_velocity"]),
    }


def _joints(record: np.void) -> Json:
    return {
        "names": JOINT_NAMES,
        "position": record["joint_position"].tolist(),
        "velocity": record["joint_velocity"].tolist(),
        "torque": record["joint_torque"].tolist(),
    }


def _estimators(record: np.void) -> Iterable[tuple[str, int]]:
    return ((name.decode(), index) for index, name in enumerate(record["estimator_names"]) if name)


def _end_effector(record: np.void) -> Json:
    return {
        "position_m": _vector(record["end_effector_position"]),
        "orientation_wxyz": _vector(record["end_effector_orientation_wxyz"]),
        "force_estimated_n": _vector(record["force_estimated_n"]),
        "force_estimates_n": {name: _vector(record["force_estimates_n"][index]) for name, index in _estimators(record)},
        "force_true_n": _vector(record["force_true_n"]),
        "force_sigma_n": _vector(record["force_sigma_n"]),
    }


def _contacts(record: np.void) -> list[Json]:
    return [
        {
            "wheel": leg,
            "in_contact": bool(record["wheel_in_contact"][index]),
            "force_estimated_n": _vector(record["wheel_force_estimated_n"][index]),
            "force_true_n": _vector(record["wheel_force_true_n"][index]),
        }
        for index, leg in enumerate(LEGS)
    ]


def _drive(record: np.void) -> Json | None:
    """State of a robot's drives; None in simulation."""
    if not on_hardware(record):
        return None
    return {
        "state": DriveState(int(record["drive_state"])).name.lower(),
        "faults": drive_fault_words(record),
        "dry_run": bool(record["dry_run"]),
    }


def loop_json(record: np.void) -> Json:
    """How the control loop keeps time."""
    return {
        "rate_hz": float(record["loop_rate_hz"]),
        "real_time_factor": float(record["real_time_factor"]),
        "overruns": int(record["overruns"]),
        "lateness_p99_ms": float(record["lateness_p99_ms"]),
        "tick_median_us": float(record["tick_median_us"]),
        "rebases": int(record["rebases"]),
        "held_s": float(record["held_s"]),
        "realtime_scheduling": bool(record["realtime_scheduling"]),
        "speed": float(record["speed"]),
    }


def estimator_errors(record: np.void) -> dict[str, float | None]:
    """Live RMS error of every estimator against truth, N; None where there is no truth."""
    return {name: _number(record["force_errors_rms_n"][index]) for name, index in _estimators(record)}


SECTIONS: dict[str, Callable[[np.void], Any]] = {
    "time_s": lambda record: float(record["time_s"]),
    "wall_time_s": lambda record: float(record["wall_time_s"]),
    "sequence": lambda record: int(record["sequence"]),
    "mode": lambda record: Mode(int(record["mode"])).name.lower(),
    "faults": lambda record: list(fault_words(record)),
    "fault_words": fault_words,
    "message": message,
    "backend": lambda record: record["backend"].decode(),
    "drive": _drive,
    "scene": lambda record: record["scene"].decode(),
    "controller": lambda record: record["controller"].decode(),
    "estimator": lambda record: record["estimator"].decode(),
    "command_sequence": lambda record: int(record["command_sequence"]),
    "command": lambda record: command_fields(record["command"]),
    "applied_command": lambda record: command_fields(record["applied_command"]),
    "base": _base,
    "joints": _joints,
    "end_effector": _end_effector,
    "contacts": _contacts,
    "mass_scale_estimated": lambda record: _number(record["mass_scale_estimated"]),
    "mass_scale_true": lambda record: _number(record["mass_scale_true"]),
    "loop": loop_json,
}
ALWAYS = ("sequence", "time_s", "mode", "faults")
"""Sections that every stream carries, so that a reader can see skips and stops."""


def state_json(record: np.void, fields: Iterable[str] = SECTIONS, *, alive: bool = True) -> Json:
    """The chosen sections of a snapshot; of a dead control process it is the last one, marked as a fault."""
    state = {name: SECTIONS[name](record) for name in fields}
    if not alive:
        if "mode" in state:
            state["mode"] = Mode.FAULT.name.lower()
        if "faults" in state:
            state["faults"] = [*state["faults"], CONTROL_PROCESS_DEAD]
        if "fault_words" in state:
            state["fault_words"] |= {CONTROL_PROCESS_DEAD: CONTROL_PROCESS_DEAD_WORDS}
        if "message" in state:
            state["message"] = CONTROL_PROCESS_DEAD_WORDS
        if "loop" in state:
            state["loop"] |= {"rate_hz": 0.0, "real_time_factor": 0.0}
    return state


def encode(value: Any) -> bytes:
    """JSON bytes; what is not finite becomes null."""
    return msgspec.json.encode(value)
