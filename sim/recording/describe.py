"""What a recording says of itself at its start: enough to show it, to run its pipeline again, and to know what made it."""

import dataclasses
import json
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from control.paths import ROBOT_MJCF, WEIGHTS_DIRECTORY
from control.provenance import commit, machine
from control.state.file import packed_state
from sim.recording.description import Description
from sim.runtime.session import Session
from sim.runtime.simulation import Simulation

_PACKAGES = ("forcelens", "numpy", "mujoco", "pin", "clarabel", "numba", "mcap")


def describe_session(session: Session[Any]) -> Description:
    """The session as it is before its next tick. Takes milliseconds."""
    pipeline = session.pipeline
    metadata = {
        "backend": session.backend.name,
        "scene": session.backend.scene if isinstance(session, Simulation) else "robot",
        "controller": pipeline.controller_name,
        "estimator": pipeline.estimator_name,
        "estimators": ",".join(pipeline.estimator_names),
        "time_s": repr(session.time_s),
        "configuration": configuration_text(pipeline.config),
    }
    if isinstance(session, Simulation):
        backend = session.backend
        metadata |= {
            "seed": str(backend.seed),
            "mass_scale": repr(backend.mismatch.mass_scale),
            "per_link": json.dumps(dict(backend.mismatch.per_link)),
            "payload_kg": repr(backend.mismatch.payload_kg),
            "payload_center_m": json.dumps(list(backend.mismatch.payload_center_m)),
            "parameters": json.dumps(dict(backend.parameters)),
        }
    return Description(metadata, pipeline.estimator_names, packed_state(pipeline))


def configuration_text(config: Any) -> str:
    """A configuration of frozen dataclasses as JSON; folders by their name alone, which differ between machines."""

    def plain(value: Any) -> Any:
        if isinstance(value, Path):
            return value.name
        return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)

    return json.dumps(dataclasses.asdict(config), default=plain, sort_keys=True)


def provenance() -> dict[str, str]:
    """Versions, commit, machine, and the hashes of the weights."""
    found = {}
    for package in _PACKAGES:
        try:
            found[f"version.{package}"] = version(package)
        except PackageNotFoundError:
            found[f"version.{package}"] = "unknown"
    for manifest in sorted(WEIGHTS_DIRECTORY.glob("*.json")):
        digest = json.loads(manifest.read_text(encoding="utf-8")).get("sha256")
        if digest:
            found[f"weights.{manifest.stem}"] = digest
    return {**found, "commit": commit(), "machine": machine()}


def standing_attachments() -> tuple[tuple[str, str, bytes], ...]:
    """What every recording carries: the robot and how a viewer is to show it."""
    layout = Path(__file__).with_name("forcelens.foxglove.json").read_bytes()
    return (
        ("robot.xml", "application/xml", Path(ROBOT_MJCF).read_bytes()),
        ("forcelens.foxglove.json", "application/json", layout),
    )
