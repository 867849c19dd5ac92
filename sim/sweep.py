"""Run a grid, on local processes or a Ray cluster, into one table and a plot: `python -m sim.sweep --help`.

    python -m sim.sweep --out runs/masses --grid controller=policy,model_based mass_scale=0.8,1.0,1.2 seed=1,2 minutes=0.5
    python -m sim.sweep --out runs/drag --benchmark box_drag --grid seed=1,2,3 -- --quick
    python -m sim.sweep --out runs/again --recording push.mcap --grid estimator=gmo_pi,gmo_cqp gains=6:20,12:80

Each cell of the grid is a call of `sim.trials.sweep_trial`, of the function that `--function` names, or of a benchmark with the
cell as its options; or, over recordings, an estimator from one of their keyframes to the next. Every cell that is done is a
file, so the same command goes on where it was cut off.
"""

import argparse
import csv
import hashlib
import importlib
import io
import itertools
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from control.files import write_whole
from sim.processes.executors import EXECUTOR_NAMES, map_unordered
from sim.trials.recording_trial import keyframe_times

TRIAL = "sim.trials.sweep_trial:sweep_trial"
RECORDING_TRIAL = "sim.trials.recording_trial:recording_trial"
FORMATS = ("csv", "parquet")

Cell = dict[str, str | int | float]
Row = dict[str, Any]


class SweepError(ValueError):
    """A sweep that cannot be made or drawn; the message says why."""


@dataclass(frozen=True, slots=True)
class Job:
    """One cell: how it is run, with what, and the file that its rows are kept in; picklable."""

    cell: Cell
    file: Path
    function: str
    benchmark: str | None = None
    further: tuple[str, ...] = ()


def parse_grid(words: Sequence[str]) -> dict[str, list[str | int | float]]:
    """Values by key, of words like `mass_scale=0.8,1.0`.

    Raises:
        SweepError: a word of another form.
    """
    grid = {}
    for word in words:
        key, equals, values = word.partition("=")
        if not (key.isidentifier() and equals and values):
            raise SweepError(f"{word!r} is not of the form key=value,value")
        grid[key] = [_value(text) for text in values.split(",")]
    return grid


def _value(text: str) -> str | int | float:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def cells(grid: dict[str, list[Any]]) -> Iterator[Cell]:
    """All combinations, the last key varying first."""
    for values in itertools.product(*grid.values()):
        yield dict(zip(grid, values, strict=True))


def recording_parts(files: Sequence[Path]) -> list[Cell]:
    """A cell for each keyframe of each recording.

    Raises:
        SweepError: a file is no recording.
    """
    try:
        return [{"recording": str(file), "from_s": time_s} for file in files for time_s in keyframe_times(str(file))]
    except (ValueError, OSError) as error:
        raise SweepError(str(error)) from error


def run_cell(job: Job) -> tuple[Job, list[Row], str]:
    """Run one cell, wherever this is; its rows, and why it failed, empty if it did not."""
    try:
        rows = _benchmark_rows(job) if job.benchmark else _function_rows(job)
    except Exception as error:  # one cell that fails must not cost the others
        return job, [], f"{job.cell}: {type(error).__name__}: {error}"
    return job, [job.cell | row for row in rows], ""


def _function_rows(job: Job) -> list[Row]:
    module, _, name = job.function.partition(":")
    result = getattr(importlib.import_module(module), name)(**job.cell)
    return result if isinstance(result, list) else [result]


def _benchmark_rows(job: Job) -> list[Row]:
    options = [word for key, value in job.cell.items() for word in (f"--{key.replace('_', '-')}", str(value))]
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        command = [sys.executable, "-m", f"sim.benchmarks.{job.benchmark}", "--json", str(report), *options, *job.further]
        ended = subprocess.run(command, capture_output=True, text=True)
        if ended.returncode:
            raise SweepError((ended.stderr.strip().splitlines() or ["no output"])[-1])
        return json.loads(report.read_text())["rows"]


def sweep(jobs: Sequence[Job], executor: str, workers: int, address: str | None, tell: Any) -> list[str]:
    """Run the cells that are not done; why some failed."""
    left = [job for job in jobs if not job.file.exists()]
    if len(left) < len(jobs):
        tell(f"{len(jobs) - len(left)} of {len(jobs)} cells are done already")
    failures = []
    results = map_unordered(executor, run_cell, left, workers, address)
    for count, (job, rows, failure) in enumerate(results, len(jobs) - len(left) + 1):
        tell(f"{count} of {len(jobs)}" + (f": failed: {failure}" if failure else ""))
        if failure:
            failures.append(failure)
        else:
            write_whole(job.file, json.dumps(rows))
    return failures


def write_table(rows: Sequence[Row], path: Path) -> None:
    """One table, as CSV or by its ending as Parquet.

    Raises:
        SweepError: Parquet without pyarrow.
    """
    columns = list(dict.fromkeys(key for row in rows for key in row))
    if path.suffix == ".parquet":
        try:
            import pyarrow  # pyright: ignore[reportMissingImports]
            import pyarrow.parquet  # pyright: ignore[reportMissingImports]
        except ImportError:
            raise SweepError("Parquet needs pyarrow: `pip install pyarrow`, or take --format csv") from None
        pyarrow.parquet.write_table(pyarrow.table({key: [row.get(key) for row in rows] for key in columns}), path)
        return
    text = io.StringIO()
    writer = csv.DictWriter(text, columns)
    writer.writeheader()
    writer.writerows(rows)
    write_whole(path, text.getvalue())


def draw(rows: Sequence[Row], grid: dict[str, list[Any]], path: Path, x: str | None, y: str | None) -> None:
    """Mean and range of `y` over `x`, a line for each combination of what else was swept but the seed.

    Raises:
        SweepError: no such column, or none that can be drawn.
    """
    swept = [key for key, values in grid.items() if len(values) > 1 and key != "seed"]
    ordered = [key for key in swept if all(isinstance(value, int | float) for value in grid[key])]
    x = x or [*ordered, *swept, *grid][0]
    numbers = [key for key, value in rows[0].items() if key not in grid and isinstance(value, int | float)]
    y = y or next(iter(numbers), None)
    if y is None or not {x, y} <= rows[0].keys():
        raise SweepError(f"cannot draw {y} over {x}; there is {', '.join(rows[0])}")
    lines: dict[str, dict[Any, list[float]]] = {}
    for row in rows:
        name = ", ".join(f"{key}={row[key]}" for key in swept if key != x) or y
        if row.get(y) is not None:
            lines.setdefault(name, {}).setdefault(row[x], []).append(float(row[y]))

    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(7.5, 4.5), layout="constrained")
    for name, points in lines.items():
        means = [float(np.mean(values)) for values in points.values()]
        spread = [[m - min(v) for m, v in zip(means, points.values(), strict=True)]]
        spread.append([max(v) - m for m, v in zip(means, points.values(), strict=True)])
        axes.errorbar(list(points), means, spread, marker="o", capsize=3, label=name)
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    figure.savefig(path, dpi=110)
    pyplot.close(figure)


def parser() -> argparse.ArgumentParser:
    """Arguments of the command."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--out", type=Path, required=True, help="folder of the sweep")
    arguments.add_argument("--grid", nargs="+", required=True, metavar="KEY=VALUE,...", help="what is varied")
    what = arguments.add_mutually_exclusive_group()
    what.add_argument("--benchmark", metavar="NAME", help="of sim.benchmarks; what follows -- are further options of it")
    what.add_argument("--function", default=TRIAL, metavar="MODULE:NAME", help="gives a row, or rows (default %(default)s)")
    what.add_argument("--recording", nargs="+", type=Path, metavar="FILE", help="an estimator over each, by keyframes")
    arguments.add_argument("--executor", choices=EXECUTOR_NAMES, default="local")
    arguments.add_argument("--workers", type=int, default=1, help="cells at a time (default 1)")
    arguments.add_argument("--address", help="of a running Ray cluster")
    arguments.add_argument("--format", choices=FORMATS, default="csv", help="of the table (default csv)")
    arguments.add_argument("--x", help="column of the plot (default: the first number that is varied)")
    arguments.add_argument("--y", help="column of the plot (default: the first result)")
    arguments.add_argument("further", nargs="*", metavar="-- OPTION", help="further options of the benchmark")
    return arguments


def main(words: Sequence[str] | None = None) -> int:
    """Command line; the exit status is 1 where a cell failed, which the next run tries again."""
    options = parser().parse_args(words)
    try:
        grid = parse_grid(options.grid)
        folder = options.out / "cells"
        folder.mkdir(parents=True, exist_ok=True)
        function, combinations = options.function, list(cells(grid))
        if options.recording:
            parts = recording_parts(options.recording)
            function, combinations = RECORDING_TRIAL, [part | cell for part in parts for cell in combinations]
            grid = {key: list(dict.fromkeys(part[key] for part in parts)) for key in ("recording", "from_s")} | grid
        jobs = []
        for cell in combinations:
            said = json.dumps([cell, function, options.benchmark, options.further], sort_keys=True)
            file = folder / f"{hashlib.sha256(said.encode()).hexdigest()[:20]}.json"
            jobs.append(Job(cell, file, function, options.benchmark, tuple(options.further)))
        failures = sweep(jobs, options.executor, options.workers, options.address, _tell)
        rows = [row for job in jobs if job.file.exists() for row in json.loads(job.file.read_text())]
        if rows:
            write_table(rows, options.out / f"table.{options.format}")
            draw(rows, grid, options.out / "plot.png", options.x, options.y)
    except SweepError as error:
        _tell(str(error))
        return 2
    return 1 if failures else 0


def _tell(text: str) -> None:
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()


if __name__ == "__main__":
    sys.exit(main())
