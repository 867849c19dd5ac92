"""`python -m sim.reestimate FILE`: another estimator, or other gains, over a recording.

    python -m sim.reestimate push.mcap --estimator gmo_cqp --gains 12 80 --plot plots
    python -m sim.reestimate push.mcap --check
    python -m sim.reestimate push.mcap --check --from-s 60 --to-s 70

Without `--check` it compares with what the recording's own estimator said then, and with the truth where there is one. With
`--check` it runs the whole pipeline again and counts the values that differ from the recorded ones: none, on the machine and
version that made the recording.
"""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from control.files import write_whole
from control.pipeline import UnknownNameError
from control.state.file import StateFileError
from control.timing import TICK_S
from sim.recording.messages import read_vectors
from sim.recording.reader import Recording, RecordingFormatError
from sim.recording.rerun import reestimate, rerun

SHOWN_EVERY = 10
"""Ticks between two values of `--json`."""


def parser() -> argparse.ArgumentParser:
    """Arguments of the command."""
    arguments = argparse.ArgumentParser(prog="python -m sim.reestimate", description="Another estimator over a recording.")
    arguments.add_argument("file", type=Path, help="the recording, MCAP")
    arguments.add_argument("--estimator", default="hybrid", help="which one (default hybrid)")
    arguments.add_argument("--gains", type=float, nargs=2, metavar=("K1", "K2"), help="of its momentum observer")
    arguments.add_argument("--check", action="store_true", help="run the whole pipeline and count what differs from then")
    arguments.add_argument(
        "--from-s", type=float, default=0.0, metavar="S", help="begin with the last keyframe up to this time since the start"
    )
    arguments.add_argument("--to-s", type=float, default=np.inf, metavar="S", help="end with this time")
    arguments.add_argument("--plot", type=Path, metavar="DIR", help="draw the forces into this folder")
    arguments.add_argument("--json", type=Path, metavar="PATH", help="write the forces at 50 Hz, and the errors")
    return arguments


def compared(recording: Recording, estimator: str, gains: tuple[float, float] | None) -> dict[str, Any]:
    """Forces (n, 3) N of an estimator now, of the one that fed the controller at the start then, and errors."""
    started = time.perf_counter()
    now = np.array([estimate.force_estimated_n for estimate in reestimate(recording, estimator, gains)])
    took_s = time.perf_counter() - started
    inputs = recording.inputs()
    ticks = recording.ticks(inputs)
    own = recording.metadata["estimator"]
    then = recording.estimates_n()[:, recording.estimators.index(own)]
    result = {
        "estimator": estimator,
        "gains": gains,
        "estimator_then": own,
        "difference_rms_n": _rms(now - then),
        "real_time_factor": len(now) * TICK_S / took_s,
        "time_s": TICK_S * ticks,
        "force_n": now,
        "force_then_n": then,
    }
    truth = recording.truth()
    last = recording.ticks(truth) - 1  # of those that a snapshot has seen
    known = np.isin(last, ticks)
    rows = np.searchsorted(ticks, last[known])
    if len(rows):
        force = read_vectors(truth["body"], "force_n")[known]
        result |= {"error_rms_n": _rms(now[rows] - force), "error_then_rms_n": _rms(then[rows] - force)}
    return result


def differences(recording: Recording) -> dict[str, int]:
    """Values of the whole pipeline, run again, that are not the recorded ones to the bit, by estimator and of the targets."""
    again = rerun(recording)
    recorded = recording.estimates_n()
    found = {
        name: _differing(again.estimates_n[:, index], recorded[:, index]) for index, name in enumerate(recording.estimators)
    }
    return found | {"targets": _differing(again.target_position, recording.targets()["body"]["position"])}


def plot(result: dict[str, Any], folder: Path) -> Path:
    """Draw forces per axis; the file."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    folder.mkdir(parents=True, exist_ok=True)
    figure, axes = pyplot.subplots(3, 1, sharex=True, figsize=(9, 7))
    for axis, panel in enumerate(axes):
        panel.plot(result["time_s"], result["force_then_n"][:, axis], label=f"{result['estimator_then']}, then")
        panel.plot(result["time_s"], result["force_n"][:, axis], label=f"{result['estimator']}, now")
        panel.set_ylabel(f"f{'xyz'[axis]} [N]")
    axes[0].legend()
    axes[-1].set_xlabel("s since the start")
    path = folder / f"reestimate_{result['estimator']}.png"
    figure.savefig(path, dpi=110, bbox_inches="tight")
    pyplot.close(figure)
    return path


def main(words: Sequence[str] | None = None) -> int:
    """Run the command; the exit status: 1 where `--check` finds differences, 2 where the file or a name does not fit."""
    options = parser().parse_args(words)
    gains = None if options.gains is None else (options.gains[0], options.gains[1])
    try:
        recording = Recording(options.file, options.from_s, options.to_s)
        if options.check:
            found = differences(recording)
            _say(f"differing values: {found}")
            return 1 if any(found.values()) else 0
        result = compared(recording, options.estimator, gains)
    except (RecordingFormatError, StateFileError, UnknownNameError, OSError, ValueError) as error:
        sys.stderr.write(f"reestimate: {error}\n")
        return 2
    numbers = ("difference_rms_n", "error_rms_n", "error_then_rms_n", "real_time_factor")
    for name in (name for name in numbers if name in result):
        _say(f"{name:18} {result[name]:.3f}")
    if options.plot is not None:
        _say(str(plot(result, options.plot)))
    if options.json is not None:
        arrays = {name: result[name][::SHOWN_EVERY].tolist() for name in ("time_s", "force_n", "force_then_n")}
        write_whole(options.json, json.dumps({**result, **arrays}).replace("NaN", "null"))
    return 0


def _rms(errors: np.ndarray) -> float:
    """Of the lengths of vectors (n, 3), without those that are not known."""
    return float(np.sqrt(np.nanmean((errors**2).sum(axis=1))))


def _differing(now: np.ndarray, then: np.ndarray) -> int:
    now, then = np.ascontiguousarray(now, float), np.ascontiguousarray(then, float)
    return int((now.view(np.uint64) != then.view(np.uint64)).sum())


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")


if __name__ == "__main__":
    sys.exit(main())
