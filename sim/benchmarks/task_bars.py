"""The limits that the benchmark of tasks knows, each against the worst or the mean of its trials, and the paper's figures."""

from collections.abc import Sequence

import numpy as np

from sim.benchmarks.report import Report, Row, at_least, at_most

TRAVEL_M = 0.2


def add_bars(report: Report) -> None:
    """The bars of every task that was played."""
    for task, add in _OF_TASK.items():
        rows = [row for row in report.rows if row["task"] == task]
        if rows:
            add(report, rows)


def _mean(rows: Sequence[Row], key: str) -> float:
    """Mean over the trials that got so far."""
    values = np.array([row[key] for row in rows], float)
    return float(np.nanmean(values)) if np.isfinite(values).any() else float("nan")


def _worst(rows: Sequence[Row], key: str) -> float:
    return float(np.max(np.array([row[key] for row in rows], float)))


def _least(rows: Sequence[Row], key: str) -> float:
    return float(np.min(np.array([row[key] for row in rows], float)))


def _successes(report: Report, rows: Sequence[Row], name: str, share: float = 1.0) -> None:
    good = sum(bool(row["success"]) for row in rows)
    report.bars.append(at_least(f"{name}: succeeded, of {len(rows)}", good, share * len(rows), "trials"))


def _wipe(report: Report, rows: list[Row]) -> None:
    _successes(report, rows, "wipe")
    report.bars += [
        at_most("wipe: planar position RMSE (paper 2.90)", _mean(rows, "position_rmse_cm"), 1.2, "cm"),
        at_most("wipe: normal force control RMSE (paper 2.13)", _mean(rows, "control_rmse_n"), 0.6, "N"),
        at_most("wipe: normal force estimate RMSE (paper 2.74)", _mean(rows, "estimate_rmse_n"), 0.6, "N"),
        at_least("wipe: share of time in contact", _mean(rows, "contact_share"), 0.99, ""),
    ]


def _valve(report: Report, rows: list[Row]) -> None:
    _successes(report, rows, "valve")
    papers = {
        ("control", "place"): (3.99, 3.15),
        ("estimate", "place"): (4.91, 4.12),
        ("control", "drive"): (5.82, 5.42),
        ("estimate", "drive"): (6.47, 6.38),
    }
    for (kind, name), figures in papers.items():
        for axis, paper in zip("yz", figures, strict=True):
            label = f"valve, {name}: {kind} RMSE {axis} (paper {paper})"
            limit = 0.6 if name == "place" else 0.8
            report.bars.append(at_most(label, _mean(rows, f"{kind}_{axis}_{name}_n"), limit, "N"))
    report.bars += [
        at_least("valve, place: least turned", _least(rows, "turned_place_rad"), 2.0 * np.pi, "rad"),
        at_least("valve, drive: least way of the base", _least(rows, "base_travel_m"), 0.25, "m"),
        at_least("valve, drive: least turn of the base", _least(rows, "base_turn_rad"), 0.4, "rad"),
        at_most("valve, drive: longest stop", _worst(rows, "longest_stop_s"), 1.0, "s"),
    ]


def _door(report: Report, rows: list[Row]) -> None:
    for spring, share in ((1.0, 1.0), (2.0, 0.9)):
        mine = [row for row in rows if row["spring_scale"] == spring]
        if not mine:
            continue
        through = sum(bool(row["passed"] and row["success"] and float(row["duration_s"] or 99.0) <= 30.0) for row in mine)
        name = f"door, spring x{spring:g}"
        report.bars += [
            at_least(f"{name}: through within 30 s, of {len(mine)}", through, share * len(mine), "trials"),
            at_most(f"{name}: largest force, mean of 20 ms", _worst(mine, "peak_force_n"), 35.0, "N"),
            at_most(f"{name}: trials where more than the tool touched", sum(bool(row["touched"]) for row in mine), 0, "trials"),
        ]


def _box(report: Report, rows: list[Row]) -> None:
    _successes(report, rows, "box")
    off = max(max(abs(float(row["y_min_m"] or 0.0) + TRAVEL_M), abs(float(row["y_max_m"] or 0.0) - TRAVEL_M)) for row in rows)
    report.bars += [
        at_most("box: lateral force RMSE (paper 0.98)", _mean(rows, "e_y_n"), 0.6, "N"),
        at_most("box: vertical force RMSE (paper 3.98)", _mean(rows, "e_z_n"), 0.7, "N"),
        at_most("box: extrema off +-0.2 m (paper 0.020)", off, 0.015, "m"),
    ]


def _guidance(report: Report, rows: list[Row]) -> None:
    _successes(report, rows, "guidance")
    followed = sum(bool(row["followed"]) for row in rows)
    report.bars += [
        at_least(f"guidance: followed, of {len(rows)}", followed, len(rows), "trials"),
        at_most("guidance: falls", sum(bool(row["fell"]) for row in rows), 0, "trials"),
        at_most("guidance: largest force of a lead", _worst(rows, "lead_force_n"), 13.0, "N"),
        at_most("guidance: drift in 10 s after release", _worst(rows, "drift_cm"), 1.0, "cm"),
    ]


def _sequence(report: Report, rows: list[Row]) -> None:
    whole = sum(bool(row["success"] and row["steps_done"] == row["steps"]) for row in rows)
    report.bars.append(at_least(f"sequence: all steps without a hand, of {len(rows)}", whole, 0.8 * len(rows), "trials"))


_OF_TASK = {"wipe": _wipe, "valve": _valve, "door": _door, "box": _box, "guidance": _guidance, "sequence": _sequence}
