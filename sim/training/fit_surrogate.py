"""Fit the estimator surrogate of training to the real estimator: `python -m sim.training.fit_surrogate --plot runs/surrogate`.

Records random whole-body commands on the full stack at several mass scales and fits, in this order: the low-pass (grid
search per axis group), gain, motion- and mass-correlated error (least squares), bias and noise (what is left).
"""

import argparse
import json
import logging
import shlex
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from control.files import write_whole
from control.provenance import commit
from control.timing import CONTROL_PERIOD_S
from sim.training.surrogate import MOTION_NAMES, SURROGATE_FILE, LowPass, SurrogateParameters
from sim.trials.random_segments import RandomSegments
from sim.trials.trial import Trial, TrialSetup

logger = logging.getLogger("fit_surrogate")

MASS_SCALES = (0.85, 1.0, 1.15)
_FREQUENCIES = np.geomspace(4.0, 60.0, 25)
_DAMPING_RATIOS = (0.5, 0.67, 0.8, 0.95)


@dataclass(frozen=True, slots=True)
class EstimatorRecording:
    """One run at 50 Hz: true and estimated force (n, 3) N, motion (n, 4) of MOTION_NAMES, and the mass scale error."""

    truth: np.ndarray
    estimate: np.ndarray
    motion: np.ndarray
    mass_error: float


def record(seed: int, seconds: float, mass_scale: float, estimator: str) -> EstimatorRecording:
    """Record one run of random commands under the model-based controller."""
    trial = Trial(TrialSetup(estimator=estimator, mass_scale=mass_scale), seed)
    segments = RandomSegments(seed, (5.0, 10.0, 20.0))
    truths, estimates, velocities = [], [], []
    while len(truths) * CONTROL_PERIOD_S < seconds and not trial.fallen:
        segment, _ = segments.draw(trial.hand_in_heading)
        wrench = trial.session.backend.wrenches.add(segment.spring)
        for _ in trial.run(segment.command, segment.duration_s):
            truth = trial.truth
            truths.append(truth.force_true_n)
            estimates.append(trial.session.output.hand.force_estimated_n)
            forward = truth.base_linear_velocity @ truth.rotation_heading_to_world[:, 0]
            velocities.append((forward, truth.base_angular_velocity[2]))
        trial.session.backend.wrenches.remove(wrench)
    velocity = np.array(velocities)
    acceleration = np.clip(np.diff(velocity, axis=0, prepend=velocity[:1]) / CONTROL_PERIOD_S, -6.0, 6.0)
    motion = np.concatenate([velocity, acceleration], axis=1)
    return EstimatorRecording(np.array(truths), np.array(estimates), motion, mass_scale - 1.0)


def filtered(recording: EstimatorRecording, natural_frequency_rps: float, damping_ratio: float) -> np.ndarray:
    """True force (n, 3) through the low-pass, started at its first value."""
    low_pass = LowPass((3,), natural_frequency_rps, damping_ratio, CONTROL_PERIOD_S)
    low_pass.value = recording.truth[0].copy()
    return np.array([low_pass.step(force) for force in recording.truth])


def fit(recordings: list[EstimatorRecording]) -> SurrogateParameters:
    """Parameters of the surrogate.

    Raises:
        ValueError: no recordings.
    """
    if not recordings:
        raise ValueError("nothing to fit: no recordings")
    frequency, damping = min(
        ((w, z) for w in _FREQUENCIES for z in _DAMPING_RATIOS),
        key=lambda pair: sum(_variation(r.estimate - filtered(r, *pair)) for r in recordings),
    )
    smooth = [filtered(recording, frequency, damping) for recording in recordings]
    motion, gains, mass_bias = np.empty((3, len(MOTION_NAMES))), [], np.empty(3)
    known = [np.zeros_like(s) for s in smooth]
    for axis in range(3):
        # Per run a bias of its own; gain and motion terms are common. The bias over mass gives the mass term.
        columns = [np.concatenate([s[:, axis : axis + 1], r.motion], axis=1) for s, r in zip(smooth, recordings, strict=True)]
        centered = np.concatenate([c - c.mean(axis=0) for c in columns])
        wanted = np.concatenate([r.estimate[:, axis] - r.estimate[:, axis].mean() for r in recordings])
        solution = np.linalg.lstsq(centered, wanted, rcond=None)[0]
        motion[axis], gain = solution[1:], solution[0]
        gains.append(gain)
        for index, column in enumerate(columns):
            known[index][:, axis] = column @ solution
    biases = np.array([(r.estimate - k).mean(axis=0) for r, k in zip(recordings, known, strict=True)])
    errors = np.array([r.mass_error for r in recordings])
    mass_bias = errors @ biases / max(float(errors @ errors), 1e-9)
    bias_std = (biases - errors[:, None] * mass_bias).std(axis=0)
    rest = [r.estimate - k - b for r, k, b in zip(recordings, known, biases, strict=True)]
    noise = np.concatenate(rest)
    lagged = sum(float((part[1:] * part[:-1]).sum()) for part in rest)
    memory = lagged / sum(float((part[:-1] ** 2).sum()) for part in rest)
    return SurrogateParameters(
        natural_frequency_rps=float(frequency),
        damping_ratio=float(damping),
        gain_std=float(max(0.02, np.abs(np.array(gains) - 1.0).max())),
        bias_std_n=tuple(bias_std.tolist()),
        mass_bias_n=tuple(mass_bias.tolist()),
        motion_n=tuple(tuple(row) for row in motion.tolist()),
        noise_std_n=tuple(noise.std(axis=0).tolist()),
        noise_memory=float(np.clip(memory, 0.0, 0.99)),
    )


def _variation(error: np.ndarray) -> float:
    return float(((error - error.mean(axis=0)) ** 2).sum())


def save_plot(path: Path, recording: EstimatorRecording, parameters: SurrogateParameters) -> None:
    """True force, real estimate and the surrogate without its random parts, for ten seconds of a recording."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    smooth = filtered(recording, parameters.natural_frequency_rps, parameters.damping_ratio)
    modelled = smooth + recording.mass_error * np.array(parameters.mass_bias_n)
    modelled += recording.motion @ np.array(parameters.motion_n).T
    figure = Figure(figsize=(9.0, 6.0), layout="constrained")
    FigureCanvasAgg(figure)
    rows = slice(0, round(10.0 / CONTROL_PERIOD_S))
    times = CONTROL_PERIOD_S * np.arange(len(recording.truth[rows]))
    for axis, panel in enumerate(figure.subplots(3, 1, sharex=True)):
        for values, label in ((recording.truth, "true"), (recording.estimate, "estimator"), (modelled, "surrogate")):
            panel.plot(times, values[rows, axis], label=label, linewidth=1.0)
        panel.set(xlabel="time [s]", ylabel=f"f_{'xyz'[axis]} [N]")
        panel.legend(ncols=3)
    path.mkdir(parents=True, exist_ok=True)
    figure.savefig(path / "estimator_surrogate.png", dpi=120)


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--estimator", default="adaptive", help="which estimator to imitate (default adaptive)")
    parser.add_argument("--seconds", type=float, default=40.0, help="length of each run")
    parser.add_argument("--runs", type=int, default=2, help="runs at each mass scale")
    parser.add_argument("--seed", type=int, default=500)
    parser.add_argument("--output", type=Path, default=SURROGATE_FILE)
    parser.add_argument("--plot", type=Path, metavar="DIR", help="write a picture into this folder")
    options = parser.parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    recordings = []
    for scale in MASS_SCALES:
        for run in range(options.runs):
            recordings.append(record(options.seed + run, options.seconds, scale, options.estimator))
            error = np.sqrt(((recordings[-1].estimate - recordings[-1].truth) ** 2).mean(axis=0))
            logger.info("mass scale %.2f, run %d: error of the estimate %s N RMS", scale, run, error.round(2))
    parameters = fit(recordings)
    words = sys.argv[1:] if arguments is None else arguments
    content = {
        "estimator": options.estimator,
        "command": shlex.join(["python", "-m", "sim.training.fit_surrogate", *words]),
        "commit": commit(),
        "parameters": asdict(parameters),
    }
    write_whole(options.output, json.dumps(content, indent=1) + "\n")
    logger.info("wrote %s: %s", options.output, parameters)
    if options.plot is not None:
        save_plot(options.plot, recordings[len(recordings) // 2], parameters)


if __name__ == "__main__":
    main()
