"""What one trial of a task achieved, as a row of the benchmark; keys are the contract's."""

from collections.abc import Callable

import numpy as np

from control.timing import SLOT_COUNT, TICK_S
from sim.benchmarks.report import Row
from sim.tasks.runner import Outcome
from sim.trials.task_trial import TaskPlan, TaskTrace

SETTLED_S = 1.0
"""Of a phase that is not scored: the force is still on its way."""
FOLLOWED_M = 0.35
"""Of the half metre of a lead: the hand follows it a little behind."""
STOPPED_RPS = 0.05
_X, _Y, _Z = range(3)


def row(plan: TaskPlan, trace: TaskTrace) -> Row:
    """One row."""
    return {
        "task": plan.task,
        "controller": plan.controller,
        "seed": plan.seed,
        "contact": "rigid" if plan.rigid else "padded",
        "success": trace.outcome == Outcome.SUCCEEDED and not trace.fell,
        "reason": trace.reason,
        "duration_s": round(trace.seconds, 2),
        "fell": trace.fell,
        "peak_force_n": peak(trace.true),
        **_OF_TASK[plan.task](plan, trace),
    }


def peak(force: np.ndarray) -> float:
    """Largest size of a force (n, 3) averaged over 20 ms."""
    if len(force) < SLOT_COUNT:
        return float("nan")
    sums = np.cumsum(np.vstack([np.zeros(3), force]), axis=0)
    return float(np.linalg.norm(sums[SLOT_COUNT:] - sums[:-SLOT_COUNT], axis=1).max()) / SLOT_COUNT


def rms(values: np.ndarray) -> float:
    """Root mean square; NaN of nothing."""
    return float(np.sqrt(np.mean(np.square(values)))) if np.size(values) else float("nan")


def _control(trace: TaskTrace, where: np.ndarray, axis: int) -> float:
    return rms((trace.true - trace.applied)[where, axis])


def _estimate(trace: TaskTrace, where: np.ndarray, axis: int) -> float:
    return rms((trace.true - trace.estimated)[where, axis])


def _wipe(_: TaskPlan, trace: TaskTrace) -> Row:
    where = trace.during("wipe", after_s=SETTLED_S)
    off = np.linalg.norm((trace.hand_m[:, :2] - trace.target_m)[where], axis=1)
    return {
        "position_rmse_cm": 100.0 * rms(off),
        "control_rmse_n": _control(trace, where, _Z),
        "estimate_rmse_n": _estimate(trace, where, _Z),
        "contact_share": float(np.mean(trace.true[where, _Z] > 0.5)) if where.any() else 0.0,
        "wiped_share": float(trace.readings["wiped_share"][-1]),
    }


def _valve(_: TaskPlan, trace: TaskTrace) -> Row:
    angle = trace.readings["valve_angle_rad"]
    result: Row = {}
    for name in ("place", "drive"):
        all_of, where = trace.during(name), trace.during(name, after_s=SETTLED_S)
        result[f"turned_{name}_rad"] = float(abs(angle[all_of][-1] - angle[all_of][0])) if all_of.any() else 0.0
        for axis, index in (("y", _Y), ("z", _Z)):
            result[f"control_{axis}_{name}_n"] = _control(trace, where, index)
            result[f"estimate_{axis}_{name}_n"] = _estimate(trace, where, index)
    driving = trace.during("drive", after_s=SETTLED_S)
    base = trace.base[driving]
    result["base_travel_m"] = float(np.ptp(base[:, 0])) if len(base) else 0.0
    result["base_turn_rad"] = float(np.ptp(base[:, 2])) if len(base) else 0.0
    still = np.abs(np.gradient(angle, TICK_S)) < STOPPED_RPS
    result["longest_stop_s"] = _longest(still[driving]) if len(base) else float("nan")
    return result


def _longest(holds: np.ndarray) -> float:
    """Seconds of the longest run of ticks at which something holds."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]]).astype(int)))
    return TICK_S * float(np.max(edges[1::2] - edges[::2], initial=0))


def _door(plan: TaskPlan, trace: TaskTrace) -> Row:
    touched = [key for key in trace.touched]
    return {
        "opened_rad": float(trace.readings["door_angle_rad"].max()),
        "passed": bool(trace.base[-1, 0] - 0.28 > 0.86),
        "spring_scale": plan.parameters.get("spring_scale", 1.0),
        "touched": "; ".join(touched),
    }


def _box(plan: TaskPlan, trace: TaskTrace) -> Row:
    where = trace.during("drag", after_s=0.5)
    place = trace.readings["box_position_m"][trace.during("drag")]
    place = place - place[0] if len(place) else np.zeros(1)
    return {
        "mass_scale": plan.mass_scale,
        "e_y_n": _control(trace, where, _Y),
        "e_z_n": _control(trace, where, _Z),
        "y_min_m": float(place.min()),
        "y_max_m": float(place.max()),
    }


def _guidance(_: TaskPlan, trace: TaskTrace) -> Row:
    rest = trace.base[trace.during("rest", after_s=2.0)]
    drift = np.linalg.norm(rest[:, :2] - rest[0, :2], axis=1).max() if len(rest) else float("nan")
    return {
        "followed": bool(trace.leads) and all(progress >= FOLLOWED_M for progress, _ in trace.leads),
        "leads": len(trace.leads),
        "least_progress_m": min((progress for progress, _ in trace.leads), default=float("nan")),
        "lead_force_n": max((force for _, force in trace.leads), default=float("nan")),
        "drift_cm": 100.0 * float(drift),
    }


def _sequence(_: TaskPlan, trace: TaskTrace) -> Row:
    return {
        "steps_done": int(trace.metrics["steps_done"]),
        "steps": int(trace.metrics["steps"]),
        "tries": int(trace.metrics["tries"]),
        "valve_angle_rad": float(np.abs(trace.readings["valve_angle_rad"]).max()),
        "wiped_share": float(trace.readings["wiped_share"][-1]),
        "door_angle_rad": float(trace.readings["door_angle_rad"].max()),
        "touched": "; ".join(trace.touched),
    }


_OF_TASK: dict[str, Callable[[TaskPlan, TaskTrace], Row]] = {
    "wipe": _wipe,
    "valve": _valve,
    "door": _door,
    "box": _box,
    "guidance": _guidance,
    "sequence": _sequence,
}
