"""Rows of the loop benchmark: `{case, metric, p50, p99, max, unit}`."""

import numpy as np

from sim.benchmarks.report import Report


def row(report: Report, case: str, metric: str, values: np.ndarray, unit: str) -> float:
    """Add p50, p99 and max of `values`; returns p50."""
    p50, p99 = np.percentile(values, [50, 99])
    report.rows.append(
        {"case": case, "metric": metric, "p50": float(p50), "p99": float(p99), "max": float(values.max()), "unit": unit}
    )
    return float(p50)


def value(report: Report, case: str, metric: str, figure: float, unit: str) -> float:
    """Add a row of one figure."""
    report.rows.append({"case": case, "metric": metric, "p50": figure, "p99": None, "max": None, "unit": unit})
    return figure
