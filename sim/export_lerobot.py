"""`python -m sim.export_lerobot`: recordings as a LeRobot data set, with the felt force and its sigma as features.

    python -m sim.export_lerobot push.mcap more.mcap --output data/pushes --task "press the lid"

One recording is one episode, at 50 frames per second. The layout is LeRobot's v2.1: `meta/info.json`, `meta/episodes.jsonl`,
`meta/tasks.jsonl`, `meta/episodes_stats.jsonl` and one Parquet file per episode. Needs `pip install -e ".[lerobot]"`.
"""

import argparse
import importlib
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from control.files import replacing, write_whole
from control.joints import JOINT_NAMES
from control.timing import CONTROL_PERIOD_S, SLOT_COUNT
from sim.recording.messages import estimates_wire, read_vectors
from sim.recording.reader import Recording, RecordingFormatError

VERSION = "v2.1"
CHUNK = 1000
"""Episodes per folder."""

_FPS = round(1.0 / CONTROL_PERIOD_S)
_AXES = ("x", "y", "z")
_FEATURES: dict[str, tuple[str, ...]] = {
    "observation.state": (*(f"{name}.position" for name in JOINT_NAMES), *(f"{name}.velocity" for name in JOINT_NAMES)),
    "observation.force": _AXES,
    "observation.force_sigma": _AXES,
    "action": tuple(f"{name}.target" for name in JOINT_NAMES),
    "action.command": (*(f"mask.{axis}" for axis in _AXES), *(f"force.{axis}" for axis in _AXES))
    + (*(f"position.{axis}" for axis in _AXES), "velocity.ahead", "velocity.left", "velocity.turn"),
}


def frames(recording: Recording) -> dict[str, np.ndarray]:
    """Values (n, columns) float32 of each feature at 50 Hz. Forces in heading, N, of the environment on the robot; where an
    estimator states no sigma it is NaN. The action of a joint is its target: an angle in rad, of a wheel its speed in rad/s.
    """
    estimates = recording.column("/estimates", estimates_wire(recording.estimators))["body"][::SLOT_COUNT]
    sensors, inputs = recording.sensors()["body"][::SLOT_COUNT], recording.inputs()["body"][::SLOT_COUNT]
    targets = recording.targets()["body"][::SLOT_COUNT]
    wheels = np.array(["wheel" in name for name in JOINT_NAMES])
    values = {
        "observation.state": np.hstack([sensors["joint_position"], sensors["joint_velocity"]]),
        "observation.force": read_vectors(estimates, recording.metadata["estimator"]),
        "observation.force_sigma": read_vectors(estimates, "sigma"),
        "action": np.where(wheels, targets["velocity"], targets["position"]),
        "action.command": np.hstack([inputs[name] for name in ("mask", "force_n", "position_m", "base_velocity")]),
    }
    return {name: value.astype(np.float32) for name, value in values.items()}


def export(paths: Sequence[Path], output: Path, task: str) -> None:
    """Write the data set.

    Raises:
        RecordingFormatError: a file is no recording.
        FileExistsError: there is one already.
    """
    if (output / "meta" / "info.json").exists():
        raise FileExistsError(f"{output} holds a data set already; name another folder")
    episodes, statistics, total = [], [], 0
    for number, path in enumerate(paths):
        recording = Recording(path)
        try:
            values = frames(recording)
        finally:
            recording.close()
        count = len(values["action"])
        _write_episode(output / _data_path(number), values, number, total)
        episodes.append({"episode_index": number, "tasks": [task], "length": count})
        statistics.append({"episode_index": number, "stats": {name: _statistics(value) for name, value in values.items()}})
        total += count
    meta = output / "meta"
    write_whole(meta / "episodes.jsonl", _lines(episodes))
    write_whole(meta / "episodes_stats.jsonl", _lines(statistics))
    write_whole(meta / "tasks.jsonl", _lines([{"task_index": 0, "task": task}]))
    write_whole(meta / "info.json", json.dumps(_info(len(paths), total), indent=2) + "\n")


def _data_path(episode: int) -> Path:
    return Path("data") / f"chunk-{episode // CHUNK:03d}" / f"episode_{episode:06d}.parquet"


def _write_episode(path: Path, values: dict[str, np.ndarray], number: int, first: int) -> None:
    arrow, parquet = importlib.import_module("pyarrow"), importlib.import_module("pyarrow.parquet")
    count = len(values["action"])
    columns: dict[str, Any] = {
        name: arrow.FixedSizeListArray.from_arrays(arrow.array(value.reshape(-1)), value.shape[1])
        for name, value in values.items()
    }
    columns["timestamp"] = arrow.array((np.arange(count) / _FPS).astype(np.float32))
    for name, column in (
        ("frame_index", np.arange(count)),
        ("episode_index", np.full(count, number)),
        ("index", first + np.arange(count)),
        ("task_index", np.zeros(count, int)),
    ):
        columns[name] = arrow.array(column.astype(np.int64))
    with replacing(path) as partial:
        parquet.write_table(arrow.table(columns), partial)


def _info(episodes: int, total: int) -> dict[str, Any]:
    features: dict[str, Any] = {
        name: {"dtype": "float32", "shape": [len(columns)], "names": list(columns)} for name, columns in _FEATURES.items()
    }
    features["timestamp"] = {"dtype": "float32", "shape": [1], "names": None}
    for name in ("frame_index", "episode_index", "index", "task_index"):
        features[name] = {"dtype": "int64", "shape": [1], "names": None}
    return {
        "codebase_version": VERSION,
        "robot_type": "forcelens",
        "total_episodes": episodes,
        "total_frames": total,
        "total_tasks": 1,
        "total_videos": 0,
        "total_chunks": (episodes + CHUNK - 1) // CHUNK,
        "chunks_size": CHUNK,
        "fps": _FPS,
        "splits": {"train": f"0:{episodes}"},
        "data_path": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
        "video_path": None,
        "features": features,
    }


def _statistics(values: np.ndarray) -> dict[str, Any]:
    known = np.where(np.isfinite(values), values, 0.0).astype(float)
    return {
        "min": known.min(axis=0).tolist(),
        "max": known.max(axis=0).tolist(),
        "mean": known.mean(axis=0).tolist(),
        "std": known.std(axis=0).tolist(),
        "count": [len(values)],
    }


def _lines(rows: Sequence[dict[str, Any]]) -> str:
    return "".join(json.dumps(row) + "\n" for row in rows)


def main(words: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    arguments = argparse.ArgumentParser(prog="python -m sim.export_lerobot", description="Recordings as a LeRobot data set.")
    arguments.add_argument("files", type=Path, nargs="+", help="recordings, one episode each")
    arguments.add_argument("--output", type=Path, required=True, help="folder of the data set, which must be new")
    arguments.add_argument("--task", default="teleoperation", help="what was done, in words")
    options = arguments.parse_args(words)
    try:
        export(options.files, options.output, options.task)
    except ImportError:
        sys.stderr.write('export_lerobot: Parquet files need pyarrow; pip install "pyarrow>=18"\n')
        return 2
    except (RecordingFormatError, OSError) as error:
        sys.stderr.write(f"export_lerobot: {error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
