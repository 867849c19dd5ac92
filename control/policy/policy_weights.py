"""Trained policies on disk: NAME.npz holds the actor, NAME.json (the manifest) says what it expects and what it reached.

A policy runs only when its file is the one that the manifest describes, and joints, gains, scales and observation are those
of this code: a network that sees or moves other things than it was trained on is refused.
"""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from control.joints import DAMPING, JOINT_COUNT, JOINT_NAMES, NOMINAL_POSITION, STIFFNESS
from control.paths import WEIGHTS_DIRECTORY
from control.policy.action import ActionScales
from control.policy.actor import Actor
from control.policy.observation import Observation, ObservationScales
from control.timing import CONTROL_PERIOD_S
from control.weights_file import load_arrays, save_weights, sha256

SCHEMA = 1
POLICY_NAMES = ("policy", "policy_paper")
"""The best policy, and the paper's memoryless form of it."""


class PolicyWeightsError(ValueError):
    """A policy cannot be used; the message names the file, what does not fit, and the cure."""

    def __init__(self, path: Path, problem: str) -> None:
        # As arguments, so that it comes back from another process.
        super().__init__(path, problem)

    def __str__(self) -> str:
        path, problem = self.args
        return f"{path}: {problem}; restore the file, or train again with `python -m sim.train_policy`"


@dataclass(frozen=True, slots=True)
class PolicyManifest:
    """What a policy is.

    Attributes:
        name: of the controller.
        form: of the observation (control.policy.observation).
        interface: everything of this code that the network depends on, see `interface`.
        layers: sizes from observation to action.
        meets_score: scores at least as well as the model-based controller did, on the same trials: what the default needs.
        sha256: of the npz file.
        training: command, commit, seed, steps.
        metrics: the score's parts, of the policy and of the model-based controller.
    """

    name: str
    form: str
    interface: dict[str, Any]
    layers: tuple[int, ...]
    meets_score: bool = False
    sha256: str = ""
    training: dict[str, Any] = field(default_factory=dict)
    metrics: dict[str, Any] = field(default_factory=dict)


def interface(form: str) -> dict[str, Any]:
    """What a policy of this form depends on, as plain JSON values."""
    observation = Observation(form)
    return {
        "joint_names": list(JOINT_NAMES),
        "stiffness": STIFFNESS.tolist(),
        "damping": DAMPING.tolist(),
        "nominal_position": NOMINAL_POSITION.tolist(),
        "period_s": CONTROL_PERIOD_S,
        "observation": {name: part.stop - part.start for name, part in observation.groups.items()},
        "observation_scales": _plain(asdict(ObservationScales())),
        "action_scales": _plain(asdict(ActionScales())),
    }


def save_policy(directory: Path, manifest: PolicyManifest, arrays: dict[str, np.ndarray]) -> Path:
    """Write NAME.npz and NAME.json into `directory`, with the hash filled in; the manifest's path."""
    return save_weights(directory, manifest.name, {"schema": SCHEMA, **asdict(manifest)}, arrays)


def weight_files(directory: Path, name: str) -> tuple[Path, Path]:
    """Manifest and arrays of the weights `name`.

    Raises:
        PolicyWeightsError: either is missing.
    """
    path, weights = directory / f"{name}.json", directory / f"{name}.npz"
    for needed in (path, weights):
        if not needed.is_file():
            raise PolicyWeightsError(needed, "the file is missing")
    return path, weights


def require_hash(weights: Path, stated: str) -> None:
    """
    Raises:
        PolicyWeightsError: the file is not the one that its manifest states.
    """
    if sha256(weights) != stated:
        raise PolicyWeightsError(weights, f"its sha256 is not {stated[:12]}..., which the manifest states")


def require_interface(path: Path, stated: dict[str, Any], expected: dict[str, Any]) -> None:
    """
    Raises:
        PolicyWeightsError: the manifest at `path` states another interface than this code has; the message names where.
    """
    different = sorted(key for key in expected if stated.get(key) != expected[key])
    if different:
        raise PolicyWeightsError(path, f"it was trained with other {', '.join(different)} than those of this code")


def load_policy(name: str, directory: Path = WEIGHTS_DIRECTORY) -> tuple[PolicyManifest, Actor]:
    """The policy `name` of `directory`, checked against its manifest and against this code.

    Raises:
        PolicyWeightsError: a file is missing or damaged, or was made for another interface or shape.
    """
    path, weights = weight_files(directory, name)
    manifest = read_manifest(path)
    require_hash(weights, manifest.sha256)
    arrays = load_arrays(weights)
    try:
        return manifest, Actor(manifest.layers, arrays)
    except ValueError as error:
        raise PolicyWeightsError(weights, str(error)) from error


def read_manifest(path: Path) -> PolicyManifest:
    """The manifest at `path`, checked against this code.

    Raises:
        PolicyWeightsError: it cannot be read, or the interface differs (the message names where).
    """
    try:
        content = json.loads(path.read_text())
        schema = content.pop("schema")
        if schema != SCHEMA:
            raise ValueError(f"schema {schema}, this code reads {SCHEMA}")
        content["layers"] = tuple(content["layers"])
        manifest = PolicyManifest(**content)
        expected = interface(manifest.form)
    except (KeyError, TypeError, ValueError) as error:
        raise PolicyWeightsError(path, f"the manifest cannot be read ({error})") from error
    require_interface(path, manifest.interface, expected)
    if (manifest.layers[0], manifest.layers[-1]) != (Observation(manifest.form).size, JOINT_COUNT):
        raise PolicyWeightsError(path, f"layers {manifest.layers} do not lead from the observation to {JOINT_COUNT} joints")
    return manifest


def available_policies(directory: Path = WEIGHTS_DIRECTORY) -> tuple[str, ...]:
    """Names of POLICY_NAMES with a manifest in `directory`."""
    return tuple(name for name in POLICY_NAMES if (directory / f"{name}.json").is_file())


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    return json.loads(json.dumps(values))
