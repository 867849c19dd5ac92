"""Table II of the paper and what stands beside it: forces over time, estimates, and how much each controller has learned."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from control.baselines.baseline_weights import BASELINE_NAMES, BaselineManifest, read_baseline
from control.timing import CONTROL_PERIOD_S
from sim.benchmarks.report import Row, format_table
from sim.trials.box_drag import DragResult, DragTrace

LONGEST_LAG_S = 0.6
_LATERAL = 1


def lag_s(estimate: np.ndarray, truth: np.ndarray) -> float:
    """Delay, s, up to LONGEST_LAG_S, at which an estimate (n,) fits truth (n,) best, whatever its bias."""
    steps = min(round(LONGEST_LAG_S / CONTROL_PERIOD_S), len(truth) - 2)
    errors = [np.std(estimate[shift:] - truth[: len(truth) - shift]) for shift in range(max(steps, 0) + 1)]
    return CONTROL_PERIOD_S * int(np.argmin(errors))


def estimate_row(traces: Sequence[DragTrace]) -> Row:
    """RMSE (vector) and lag (of the lateral force) of the estimate that feeds the controller and of the controller's own."""
    row: Row = {}
    for who in ("fed", "own"):
        pairs = [(estimate, trace.true) for trace in traces if (estimate := getattr(trace, who)) is not None]
        errors = [np.square(estimate - truth).sum(axis=1) for estimate, truth in pairs]
        row[f"estimate_{who}_rmse_n"] = float(np.sqrt(np.concatenate(errors).mean())) if pairs else None
        lags = [lag_s(estimate[:, _LATERAL], truth[:, _LATERAL]) for estimate, truth in pairs]
        row[f"estimate_{who}_lag_s"] = float(np.median(lags)) if pairs else None
    return row


def training_row(manifest: BaselineManifest | None) -> Row:
    """How long a baseline has learned and whether its curve has flattened; nothing of what is none."""
    if manifest is None:
        return {}
    training = manifest.training
    return {
        "environment_steps": training.get("steps"),
        "ppo_iterations": training.get("ppo_iterations"),
        "learning_curve": "flattened" if manifest.flattened else "not flattened",
        "stands": manifest.stands,
    }


def manifests(directory: Path, names: Sequence[str]) -> dict[str, BaselineManifest]:
    """Manifests of the baselines among `names`."""
    return {name: read_baseline(directory / f"{name}.json") for name in names if name in BASELINE_NAMES}


def table_two(summaries: Sequence[Row]) -> str:
    """The paper's Table II of each mass scale: mean and sample deviation of the errors, mean extrema of the box."""
    lines = []
    for row in summaries:
        line = {
            "mass": row["mass_scale"],
            "method": row["controller"],
            "e_y [N]": _with_deviation(row["e_y_n"], row["e_y_sd_n"]),
            "e_z [N]": _with_deviation(row["e_z_n"], row["e_z_sd_n"]),
            "y_box [m]": f"[{row['y_min_m']:.3f}, {row['y_max_m']:.3f}]",
            "contact lost": f"{row['contact_lost']} of {row['trials']}",
            "learning curve": row.get("learning_curve") or "-",
        }
        lines.append(line)
    return format_table(sorted(lines, key=lambda line: line["mass"] != 1.0))


def _with_deviation(mean: str | float | None, deviation: str | float | None) -> str:
    return f"{mean:.2f}" + (f" ± {deviation:.2f}" if isinstance(deviation, float) else "")


def plot_forces(folder: Path, results: dict[str, DragResult]) -> None:
    """f_y and f_z over time of one trial of each controller, as the paper's figure beside Table II."""
    # Plots are optional, so the library is only needed for them.
    from matplotlib import pyplot

    figure, panels = pyplot.subplots(2, 1, figsize=(7.5, 5.0), sharex=True, layout="constrained")
    asked = None
    for name, result in results.items():
        if (trace := result.trace) is None:
            continue
        asked = trace if asked is None or len(trace.time_s) > len(asked.time_s) else asked
        for panel, axis in zip(panels, (1, 2), strict=True):
            panel.plot(trace.time_s, trace.true[:, axis], linewidth=1.0, label=name)
    for panel, axis, name in zip(panels, (1, 2), ("y", "z"), strict=True):
        if asked is not None:
            panel.plot(asked.time_s, asked.asked[:, axis], "k--", linewidth=1.0, label="asked for")
        panel.set_ylabel(f"$f_{name}$ [N]")
    panels[1].set_xlabel("time [s]")
    panels[0].legend(ncols=3, fontsize=8)
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "box_drag_forces.png", dpi=120)


def plot_learning(folder: Path, trained: dict[str, BaselineManifest]) -> None:
    """Learning curves of the baselines: loss of the imitation, reward of the hand, and whether that has flattened."""
    from matplotlib import pyplot

    figure, (imitation, reward) = pyplot.subplots(1, 2, figsize=(9.0, 3.5), layout="constrained")
    for name, manifest in trained.items():
        curve, shape = manifest.curve, "flattened" if manifest.flattened else "not flattened"
        imitation.plot(np.array(curve["imitation_steps"]) / 1e6, curve["imitation_loss"], label=f"{name}: {shape}")
        reward.plot(np.array(curve["steps"]) / 1e6, curve["reward"])
    imitation.set(xlabel="environment steps [10⁶]", ylabel="loss of the imitation", yscale="log")
    reward.set(xlabel="environment steps [10⁶]", ylabel="reward of the hand, per step of PPO")
    if trained:
        imitation.legend(fontsize=8)
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "box_drag_learning.png", dpi=120)
