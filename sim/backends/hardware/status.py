"""What people see of a robot and its link, read from the I/O process's record."""

from dataclasses import dataclass

import numpy as np

from control.joints import JOINT_COUNT, JOINT_NAMES
from sim.backends.hardware.states import DriveState, Trip, describe


@dataclass(frozen=True, slots=True)
class MotorHealth:
    """One row of the health table, NaN and None before the motor was heard. The arm does not count what is `lost`: None."""

    name: str
    temperature_c: float
    torque_nm: float
    lost: int | None


@dataclass(frozen=True, slots=True)
class HardwareStatus:
    """What a page shows of the robot and its link.

    Attributes:
        state: of the drives.
        faults, warnings: in words.
        message: last refusal, failure or fault.
        engaging, progress: release and self-test, or a motion, under way; 0 to 1.
        dry_run: nothing is sent.
        request_sequence, refused: of the last request that was handled.
        io_age_s, base_age_s, arm_age_s: of the newest report of the I/O process, and of the newest states of base and arm.
        battery_percent, battery_v: as the base reports; None and NaN before it was heard.
        motors: 22 rows.
        states_received, states_missed, bad_messages, frames_sent, foreign_writers: counters of the link.
        worst_period_ms: longest time between two ticks of the I/O process in the last second.
        tick_work_ms: from the arrival of a state to the command on the network.
        realtime_scheduling: SCHED_FIFO was granted to it.
    """

    state: DriveState
    faults: tuple[str, ...]
    warnings: tuple[str, ...]
    message: str
    engaging: bool
    progress: float
    dry_run: bool
    request_sequence: int
    refused: bool
    io_age_s: float
    base_age_s: float
    arm_age_s: float
    battery_percent: int | None
    battery_v: float
    motors: tuple[MotorHealth, ...]
    states_received: int
    states_missed: int
    bad_messages: int
    frames_sent: int
    foreign_writers: int
    worst_period_ms: float
    tick_work_ms: float
    realtime_scheduling: bool


def status_from_record(record: np.void, now: float) -> HardwareStatus:
    """HardwareStatus of an IO_STATE record at monotonic time `now`."""
    heard = bool(np.isfinite(record["battery_percent"]))
    lost = [int(value) if heard else None for value in record["lost"]] + [None] * (JOINT_COUNT - 16)
    motors = zip(JOINT_NAMES, record["temperature"], record["sensors"][-JOINT_COUNT:], lost, strict=True)
    return HardwareStatus(
        state=DriveState(int(record["state"])),
        faults=tuple(describe(Trip(int(record["faults"])), int(record["fault_joints"]))),
        warnings=tuple(describe(Trip(int(record["warnings"])))),
        message=bytes(record["message"]).decode(errors="replace"),
        engaging=bool(record["engaging"]),
        progress=float(record["progress"]),
        dry_run=bool(record["dry_run"]),
        request_sequence=int(record["request_sequence"]),
        refused=bool(record["refused"]),
        io_age_s=now - float(record["time_s"]),
        base_age_s=now - float(record["base_received_s"]),
        arm_age_s=now - float(record["arm_received_s"]),
        battery_percent=int(record["battery_percent"]) if heard else None,
        battery_v=float(record["battery_v"]),
        motors=tuple(MotorHealth(name, float(t), float(torque), count) for name, t, torque, count in motors),
        states_received=int(record["states_received"]),
        states_missed=int(record["states_missed"]),
        bad_messages=int(record["bad_messages"]),
        frames_sent=int(record["frames_sent"]),
        foreign_writers=int(record["foreign_writers"]),
        worst_period_ms=float(record["worst_period_ms"]),
        tick_work_ms=float(record["tick_work_ms"]),
        realtime_scheduling=bool(record["realtime_scheduling"]),
    )
