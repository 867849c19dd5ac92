"""Picture of a policy's training: imitation loss, reward per head, and the score of its checkpoints."""

from pathlib import Path
from typing import Any

from control.learning.curves import PlottingError


def save_policy_curves(path: Path, title: str, history: dict[str, list[dict[str, Any]]], reference: float | None) -> None:
    """Draw what a run has logged.

    Args:
        path: of the picture.
        title: of the picture.
        history: lists of records with "steps": "imitation" (with "loss"), "ppo" ("reward", "kl") and "score" ("total").
        reference: score of the model-based controller, if known.

    Raises:
        PlottingError: matplotlib is missing.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise PlottingError('curves need matplotlib; install it with `pip install -e ".[train]"`') from error
    panels = 3 if history["imitation"] else 2
    figure = Figure(figsize=(3.7 * panels, 3.4), layout="constrained")
    FigureCanvasAgg(figure)
    *imitations, reward, score = figure.subplots(1, panels)
    for imitation in imitations:
        imitation.plot(*_series(history["imitation"], "loss"))
        imitation.set(xlabel="steps", ylabel="imitation loss", yscale="log")
    steps, rewards = _series(history["ppo"], "reward")
    for head, name in enumerate(("locomotion", "end effector")):
        reward.plot(steps, [value[head] for value in rewards], label=name)
    reward.set(xlabel="steps", ylabel="reward per step")
    reward.legend()
    score.plot(*_series(history["score"], "total"), marker="o", label="policy")
    if reference is not None:
        score.axhline(reference, color="gray", linestyle="--", label="model-based")
    score.set(xlabel="steps", ylabel="score (1: at the bars)", ylim=(0.0, None))
    score.legend()
    figure.suptitle(title)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)


def _series(records: list[dict[str, Any]], key: str) -> tuple[list[int], list[Any]]:
    return [record["steps"] for record in records], [record[key] for record in records]
