"""The common form of every benchmark: arguments, progress, table, and one JSON file with rows and bars."""

import argparse
import json
import math
import shlex
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from control.files import write_whole
from control.provenance import commit, machine

Row = dict[str, str | int | float | bool | None]


@dataclass(frozen=True, slots=True)
class Bar:
    """A limit and what was measured: `holds` says whether `value` is on the right side of `limit`."""

    name: str
    value: float
    limit: float
    unit: str
    holds: bool


def at_most(name: str, value: float, limit: float, unit: str) -> Bar:
    """A bar that holds when `value <= limit`; NaN never holds."""
    return Bar(name, value, limit, unit, bool(value <= limit))


def at_least(name: str, value: float, limit: float, unit: str) -> Bar:
    """A bar that holds when `value >= limit`; NaN never holds."""
    return Bar(name, value, limit, unit, bool(value >= limit))


def argument_parser(description: str) -> argparse.ArgumentParser:
    """Parser with the arguments that every benchmark takes."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--seed", type=int, default=1000, help="seed of everything random (default 1000)")
    parser.add_argument("--quick", action="store_true", help="a few seconds, to see that it runs")
    parser.add_argument("--json", type=Path, metavar="PATH", help="write rows and bars to this file")
    parser.add_argument("--plot", type=Path, metavar="DIR", help="write pictures into this folder")
    return parser


@dataclass(slots=True)
class Report:
    """Collects rows and bars of one run, prints them and writes the JSON file.

    `summaries` condense rows of single trials, where a benchmark has those; they are written beside the rows.
    """

    benchmark: str
    seed: int
    rows: list[Row] = field(default_factory=list)
    summaries: list[Row] = field(default_factory=list)
    bars: list[Bar] = field(default_factory=list)
    started: str = field(default_factory=lambda: datetime.now(UTC).isoformat(timespec="seconds"))
    _start_s: float = field(default_factory=time.perf_counter)

    def progress(self, text: str) -> None:
        """One progress line on stderr, so that stdout holds the result alone."""
        print(f"[{time.perf_counter() - self._start_s:6.1f} s] {text}", file=sys.stderr, flush=True)

    def finish(self, json_path: Path | None) -> None:
        """Print the table (summaries where there are any, else rows) and the bars, and with a path write all of it as JSON."""
        print(format_table(self.summaries or self.rows))
        if self.bars:
            print()
            print(format_table([_without_nan(asdict(bar)) for bar in self.bars]))
        if json_path is not None:
            content = {
                "benchmark": self.benchmark,
                "commit": commit(),
                "command": shlex.join([Path(sys.executable).name, "-m", f"sim.benchmarks.{self.benchmark}", *sys.argv[1:]]),
                "seed": self.seed,
                "machine": machine(),
                "started": self.started,
                "duration_s": round(time.perf_counter() - self._start_s, 1),
                "rows": [_without_nan(row) for row in self.rows],
                **({"summaries": [_without_nan(row) for row in self.summaries]} if self.summaries else {}),
                "bars": [_without_nan(asdict(bar)) for bar in self.bars],
            }
            write_whole(json_path, json.dumps(content, indent=1) + "\n")


def format_table(rows: Sequence[dict[str, Any]]) -> str:
    """Plain text table; columns are the union of the rows' keys in first-seen order."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    cells = [columns] + [[_cell(row.get(column)) for column in columns] for row in rows]
    widths = [max(len(line[i]) for line in cells) for i in range(len(columns))]
    return "\n".join("  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)) for line in cells)


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.3g}" if abs(value) < 100 else f"{value:.0f}"
    return str(value)


def _without_nan(row: dict[str, Any]) -> dict[str, Any]:
    return {key: None if isinstance(value, float) and not math.isfinite(value) else value for key, value in row.items()}
