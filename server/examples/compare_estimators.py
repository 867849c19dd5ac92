"""`python -m server.examples.compare_estimators`: all force estimators on a robot that is 15 % heavier than they believe."""

from pathlib import Path

import numpy as np

from server.client import Console
from server.examples.picture import AXES, TRUE, figure, run_example

MASS_SCALE = 1.15
FORCE_N = (8.0, -6.0, 12.0)
BEFORE_TICKS, SAMPLE_TICKS, SAMPLES = 500, 20, 50


def compare_estimators(console: Console, picture: Path) -> None:
    """Pull at the hand of a heavier robot and draw what each estimator says, and the truth."""
    console.select(scene="free", mass_scale=MASS_SCALE)
    console.pause()
    console.reset(seed=2)
    console.step(BEFORE_TICKS)
    console.push(FORCE_N, duration_s=1.6, ramp_s=0.3)
    states = [console.step(SAMPLE_TICKS) for _ in range(SAMPLES)]
    console.select(mass_scale=1.0)

    time_s = [state.time_s for state in states]
    true = np.array([state.force_true_n for state in states])
    with figure(picture, f"Estimators at mass x{MASS_SCALE:g}", rows=3) as rows:
        for axis, row in enumerate(rows):
            row.plot(time_s, true[:, axis], color=TRUE, linewidth=3, alpha=0.5, label="true" if axis == 0 else None)
            row.set_ylabel(f"{AXES[axis]} [N]")
        for name in states[-1].force_estimates_n:
            force = np.array([state.force_estimates_n[name] for state in states])
            error = np.sqrt(np.mean(np.sum((force - true) ** 2, axis=1)))
            for axis, row in enumerate(rows):
                row.plot(time_s, force[:, axis], linewidth=1, label=f"{name}: {error:.1f} N" if axis == 0 else None)


if __name__ == "__main__":
    run_example(compare_estimators)
