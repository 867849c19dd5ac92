"""Forces of one trial of each task over time, laid out like the paper's figures: asked, estimated, true; below what moved."""

from pathlib import Path

import numpy as np

from sim.trials.task_trial import TaskTrace

_AXES = {"wipe": (2,), "valve": (1, 2), "door": (0, 1), "box": (1, 2), "guidance": (0, 1), "sequence": (0, 1, 2)}
_EVERY = 10


def plot(folder: Path, traces: dict[str, TaskTrace]) -> None:
    """One figure per task."""
    # Plots are optional, so the library is only needed for them.
    from matplotlib import pyplot

    folder.mkdir(parents=True, exist_ok=True)
    for task, trace in traces.items():
        axes = _AXES[task]
        lines = ((trace.true, "true", 2.0), (trace.estimated, "estimated", 1.0), (trace.applied, "asked", 1.0))
        count = len(axes) + 1
        figure, panels = pyplot.subplots(count, 1, figsize=(8, 2.2 * count), sharex=True, layout="constrained")
        time = trace.time_s - trace.time_s[0]
        for panel, axis in zip(panels, axes, strict=False):
            for values, name, width in lines:
                panel.plot(time[::_EVERY], values[::_EVERY, axis], label=name, linewidth=width)
            panel.set(ylabel=f"f{'xyz'[axis]} [N]")
        panels[0].legend(loc="upper right", ncols=3)
        panels[0].set_title(f"{task}: {trace.outcome.name.lower()}")
        last = panels[-1]
        if trace.readings:
            for name, values in trace.readings.items():
                last.plot(time[::_EVERY], values[::_EVERY], label=name)
            last.legend(loc="upper left")
        else:
            last.plot(time[::_EVERY], trace.base[::_EVERY], label=["x [m]", "y [m]", "yaw [rad]"])
            last.legend(loc="upper left")
        last.set(xlabel="time [s]")
        for begin in np.flatnonzero(trace.phase[1:] != trace.phase[:-1]):
            for panel in panels:
                panel.axvline(time[begin], color="0.8", linewidth=0.8, zorder=0)
        figure.savefig(folder / f"{task}.png", dpi=120)
        pyplot.close(figure)
