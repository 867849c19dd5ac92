"""How far a correction is trusted: the noise of Wiener's gain, chosen on validation so that learning harms no rollout.

A correction c is shrunk by c^2 / (c^2 + noise^2) (control.network_weights). More noise means less correction: less gained where
the network is right, less lost where it is wrong.
"""

from collections.abc import Callable

from control.learning.evaluation import Prediction, mean_rmse, vector_rmse

NOISES_N = (0.0, 0.03, 0.06, 0.1, 0.15, 0.2, 0.3, 0.5, 1.0)


def worst_ratio(predictions: list[Prediction]) -> float:
    """Largest over rollouts of the vector RMSE over that of the nominal estimate.

    Raises:
        ValueError: a prediction corrects no nominal estimate.
    """
    ratios = []
    for prediction in predictions:
        if prediction.nominal_error is None:
            raise ValueError("only a network that corrects a nominal estimate can be compared with it")
        ratios.append(vector_rmse(prediction.error) / vector_rmse(prediction.nominal_error))
    return max(ratios)


def choose_output_noise(predict_with: Callable[[float], list[Prediction]]) -> float:
    """The noise N of NOISES_N with the least mean error among those with which no rollout is worse than nominal.

    Where there is none, the one whose worst rollout is the least worse.

    Args:
        predict_with: predictions of the validation rollouts for a noise.
    """
    figures = {}
    for noise in NOISES_N:
        predictions = predict_with(noise)
        figures[noise] = (worst_ratio(predictions), mean_rmse(predictions))
    harmless = [noise for noise, (worst, _) in figures.items() if worst <= 1.0]
    if harmless:
        return min(harmless, key=lambda noise: figures[noise][1])
    return min(figures, key=lambda noise: figures[noise][0])
