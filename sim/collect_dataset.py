"""Record rollouts for training the force networks: `python -m sim.collect_dataset --output data/estimator --rollouts 500`.

Every rollout is drawn from the seed before anything runs and written as soon as it is done, and the manifest grows with
them: what is there can be used, and the same command continues a collection that was cut off.
"""

import argparse
import json
import logging
import os
import shlex
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from control.files import write_whole
from control.learning.rollout_data import SPLITS, is_whole_rollout, save_rollout, write_manifest
from control.provenance import commit
from control.timing import CONTROL_PERIOD_S
from sim import scenes
from sim.processes.executors import EXECUTOR_NAMES, ExecutorError, map_unordered
from sim.trials.rollout_plans import RolloutPlan, plan_rollouts
from sim.trials.rollout_recorder import Recording, manifest_entry, record_rollout

logger = logging.getLogger("collect_dataset")


class CollectionError(RuntimeError):
    """The output folder holds something else than this data set."""


def collect(
    output: Path,
    seed: int,
    rollouts: int,
    duration_s: float,
    executor: str = "local",
    workers: int = 1,
    address: str | None = None,
    command: str = "",
    splits: Sequence[str] = SPLITS,
) -> dict[str, Any]:
    """Record what is missing in `output` and write its manifest.

    Args:
        output: folder of the data set.
        seed, rollouts, duration_s: see sim.trials.rollout_plans.plan_rollouts.
        executor, workers, address: see sim.processes.executors.map_unordered.
        command: as given, for the manifest.
        splits: those to record, of rollout_data.SPLITS.

    Returns:
        The manifest.

    Raises:
        CollectionError: `output` holds rollouts of other plans.
        ExecutorError: the executor is not available.
    """
    planned = plan_rollouts(seed, rollouts, scenes.build("free").robot_bodies, duration_s)
    plans = [plan for plan in planned if plan.split in splits]
    done = {plan.index: entry for plan in plans if (entry := _read_entry(output, plan)) is not None}
    # In random order, so that a collection in progress already holds some of every split.
    shuffled = np.random.default_rng(seed).permutation(len(plans)).tolist()
    missing = [plan for plan in (plans[place] for place in shuffled) if plan.index not in done]
    logger.info("%d of %d rollouts are there; recording %d with %d workers", len(done), len(plans), len(missing), workers)
    started = time.perf_counter()
    for count, recording in enumerate(map_unordered(executor, record_rollout, missing, workers, address), 1):
        done[recording.plan.index] = _write(output, recording)
        write_manifest(output, _manifest([done[index] for index in sorted(done)], seed, command))
        remaining = (time.perf_counter() - started) / count * (len(missing) - count)
        outcome = "kept" if recording.arrays else "given up"
        logger.info(
            "%d/%d: %s %s %s, rejected %d, %.0f s left",
            count,
            len(missing),
            recording.plan.split,
            recording.plan.profile,
            outcome,
            len(recording.rejected),
            remaining,
        )
    content = _manifest([done[index] for index in sorted(done)], seed, command)
    write_manifest(output, content)
    return content


def _file(index: int) -> str:
    return f"rollouts/{index:05d}.npz"


def _entry_path(output: Path, index: int) -> Path:
    return output / f"rollouts/{index:05d}.json"


def _read_entry(output: Path, plan: RolloutPlan) -> dict[str, Any] | None:
    """The entry of a rollout that is there and whole."""
    path = _entry_path(output, plan.index)
    if not path.is_file():
        return None
    try:
        entry = json.loads(path.read_text())
    except ValueError:
        logger.warning("%s was written half-way; recording that rollout again", path)
        return None
    same = {key: entry.get(key) for key in plan.as_dict() if key != "seed"}
    if same != {key: value for key, value in plan.as_dict().items() if key != "seed"}:
        raise CollectionError(f"{path} belongs to a data set with other arguments; choose another --output")
    if entry["file"] and not is_whole_rollout(output / entry["file"]):
        logger.warning("%s is missing or damaged; recording that rollout again", output / entry["file"])
        return None
    return entry


def _write(output: Path, recording: Recording) -> dict[str, Any]:
    """Files of one rollout; the entry comes last, it says that the rollout is complete."""
    index = recording.plan.index
    file = _file(index) if recording.arrays else ""
    if file:
        save_rollout(output / file, recording.arrays)
    entry = manifest_entry(recording, file)
    write_whole(_entry_path(output, index), json.dumps(entry) + "\n")
    return entry


def _manifest(entries: list[dict[str, Any]], seed: int, command: str) -> dict[str, Any]:
    kept = [entry for entry in entries if entry["file"]]
    reasons = [reason for entry in entries for reason in entry["rejected"]]
    profiles = sorted({entry["profile"] for entry in kept})
    return {
        "seed": seed,
        "command": command,
        "commit": commit(),
        "period_s": CONTROL_PERIOD_S,
        "counts": {split: sum(entry["split"] == split for entry in kept) for split in SPLITS},
        "attempts": len(kept) + len(reasons),
        "rejected": {reason: reasons.count(reason) for reason in sorted(set(reasons))},
        "given_up": [entry["index"] for entry in entries if not entry["file"]],
        "profiles": {
            profile: _profile_figures([entry for entry in kept if entry["profile"] == profile]) for profile in profiles
        },
        "rollouts": kept,
    }


def _profile_figures(entries: list[dict[str, Any]]) -> dict[str, float]:
    """Root mean squares over all rollouts of a profile."""
    return {
        name: round(float(np.sqrt(np.mean([entry[name] ** 2 for entry in entries]))), 2)
        for name in ("rms_force_n", "rms_slope_nps")
    }


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, required=True, help="folder of the data set")
    parser.add_argument("--rollouts", type=int, default=500, help="of all splits together, see sim.trials.rollout_plans")
    parser.add_argument("--seed", type=int, default=1, help="of everything random")
    parser.add_argument(
        "--duration", type=float, default=10.0, help="seconds per training rollout; held-out ones last twice as long"
    )
    parser.add_argument("--splits", nargs="+", choices=SPLITS, default=SPLITS, help="what to record of it (default: all)")
    parser.add_argument("--executor", choices=EXECUTOR_NAMES, default="local")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="rollouts at a time (default: one per core)")
    parser.add_argument("--ray-address", help="of a running Ray cluster; by default Ray starts on this machine")
    options = parser.parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    words = sys.argv[1:] if arguments is None else arguments
    try:
        manifest = collect(
            options.output,
            options.seed,
            options.rollouts,
            options.duration,
            options.executor,
            options.workers,
            options.ray_address,
            shlex.join(["python", "-m", "sim.collect_dataset", *words]),
            options.splits,
        )
    except (CollectionError, ExecutorError) as error:
        parser.exit(1, f"collect_dataset: {error}\n")
    except OSError as error:
        parser.exit(1, f"collect_dataset: {error}. What is there is kept, and the same command continues\n")
    logger.info("kept %s of %d attempts, rejected %s", manifest["counts"], manifest["attempts"], manifest["rejected"])
    logger.info("profiles %s", manifest["profiles"])


if __name__ == "__main__":
    main()
