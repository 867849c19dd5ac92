"""What the examples share: their two arguments, and a figure that becomes a file."""

import argparse
import contextlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from server.client import DEFAULT_ADDRESS, Console

AXES = ("x", "y", "z")
COMMANDED, ESTIMATED, TRUE = "#e69f00", "#009e73", "#5b6573"
"""Colours of forces, as in the page."""


def run_example(example: Callable[[Console, Path], None], arguments: Sequence[str] | None = None) -> None:
    """Run an example from the command line.

    Args:
        example: acts on a console and writes a picture.
        arguments: of the command; None: this process's.
    """
    parser = argparse.ArgumentParser(description=example.__doc__)
    parser.add_argument("--console", help=f"its address (default FORCELENS_ADDRESS, or {DEFAULT_ADDRESS})")
    parser.add_argument(
        "--picture", type=Path, default=Path(f"{example.__name__}.png"), help="file to draw into (default %(default)s)"
    )
    given = parser.parse_args(arguments)
    with Console(given.console) as console:
        example(console, given.picture)


@contextlib.contextmanager
def figure(path: Path, title: str, rows: int = 1) -> Iterator[list[Any]]:
    """Axes of matplotlib, one per row, with time below; the picture is written when the context ends."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    drawn, axes = pyplot.subplots(rows, 1, sharex=True, squeeze=False, figsize=(7.5, 1.6 + 1.9 * rows), layout="constrained")
    drawn.suptitle(title, fontsize=12)
    yield [row[0] for row in axes]
    for row in axes:
        row[0].grid(alpha=0.3)
        if row[0].get_legend_handles_labels()[1]:
            row[0].legend(loc="upper left", fontsize=8, ncols=3)
    axes[-1][0].set_xlabel(axes[-1][0].get_xlabel() or "time [s]")
    drawn.savefig(path, dpi=100)
    pyplot.close(drawn)
