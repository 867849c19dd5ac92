"""What a recording's channels hold, made from what the tap gives: protobuf with named fields, of constant length."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from control.joints import JOINT_COUNT
from control.timing import MOST_ESTIMATORS, TICK_S
from sim.recording.wire import SINGLE, VECTOR, Kind, Wire
from sim.runtime.snapshot import COMMAND, SNAPSHOT

TICK_NS = round(TICK_S * 1e9)
"""Between the time stamps of two ticks."""

_COMMAND_FIELDS: dict[str, Kind] = {name: COMMAND[name].shape[0] if COMMAND[name].shape else 1 for name in COMMAND.names or ()}

SENSORS = Wire(
    "Sensors",
    {
        "time_s": 1,
        "orientation_wxyz": 4,
        "angular_velocity": VECTOR,
        "linear_acceleration": VECTOR,
        "joint_position": JOINT_COUNT,
        "joint_velocity": JOINT_COUNT,
        "joint_torque": JOINT_COUNT,
    },
)
"""What the pipeline saw at a tick: control.types.SensorFrame."""

INPUTS = Wire("Inputs", {"session_time_s": 1, "command_age_s": 1, "applied_mask": 3, **_COMMAND_FIELDS})
"""What the pipeline was asked at a tick, resolved: a command whose operator had fallen silent has no base velocity."""

TARGETS = Wire("JointTargets", {"position": JOINT_COUNT, "velocity": JOINT_COUNT})
"""What the drives were sent at a tick."""

TRUTH = Wire("Truth", {"force_n": VECTOR, "base_position": VECTOR, "base_orientation_wxyz": 4, "wheel_forces": 12})
"""What the simulator knows; no message without a simulator."""


def estimates_wire(names: Sequence[str]) -> Wire:
    """Force of each estimator in heading, N, and the standard deviation of the one that feeds the controller."""
    return Wire("Estimates", {**dict.fromkeys(names, VECTOR), "sigma": VECTOR})


def _flat(dtype: np.dtype, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], np.dtype]]:
    for name in dtype.names or ():
        if dtype[name].names:
            yield from _flat(dtype[name], (*path, name))
        else:
            yield (*path, name), dtype[name]


def _kind(dtype: np.dtype) -> Kind:
    count = int(np.prod(dtype.shape, dtype=int))
    if dtype.base == np.float32:
        return f"{SINGLE}{count}"
    return f"S{count * dtype.base.itemsize}" if dtype.base.kind == "S" else count


_SNAPSHOT_FIELDS = tuple(_flat(SNAPSHOT))
STATE = Wire("State", {"_".join(path): _kind(dtype) for path, dtype in _SNAPSHOT_FIELDS})
"""A whole snapshot (sim.runtime.snapshot), whole numbers and flags as doubles, nested names joined by an underscore."""


def write_ticks(ticks: np.ndarray, sensors: np.ndarray, inputs: np.ndarray, targets: np.ndarray) -> None:
    """Columns of TICK records (n,) into message bodies (n,) of the wires above."""
    sensors["time_s"] = ticks["sensor_time_s"]
    for name in ("angular_velocity", "linear_acceleration"):
        write_vectors(ticks[name], sensors, name)
    for name in ("orientation_wxyz", "joint_position", "joint_velocity", "joint_torque"):
        sensors[name] = ticks[name]
    inputs["session_time_s"], inputs["command_age_s"] = ticks["time_s"], ticks["command_age_s"]
    inputs["applied_mask"] = ticks["applied_mask"]
    for name in COMMAND.names or ():
        inputs[name] = ticks["command"][name]
    targets["position"], targets["velocity"] = ticks["target_position"], ticks["target_velocity"]


def write_estimates(ticks: np.ndarray, names: Sequence[str], bodies: np.ndarray) -> None:
    """Estimates of TICK records (n,) into message bodies (n,)."""
    for index, name in enumerate(names):
        write_vectors(ticks["estimates_n"][:, index], bodies, name)
    write_vectors(ticks["sigma_n"], bodies, "sigma")


def write_vectors(values: np.ndarray, bodies: np.ndarray, name: str) -> None:
    """Vectors (n, 3) into a VECTOR field of message bodies (n,)."""
    for axis in range(3):
        bodies[f"{name}.{'xyz'[axis]}"] = values[:, axis]


def read_vectors(bodies: np.ndarray, name: str) -> np.ndarray:
    """Vectors (n, 3) of a VECTOR field of message bodies (n,)."""
    return np.stack([bodies[f"{name}.{axis}"] for axis in "xyz"], axis=1)


def read_estimates(bodies: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """(n, MOST_ESTIMATORS, 3) as in TICK, of message bodies (n,)."""
    forces = np.full((len(bodies), MOST_ESTIMATORS, 3), np.nan)
    for index, name in enumerate(names):
        forces[:, index] = read_vectors(bodies, name)
    return forces


def write_states(snapshots: np.ndarray, bodies: np.ndarray) -> None:
    """SNAPSHOT records (n,) into message bodies (n,) of STATE."""
    for path, _ in _SNAPSHOT_FIELDS:
        column = _column(snapshots, path)
        field = "_".join(path)
        kind = STATE.fields[field]
        if isinstance(kind, str) and not kind.startswith(SINGLE):
            bodies[field] = np.ascontiguousarray(column).reshape(len(column), -1).view(kind)[:, 0]
        else:
            bodies[field] = column if kind == 1 else column.reshape(len(column), -1)


def read_states(bodies: np.ndarray) -> np.ndarray:
    """SNAPSHOT records (n,) of message bodies (n,) of STATE."""
    snapshots = np.zeros(len(bodies), SNAPSHOT)
    for path, dtype in _SNAPSHOT_FIELDS:
        column, values = _column(snapshots, path), bodies["_".join(path)]
        if dtype.base.kind == "S":
            values = np.ascontiguousarray(values).view(dtype.base)
        column[...] = values.reshape(column.shape)
    return snapshots


def write_truth(snapshots: np.ndarray, bodies: np.ndarray) -> None:
    """Truth of SNAPSHOT records (n,) into message bodies (n,) of TRUTH."""
    write_vectors(snapshots["force_true_n"], bodies, "force_n")
    write_vectors(snapshots["base_position"], bodies, "base_position")
    bodies["base_orientation_wxyz"] = snapshots["base_orientation_wxyz"]
    bodies["wheel_forces"] = snapshots["wheel_force_true_n"].reshape(len(snapshots), -1)


def _column(records: np.ndarray, path: tuple[str, ...]) -> Any:
    for name in path:
        records = records[name]
    return records
