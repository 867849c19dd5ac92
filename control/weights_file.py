"""What all trained weights share on disk: NAME.npz with the numbers, and NAME.json, a manifest that names its hash."""

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from control.files import replacing, write_whole


def save_weights(directory: Path, name: str, content: dict[str, Any], arrays: dict[str, np.ndarray]) -> Path:
    """Write NAME.npz in single precision and NAME.json with `content` and the hash into `directory`; the manifest's path."""
    weights = directory / f"{name}.npz"
    single = {key: array.astype(np.float32) for key, array in arrays.items()}
    with replacing(weights) as partial:
        np.savez_compressed(partial, allow_pickle=False, **single)
    path = directory / f"{name}.json"
    write_whole(path, json.dumps({**content, "sha256": sha256(weights)}, indent=1) + "\n")
    return path


def load_arrays(weights: Path) -> dict[str, np.ndarray]:
    """The arrays of a NAME.npz."""
    with np.load(weights) as archive:
        return {key: archive[key] for key in archive.files}


def sha256(path: Path) -> str:
    """Hexadecimal hash of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
