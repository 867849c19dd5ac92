"""A tick against what it cannot do without, mj_step and the Pinocchio terms: in one process, in alternating blocks."""

import gc
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from control.command.limits import DEFAULT_COMMAND
from control.joints import JOINT_NAMES, NOMINAL_BASE_HEIGHT_M, NOMINAL_POSITION, WHEEL_JOINT_NAMES
from control.pipeline import PipelineConfig
from control.robot_model import RobotModel
from control.timing import SLOT_COUNT, TICK_S
from sim import scenes
from sim.benchmarks.loop_rows import row, value
from sim.benchmarks.report import Report, at_least, at_most
from sim.runtime.simulation import Simulation, SimulationConfig
from sim.runtime.snapshot import SNAPSHOT

ESTIMATOR = "hybrid"
WARM_UP_TICKS = 500
BLOCK = 10 * SLOT_COUNT
"""Calls of one kind in a row: whole control periods, and few enough that all kinds see the same machine."""


@dataclass(frozen=True, slots=True)
class Durations:
    """Of calls, us: (n,) each. Tick k is of slot k modulo SLOT_COUNT."""

    ticks: np.ndarray
    physics: np.ndarray
    terms: np.ndarray

    @property
    def slots(self) -> np.ndarray:
        """(SLOT_COUNT,) median of the ticks of each slot."""
        return np.median(self.ticks.reshape(-1, SLOT_COUNT), axis=0)


def ready_session(seed: int) -> Simulation:
    """A standing robot with the policy and all estimators, whose next tick is of slot 0."""
    session = Simulation(SimulationConfig(seed=seed, pipeline=PipelineConfig(estimator=ESTIMATOR)))
    for _ in range(WARM_UP_TICKS):
        session.tick(DEFAULT_COMMAND)
    return session


def headless(report: Report, ticks: int) -> Durations:
    """Measure, and add rows and bars."""
    session = ready_session(report.seed)
    gc.collect()
    gc.freeze()  # as the control process does
    durations = _alternating(session, ticks)
    record = np.zeros(1, SNAPSHOT)[0]
    snapshots = np.empty(ticks // 10)
    _time(lambda: session.fill(record), snapshots)

    tick = row(report, "headless", "full tick", durations.ticks, "us")
    row(report, "headless", "snapshot", snapshots, "us")
    physics = row(report, "headless", "bare mj_step", durations.physics, "us")
    terms = row(report, "headless", "bare Pinocchio terms", durations.terms, "us")
    ratio = value(report, "headless", "ratio of medians", tick / (physics + terms), "x")
    worst = value(report, "headless", "worst slot over median", durations.slots.max() / tick, "x")
    value(report, "headless", "worst slot over mj_step and Pinocchio terms", durations.slots.max() / (physics + terms), "x")
    factor = value(report, "headless", "real-time factor", 1e6 * TICK_S / durations.ticks.mean(), "x")
    report.bars += [
        at_most("tick over mj_step and Pinocchio terms, ratio of medians", ratio, 4.0, "x"),
        at_most("worst slot of ten over median", worst, 2.0, "x"),
        at_least("headless real-time factor on one core", factor, 6.0, "x"),
    ]
    return durations


def _alternating(session: Simulation, ticks: int) -> Durations:
    calls = (lambda: session.tick(DEFAULT_COMMAND), bare_physics(session.backend.scene), bare_terms(session))
    results = tuple(np.empty(ticks - ticks % BLOCK) for _ in calls)
    for start in range(0, len(results[0]), BLOCK):
        for call, result in zip(calls, results, strict=True):
            _time(call, result[start : start + BLOCK])
    return Durations(*results)


def _time(call: Callable[[], object], out: np.ndarray) -> None:
    """Fill `out` with the duration of a call each, us."""
    for i in range(len(out)):
        start = time.perf_counter()
        call()
        out[i] = 1e6 * (time.perf_counter() - start)


def bare_physics(scene: str) -> Callable[[], None]:
    """mj_step of a scene with the drives of the MJCF holding the nominal posture."""
    model = scenes.build(scene).model
    data = mujoco.MjData(model)
    for name, position in zip(JOINT_NAMES, NOMINAL_POSITION, strict=True):
        data.qpos[model.joint(name).qposadr] = position
        if name not in WHEEL_JOINT_NAMES:
            data.ctrl[model.actuator(name).id] = position
    data.qpos[2] = NOMINAL_BASE_HEIGHT_M
    for _ in range(WARM_UP_TICKS):
        mujoco.mj_step(model, data)
    return lambda: mujoco.mj_step(model, data)


def bare_terms(session: Simulation) -> Callable[[], None]:
    """Update of the Pinocchio model at the session's posture."""
    model = RobotModel()
    sensor, base = session.backend.read(), session.output.base

    def update() -> None:
        model.update(
            base.rotation_base_to_world,
            sensor.joint_position,
            base.linear_velocity_in_base,
            base.angular_velocity_in_base,
            sensor.joint_velocity,
        )

    return update


def plot(folder: Path, durations: Durations) -> None:
    """Draw how long ticks take, apart for those that run the controller."""
    from matplotlib import pyplot  # plots are optional, so the library is only needed for them

    folder.mkdir(parents=True, exist_ok=True)
    figure, axes = pyplot.subplots(figsize=(7, 3.5))
    by_slot = durations.ticks.reshape(-1, SLOT_COUNT)
    bins = np.linspace(0.0, 2000.0, 101).tolist()
    axes.hist(by_slot[:, 0], bins, label="with the 50 Hz controller")
    axes.hist(by_slot[:, 1:].ravel(), bins, alpha=0.6, label="without")
    axes.axvline(1e6 * TICK_S, color="black", linewidth=1.0)
    axes.set(xlabel="tick [us]", ylabel="ticks", title="Duration of a tick, headless")
    axes.legend()
    figure.tight_layout()
    figure.savefig(folder / "loop.png", dpi=150)
    pyplot.close(figure)
