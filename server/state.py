"""A SNAPSHOT record as the JSON object of `GET /api/v1/state` and the stream, section by section.

server.answers.state tells what each section means. What is not available is null, never NaN and never zero.
"""

import math
from collections.abc import Callable, Iterable
from typing import Any

import msgspec
import numpy as np

from control.joints import JOINT_NAMES, LEGS
from control.types import Command
from server.answers.command import CommandAnswer, CommandFields
from server.answers.state import Base, Contact, CurrentRecording, Drive, EndEffector, Joints, Loop, Odometry, TaskState
from server.answers.tasks import OutcomeName
from server.silence import NO_SILENCE, Silence
from sim.backends.hardware.states import DriveState
from sim.runtime.fault_words import SILENCE_WORDS, drive_fault_words, estimator_flags, fault_words, message
from sim.runtime.snapshot import Mode, named, on_hardware

_OUTCOMES: tuple[OutcomeName | None, ...] = (None, "succeeded", "failed", "aborted")
"""As sim.tasks.runner.Outcome counts them."""


def _vector(values: np.ndarray) -> list[float] | None:
    items = values.tolist()
    return items if all(map(math.isfinite, items)) else None


def _number(value: Any) -> float | None:
    return float(value) if math.isfinite(value) else None


def failure(record: np.void) -> str | None:
    """Why the backend steps no more, with the cure; None while it does."""
    return record["failure"].decode(errors="replace") or None


def faults(record: np.void) -> list[str]:
    """Names of what is wrong: with the backend, as the safety gate reports, and with the loop's rate."""
    return list(fault_words(record))


def command_fields(record: np.void) -> CommandFields:
    """A COMMAND record as the state shows it."""
    return {
        "mask": record["mask"].tolist(),
        "force_n": record["force_n"].tolist(),
        "position_m": record["position_m"].tolist(),
        "orientation_wxyz": record["orientation_wxyz"].tolist(),
        "base_velocity": record["base_velocity"].tolist(),
        "guidance": bool(record["guidance"]),
    }


def command_json(command: Command, sequence: int) -> CommandAnswer:
    """A command and its sequence number as the answer of `/api/v1/command`."""
    return {
        "mask": [1 if item else 0 for item in command.mask],
        "force_n": command.force_n.tolist(),
        "position_m": command.position_m.tolist(),
        "orientation_wxyz": command.orientation_wxyz.tolist(),
        "base_velocity": command.base_velocity.tolist(),
        "guidance": command.guidance,
        "sequence": sequence,
    }


def _base(record: np.void) -> Base:
    return {
        "position_m": _vector(record["base_position"]),
        "orientation_wxyz": _vector(record["base_orientation_wxyz"]),
        "linear_velocity_mps": _vector(record["base_linear_velocity"]),
        "angular_velocity_rps": _vector(record["base_angular_velocity"]),
    }


def _odometry(record: np.void) -> Odometry:
    return {
        "position_m": record["odometry_position"].tolist(),
        "yaw_rad": float(record["odometry_yaw"]),
        "sigma_m": float(record["odometry_sigma"]),
    }


def _joints(record: np.void) -> Joints:
    return {
        "names": list(JOINT_NAMES),
        "position": record["joint_position"].tolist(),
        "velocity": record["joint_velocity"].tolist(),
        "torque": record["joint_torque"].tolist(),
    }


def _estimators(record: np.void) -> Iterable[tuple[str, int]]:
    return ((name.decode(), index) for index, name in enumerate(record["estimator_names"]) if name)


def _end_effector(record: np.void) -> EndEffector:
    return {
        "position_m": _vector(record["end_effector_position"]),
        "orientation_wxyz": _vector(record["end_effector_orientation_wxyz"]),
        "force_estimated_n": _vector(record["force_estimated_n"]),
        "force_estimates_n": {name: _vector(record["force_estimates_n"][index]) for name, index in _estimators(record)},
        "force_of_controller_n": _vector(record["force_of_controller_n"]),
        "force_true_n": _vector(record["force_true_n"]),
        "force_sigma_n": _vector(record["force_sigma_n"]),
    }


def _contacts(record: np.void) -> list[Contact]:
    return [
        {
            "wheel": leg,
            "in_contact": bool(record["wheel_in_contact"][index]),
            "force_estimated_n": _vector(record["wheel_force_estimated_n"][index]),
            "force_true_n": _vector(record["wheel_force_true_n"][index]),
        }
        for index, leg in enumerate(LEGS)
    ]


def _drive(record: np.void) -> Drive | None:
    """State of a robot's drives; None in simulation."""
    if not on_hardware(record):
        return None
    return {
        "state": DriveState(int(record["drive_state"])).name.lower(),
        "faults": drive_fault_words(record),
        "dry_run": bool(record["dry_run"]),
    }


def _recording(record: np.void) -> CurrentRecording | None:
    if not record["recording"]:
        return None
    return {
        "id": record["recording"].decode(),
        "duration_s": float(record["recording_s"]),
        "size_bytes": int(record["recording_bytes"]),
    }


def loop_json(record: np.void) -> Loop:
    """How the control loop keeps time."""
    return {
        "rate_hz": float(record["loop_rate_hz"]),
        "real_time_factor": float(record["real_time_factor"]),
        "overruns": int(record["overruns"]),
        "overruns_last_minute": int(record["overruns_last_minute"]),
        "overrun_share": float(record["overrun_share"]),
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


def _task(record: np.void) -> TaskState | None:
    """The task that was begun last; None before the first."""
    if record["task_id"] == 0:
        return None
    return {
        "id": int(record["task_id"]),
        "name": record["task_name"].decode(),
        "phase": record["task_phase"].decode(),
        "progress": float(record["task_progress"]),
        "outcome": _OUTCOMES[int(record["task_outcome"])],
        "in_charge": bool(record["task_in_charge"]),
    }


SECTIONS: dict[str, Callable[[np.void], Any]] = {
    "time_s": lambda record: float(record["time_s"]),
    "wall_time_s": lambda record: float(record["wall_time_s"]),
    "sequence": lambda record: int(record["sequence"]),
    "stale_s": lambda _: 0.0,
    "mode": lambda record: Mode(int(record["mode"])).name.lower(),
    "faults": faults,
    "fault_words": fault_words,
    "message": message,
    "failure": failure,
    "backend": lambda record: record["backend"].decode(),
    "drive": _drive,
    "scene": lambda record: record["scene"].decode(),
    "controller": lambda record: record["controller"].decode(),
    "estimator": lambda record: record["estimator"].decode(),
    "command_sequence": lambda record: int(record["command_sequence"]),
    "command": lambda record: command_fields(record["command"]),
    "applied_command": lambda record: command_fields(record["applied_command"]),
    "base": _base,
    "odometry": _odometry,
    "joints": _joints,
    "end_effector": _end_effector,
    "contacts": _contacts,
    "mass_scale_estimated": lambda record: _number(record["mass_scale_estimated"]),
    "mass_scale_true": lambda record: _number(record["mass_scale_true"]),
    "mass_adapting": lambda record: bool(record["mass_adapting"]),
    "estimator_flags": lambda record: [str(flag.name) for flag in estimator_flags(record)],
    "readings": lambda record: {name: _number(value) for name, value in named(record, "reading").items()},
    "task": _task,
    "recording": _recording,
    "loop": loop_json,
}
ALWAYS = ("sequence", "time_s", "mode", "faults")
"""Sections that every stream carries, so that a reader can see skips and stops."""


def state_json(record: np.void, fields: Iterable[str] = SECTIONS, *, silence: Silence = NO_SILENCE) -> dict[str, Any]:
    """The chosen sections of a snapshot; of a silent control process it is the last one, marked as a fault."""
    state = {name: SECTIONS[name](record) for name in fields}
    if "stale_s" in state:
        state["stale_s"] = silence.stale_s
    if silence.fault is not None:
        if "mode" in state:
            state["mode"] = Mode.FAULT.name.lower()
        if "faults" in state:
            state["faults"] = [*state["faults"], silence.fault]
        if "fault_words" in state:
            state["fault_words"] |= {silence.fault: SILENCE_WORDS[silence.fault]}
        if "message" in state:
            state["message"] = SILENCE_WORDS[silence.fault]
        if "loop" in state:
            state["loop"] |= {"rate_hz": 0.0, "real_time_factor": 0.0}
    return state


def encode(value: Any) -> bytes:
    """JSON bytes; what is not finite becomes null."""
    return msgspec.json.encode(value)
