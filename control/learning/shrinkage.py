"""How far a correction is trusted: the noise of Wiener's gain, chosen on validation so that learning harms no kind of rollout.

A correction c is shrunk by c^2 / (c^2 + noise^2) (control.estimation.networks.force_network). More noise
means less correction: less gained where
the network is right, less lost where it is wrong.
"""

from collections.abc import Callable, Iterable

import numpy as np

from control.learning.evaluation import Prediction, relative_error

NOISES_N = (0.0, 0.03, 0.06, 0.1, 0.15, 0.2, 0.3, 0.5, 1.0)


def choose_output_noise(predict_with: Callable[[float], Iterable[list[Prediction]]]) -> float:
    """The noise N of NOISES_N with the least relative error on average among those with which no cell is worse than nominal.

    Where there is none, the one whose worst cell is the least worse.

    Args:
        predict_with: predictions of the validation rollouts, by cell, for a noise.
    """
    figures = {}
    for noise in NOISES_N:
        ratios = [relative_error(cell) for cell in predict_with(noise)]
        figures[noise] = (max(ratios), float(np.mean(ratios)))
    harmless = [noise for noise, (worst, _) in figures.items() if worst <= 1.0]
    if harmless:
        return min(harmless, key=lambda noise: figures[noise][1])
    return min(figures, key=lambda noise: figures[noise][0])
