"""Trained force networks on disk: NAME.npz holds the numbers, NAME.json (the manifest) says what they are.

A network is used only when its file is the one that the manifest describes and its inputs are what this code computes.
"""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from control.estimation.networks.force_features import (
    SIGMA_DRIVERS,
    feature_names,
)
from control.estimation.networks.force_network import ForceNetwork, NetworkManifest
from control.estimation.networks.residual_tcn import TcnShape
from control.paths import WEIGHTS_DIRECTORY
from control.weights_file import load_arrays, save_weights, sha256

SCHEMA = 1


class WeightsError(ValueError):
    """Weights cannot be used; the message names the file, what does not fit, and the cure."""

    def __init__(self, path: Path, problem: str) -> None:
        # As arguments, so that it comes back from another process.
        super().__init__(path, problem)

    def __str__(self) -> str:
        path, problem = self.args
        return f"{path}: {problem}; restore the file, or train again with `python -m control.learning.residual_training`"


def save_network(directory: Path, manifest: NetworkManifest, arrays: dict[str, np.ndarray]) -> Path:
    """Write NAME.npz and NAME.json into `directory`, with the hash filled in; the manifest's path."""
    return save_weights(directory, manifest.name, {"schema": SCHEMA, **asdict(manifest)}, arrays)


def load_network(name: str, directory: Path = WEIGHTS_DIRECTORY) -> ForceNetwork:
    """The network `name` of `directory`, checked against its manifest and against this code.

    Raises:
        WeightsError: a file is missing or damaged, or was made for other features or another shape.
    """
    path, weights = directory / f"{name}.json", directory / f"{name}.npz"
    for needed in (path, weights):
        if not needed.is_file():
            raise WeightsError(needed, "the file is missing")
    try:
        manifest = _read_manifest(json.loads(path.read_text()))
        expected = feature_names(manifest.feature_groups)
    except (KeyError, TypeError, ValueError) as error:
        raise WeightsError(path, f"the manifest cannot be read ({error})") from error
    if sha256(weights) != manifest.sha256:
        raise WeightsError(weights, f"its sha256 is not {manifest.sha256[:12]}..., which the manifest states")
    if manifest.feature_names != expected:
        different = set(manifest.feature_names) ^ set(expected)
        raise WeightsError(path, f"its features differ from those computed now: {sorted(different)[:6] or 'order'}")
    if manifest.shape.inputs != len(expected):
        raise WeightsError(path, f"shape.inputs is {manifest.shape.inputs}, but there are {len(expected)} features")
    slopes = len(manifest.sigma_slopes)
    if manifest.sigma_scale is not None and slopes != SIGMA_DRIVERS:
        raise WeightsError(path, f"sigma_slopes has {slopes} entries, but sigma has {SIGMA_DRIVERS} drivers")
    arrays = load_arrays(weights)
    try:
        return ForceNetwork(manifest, arrays)
    except ValueError as error:
        raise WeightsError(weights, str(error)) from error


def _read_manifest(content: dict[str, Any]) -> NetworkManifest:
    content = dict(content)
    schema = content.pop("schema")
    if schema != SCHEMA:
        raise ValueError(f"schema {schema}, this code reads {SCHEMA}")
    shape = dict(content.pop("shape"))
    shape["dilations"] = tuple(shape["dilations"])
    for name in ("feature_groups", "increment_groups", "feature_names", "output_limit_n", "sigma_scale", "sigma_slopes"):
        if content[name] is not None:
            content[name] = tuple(content[name])
    return NetworkManifest(shape=TcnShape(**shape), **content)
