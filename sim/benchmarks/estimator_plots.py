"""Pictures of the estimator benchmark: error bars by estimator, and the vertical force over time, as in the paper's figure."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from control.timing import CONTROL_PERIOD_S
from sim.benchmarks.estimator_rows import Cell
from sim.benchmarks.estimator_scores import Scores
from sim.benchmarks.estimator_trials import SETTLE_S, RolloutTrial
from sim.benchmarks.report import Row

COLORS = {
    "gmo_pi": "#9aa0a6",
    "gmo_cqp": "#e69f00",
    "tcn": "#cc79a7",
    "hybrid_paper": "#56b4e9",
    "adaptive": "#0072b2",
    "hybrid": "#009e73",
}


def plot_bars(folder: Path, rows: Sequence[Row]) -> None:
    """Mean vector RMSE and sample standard deviation of every row: one panel per cell, one bar per estimator."""
    from matplotlib import pyplot  # plots are optional, so the library is only needed for them

    cells = list(dict.fromkeys((row["profile"], row["mass_scale"], row["per_link"]) for row in rows))
    names = list(dict.fromkeys(str(row["estimator"]) for row in rows))
    size = (1.5 + 2.6 * len(cells), 1.0 + 0.32 * len(names))
    figure, panels = pyplot.subplots(1, len(cells), sharey=True, squeeze=False, figsize=size, layout="constrained")
    for (profile, mass_scale, per_link), panel in zip(cells, panels[0], strict=True):
        mine = {
            str(row["estimator"]): row
            for row in rows
            if (row["profile"], row["mass_scale"], row["per_link"]) == (profile, mass_scale, per_link)
        }
        means = [float(mine[name]["rmse_vector_n"] or 0.0) for name in names]
        deviations = [float(mine[name]["sd_n"] or 0.0) for name in names]
        colors = [COLORS.get(name, "#cfd4da") for name in names]
        panel.barh(names, means, xerr=deviations, color=colors, error_kw={"linewidth": 0.8})
        for index, (mean, deviation) in enumerate(zip(means, deviations, strict=True)):
            panel.text(mean + deviation, index, f" {mean:.2f}", va="center", fontsize=8)
        panel.set_title(str(Cell(str(profile), float(mass_scale or 0.0), bool(per_link))), fontsize=9)
        panel.set_xlabel("vector RMSE [N]")
        panel.set_xlim(0.0, 1.25 * max(mean + deviation for mean, deviation in zip(means, deviations, strict=True)))
        panel.spines[["top", "right"]].set_visible(False)
    panels[0][0].invert_yaxis()
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "estimator_bars.png", dpi=120)
    pyplot.close(figure)


def plot_force_over_time(folder: Path, trials: Sequence[RolloutTrial]) -> None:
    """Vertical force of one trial per mass scale, as in the paper's figure."""
    time = SETTLE_S + CONTROL_PERIOD_S * np.arange(len(trials[0].force_true_n))
    series = [(f"mass x{trial.plan.mass_scale:g}", 2, trial.force_true_n, trial.scores) for trial in trials]
    plot_estimates(folder / f"estimator_force_z_{trials[0].plan.profile}.png", time, series)


def plot_estimates(path: Path, time_s: np.ndarray, series: Sequence[tuple[str, int, np.ndarray, dict[str, Scores]]]) -> None:
    """Truth and every estimate over time, one panel per series; two sigma of `hybrid` as a band.

    Args:
        path: of the picture.
        time_s: (n,) s.
        series: title, axis (0 x, 1 y, 2 z), true force (n, 3) N and scores of each panel.
    """
    from matplotlib import pyplot  # plots are optional, so the library is only needed for them

    size = (9.0, 1.2 + 2.2 * len(series))
    figure, panels = pyplot.subplots(len(series), 1, sharex=True, squeeze=False, figsize=size, layout="constrained")
    for (title, axis, force_true_n, scores), panel in zip(series, panels[:, 0], strict=True):
        truth = force_true_n[:, axis]
        for name in (name for name in COLORS if name in scores):
            force = truth + scores[name].error[:, axis]
            panel.plot(time_s, force, color=COLORS[name], linewidth=0.9, label=name)
            if name == "hybrid":
                band = 2.0 * scores[name].sigma[:, axis]
                panel.fill_between(time_s, force - band, force + band, color=COLORS[name], alpha=0.25, linewidth=0.0)
        panel.plot(time_s, truth, color="black", linewidth=1.1, linestyle="--", label="true")
        panel.set_title(title, fontsize=9)
        panel.set_ylabel(f"force {'xyz'[axis]} [N]")
        panel.grid(alpha=0.3)
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, ncols=len(labels), fontsize=8, loc="outside upper center")
    panels[-1, 0].set_xlabel("time [s]")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)
    pyplot.close(figure)
