"""Recorded rollouts on disk: one npz file each, and manifest.json that names them, their split and where they came from."""

import json
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from control.estimation.networks.force_signals import SIGNALS, derive
from control.files import replacing, write_whole

SCHEMA = 1
SPLITS = ("train", "validation", "test")
SETTLE_STEPS = 50
"""Steps at the start of a rollout, 1 s, that no metric counts: the observers settle."""

MEASURED = {
    "joint_position": 22,
    "joint_velocity": 22,
    "joint_torque": 22,
    "gravity_in_base": 3,
    "angular_velocity": 3,
    "linear_acceleration": 3,
    "linear_velocity": 3,
    "mask": 3,
}
NOMINAL = {"force": 3, "wheel_forces": 12, "residual": 28, "unexplained": 28, "mass_scale": 2}
NOMINAL_ESTIMATORS = ("gmo_cqp", "adaptive")
TRUTH = {"force_true_n": 3, "wheel_forces_true": 12, "linear_velocity_true": 3}


_AGAIN = "run the collection again with the same arguments, it fills the gap"
_DAMAGE = (zipfile.BadZipFile, zlib.error, EOFError, ValueError)
"""What a file that was written half-way, or changed, raises when it is read."""


class DatasetError(ValueError):
    """A data set cannot be used; the message names the file and the cure."""


@dataclass(frozen=True, slots=True)
class Rollout:
    """One rollout at 50 Hz.

    Attributes:
        info: its entry in the manifest: file, split, seed, profile, mass_scale, per_link, ...
        arrays: (T, n) float32 by name: MEASURED, TRUTH, and "ESTIMATOR.QUANTITY" for NOMINAL of each nominal estimator.
    """

    info: dict[str, Any]
    arrays: dict[str, np.ndarray]

    @property
    def force_true_n(self) -> np.ndarray:
        """(T, 3) N, in heading."""
        return self.arrays["force_true_n"]

    def signals(self, nominal: str) -> np.ndarray:
        """SIGNALS (T,) of all steps, with the nominal quantities of one estimator."""
        signals = np.zeros(len(self.force_true_n), SIGNALS)
        for name in MEASURED:
            signals[name] = self.arrays[name]
        for quantity in NOMINAL:
            signals[f"nominal_{quantity}"] = self.arrays[f"{nominal}.{quantity}"]
        derive(signals)
        return signals


def column_sizes() -> dict[str, int]:
    """Columns of every array of a rollout file."""
    nominal = {f"{name}.{quantity}": size for name in NOMINAL_ESTIMATORS for quantity, size in NOMINAL.items()}
    return {**MEASURED, **TRUTH, **nominal}


def save_rollout(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Write one rollout; the file appears complete or not at all.

    Raises:
        DatasetError: an array is missing, has other columns than `column_sizes` says, or is not finite.
    """
    for name, columns in column_sizes().items():
        if name not in arrays or arrays[name].ndim != 2 or arrays[name].shape[1] != columns:
            raise DatasetError(f"{path}: array {name!r} must have {columns} columns")
        if not np.isfinite(arrays[name]).all():
            raise DatasetError(f"{path}: array {name!r} is not finite; reject the rollout")
    single = {name: arrays[name].astype(np.float32) for name in column_sizes()}
    with replacing(path) as partial:
        np.savez_compressed(partial, allow_pickle=False, **single)


def is_whole_rollout(path: Path) -> bool:
    """Whether the file is there, and every byte of its arrays is as it was written."""
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.testzip() is None and {f"{name}.npy" for name in column_sizes()} <= set(archive.namelist())
    except (FileNotFoundError, *_DAMAGE):
        return False


def write_manifest(directory: Path, content: dict[str, Any]) -> None:
    """Write manifest.json with the schema added; the file appears complete or not at all."""
    write_whole(directory / "manifest.json", json.dumps({"schema": SCHEMA, **content}, indent=1) + "\n")


def read_manifest(directory: Path) -> dict[str, Any]:
    """The manifest of a data set.

    Raises:
        DatasetError: there is none, it is damaged, or it has another schema.
    """
    path = directory / "manifest.json"
    if not path.is_file():
        raise DatasetError(f"{path} is missing; collect data with `python -m sim.collect_dataset --output {directory}`")
    try:
        content = json.loads(path.read_text())
    except ValueError:
        raise DatasetError(f"{path} is damaged; {_AGAIN}") from None
    if content.get("schema") != SCHEMA:
        raise DatasetError(f"{path} has schema {content.get('schema')}, this code reads {SCHEMA}; collect the data again")
    return content


def load_split(directory: Path, split: str) -> list[Rollout]:
    """All rollouts of one split, in the manifest's order.

    Raises:
        DatasetError: no such split, no rollout in it, or a file is missing or damaged.
    """
    entries = [entry for entry in read_manifest(directory)["rollouts"] if entry["split"] == split]
    if not entries:
        raise DatasetError(f"{directory} has no {split!r} rollouts; the splits are {', '.join(SPLITS)}")
    return [Rollout(entry, _load(directory / entry["file"])) for entry in entries]


def _load(path: Path) -> dict[str, np.ndarray]:
    if not path.is_file():
        raise DatasetError(f"{path} is missing; {_AGAIN}")
    try:
        with np.load(path) as archive:
            return {name: archive[name] for name in archive.files}
    except _DAMAGE:
        raise DatasetError(f"{path} is damaged; {_AGAIN}") from None
