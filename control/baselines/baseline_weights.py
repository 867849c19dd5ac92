"""Trained baselines on disk, as policies are (control.policy.policy_weights): NAME.npz and a manifest NAME.json."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from control.baselines.method import TARGET_SCALES, Method, Network
from control.baselines.portela import Portela
from control.baselines.zhi import Zhi
from control.paths import WEIGHTS_DIRECTORY
from control.policy.observation import PAPER_FORM
from control.policy.policy_weights import PolicyWeightsError, interface, require_hash, require_interface, weight_files
from control.weights_file import load_arrays, save_weights

SCHEMA = 1
METHODS: dict[str, Method] = {method.name: method for method in (Portela(), Zhi())}
RETUNED = "_retuned"
"""Ends the name of a baseline whose force reward has a narrower tolerance than the published one."""
BASELINE_NAMES = tuple(name + ending for name in METHODS for ending in ("", RETUNED))


@dataclass(frozen=True, slots=True)
class BaselineManifest:
    """What a trained baseline is.

    Attributes:
        name: of the controller.
        method: of METHODS.
        interface: everything of this code that the network depends on, see `baseline_interface`.
        stands: fell in none of the trials that chose it or judged it, of two minutes and more: what the console's list needs.
        flattened: its learning curve had flattened when training ended.
        sha256: of the npz file.
        training: command, commit, seed, steps.
        metrics: the score's parts.
        curve: "steps" and "reward" of the hand, thinned out; before it "imitation_steps" and "imitation_loss".
    """

    name: str
    method: str
    interface: dict[str, Any]
    stands: bool = False
    flattened: bool = False
    sha256: str = ""
    training: dict[str, Any] = field(default_factory=dict)
    metrics: dict[str, Any] = field(default_factory=dict)
    curve: dict[str, list[float]] = field(default_factory=dict)


def baseline_interface(method: Method) -> dict[str, Any]:
    """What a baseline of this method depends on, as plain JSON values."""
    return {
        **interface(PAPER_FORM),
        "frames": method.frames,
        "frame_size": method.frame_size,
        "targets": dict(method.targets),
        "target_scales": {name: TARGET_SCALES[name] for name in method.targets},
        "layers": {name: list(sizes) for name, sizes in method.layers().items()},
    }


def save_baseline(directory: Path, manifest: BaselineManifest, arrays: dict[str, np.ndarray]) -> Path:
    """Write NAME.npz and NAME.json into `directory`, with the hash filled in; the manifest's path."""
    return save_weights(directory, manifest.name, {"schema": SCHEMA, **asdict(manifest)}, arrays)


def load_baseline(name: str, directory: Path = WEIGHTS_DIRECTORY) -> tuple[BaselineManifest, Network]:
    """The baseline `name` of `directory`, checked against its manifest and against this code.

    Raises:
        PolicyWeightsError: a file is missing or damaged, or was made for another interface or shape.
    """
    path, weights = weight_files(directory, name)
    manifest = read_baseline(path)
    require_hash(weights, manifest.sha256)
    try:
        return manifest, METHODS[manifest.method].network(load_arrays(weights))
    except ValueError as error:
        raise PolicyWeightsError(weights, str(error)) from error


def read_baseline(path: Path) -> BaselineManifest:
    """The manifest at `path`, checked against this code.

    Raises:
        PolicyWeightsError: it cannot be read, or the interface differs (the message names where).
    """
    try:
        content = json.loads(path.read_text())
        schema = content.pop("schema")
        if schema != SCHEMA:
            raise ValueError(f"schema {schema}, this code reads {SCHEMA}")
        manifest = BaselineManifest(**content)
        expected = baseline_interface(METHODS[manifest.method])
    except (KeyError, TypeError, ValueError) as error:
        raise PolicyWeightsError(path, f"the manifest cannot be read ({error})") from error
    require_interface(path, manifest.interface, expected)
    return manifest


def available_baselines(directory: Path = WEIGHTS_DIRECTORY) -> tuple[str, ...]:
    """Names of BASELINE_NAMES with a manifest in `directory`."""
    return tuple(name for name in BASELINE_NAMES if (directory / f"{name}.json").is_file())
