"""Picture of a training run."""

from pathlib import Path


class PlottingError(RuntimeError):
    """matplotlib is not installed."""


def save_curves(path: Path, title: str, losses: list[float], validation_rmse: list[float], reference: float | None) -> None:
    """Training loss and validation RMSE over epochs; `reference` (N) is the error without the network, if there is one.

    Raises:
        PlottingError: matplotlib is missing.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise PlottingError('curves need matplotlib; install it with `pip install -e ".[train]"`') from error
    figure = Figure(figsize=(7.0, 3.2), layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    epochs = range(1, len(losses) + 1)
    left.plot(epochs, losses)
    left.set(xlabel="epoch", ylabel="training loss")
    right.plot(epochs, validation_rmse, label="with network")
    if reference is not None:
        right.axhline(reference, color="gray", linestyle="--", label="nominal alone")
        right.legend()
    right.set(xlabel="epoch", ylabel="validation vector RMSE [N]", ylim=(0.0, None))
    figure.suptitle(title)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)
