"""Golden data of the pipeline: what it made of ten recorded seconds, to compare every later version with.

    python tests/golden/golden_pipeline.py tests/golden/pipeline.npz

simulates the TAKES and records them anew. The shipped file was made when the laws had just been compiled: 5000 ticks of that
code equalled those of the numpy code before it (commit f7c8db5) to 1e-9, and 1e-5 behind a network. Since then the legs prepare
for what is felt, and hands that are asked for no force yield within borders; the targets are a `replay` of those frames
by a policy that was trained anew. Record anew only where a law changes on purpose, and say so.

The loop is closed while recording and open in a replay: the recorded frames go in, whatever comes out. Frames are rounded to
single precision, which keeps the file small, before the recording pipeline sees them: both see exactly the same numbers.
"""

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from control.command.limits import DEFAULT_COMMAND
from control.estimation.base_state import BaseStateConfig
from control.estimation.registry import LEARNED_NAMES, MODEL_BASED_NAMES
from control.pipeline import Pipeline, PipelineConfig, PipelineOutput
from control.types import Command, SensorFrame
from sim.backends.simulation.mismatch import Mismatch
from sim.backends.simulation.mujoco_backend import MujocoBackend
from sim.backends.simulation.wrenches import Pulse

GOLDEN = Path(__file__).with_name("pipeline.npz")
TICK_S, CONTROL_TICKS = 0.002, 10
ASKED_SLOT = 5
"""Tick of a control period at which every model-based estimator is asked, whenever it is shown: it remembers no answer."""


@dataclass(frozen=True, slots=True)
class Take:
    """A stretch of ticks that begins with a pipeline as at power-on.

    Attributes:
        ticks: its length.
        controller, estimator: selected at the start.
        actions: what the operator does, by tick: a Command from then on, or something else done to the pipeline.
        scene, mass_scale, pulses: of the simulation while recording; pulses by tick.
        broken: tick at which the frame holds a joint velocity that is no number; None for never.
    """

    ticks: int
    controller: str
    estimator: str
    actions: dict[int, Command | Callable[[Pipeline], None]]
    scene: str = "free"
    mass_scale: float = 1.0
    pulses: dict[int, Pulse] | None = None
    broken: int | None = None


def ask(**changes: tuple[float, ...]) -> Command:
    """The default command but for `changes`."""
    return replace(DEFAULT_COMMAND, **{name: np.array(values) for name, values in changes.items()})


def press(force_z: float, force_y: float | None = None) -> Command:
    """Hand on the box, pushed down by it with `force_z` N and, unless None, held sideways by force."""
    mask = (0.0, float(force_y is not None), 1.0)
    return ask(
        position_m=(0.55, 0.0, 0.45),
        orientation_wxyz=(0.8776, 0.0, 0.4794, 0.0),
        mask=mask,
        force_n=(0.0, force_y or 0.0, force_z),
    )


PUSH, SHOVE = np.array([12.0, -8.0, 8.0]), np.array([20.0, 5.0, -6.0])
BIASED = BaseStateConfig(standing_crossover_s=1.0, bias_rate=0.0, standing_bias_rate=0.0)
"""The base state as it was, with the bias of the IMU in it."""

FREE = Take(
    2500,
    "policy",
    "hybrid",
    {
        150: ask(position_m=(0.5, 0.15, 0.5), orientation_wxyz=(0.9, 0.2, 0.3, 0.1)),
        450: ask(base_velocity=(0.4, 0.0, 0.3)),
        850: ask(mask=(1.0, 0.0, 1.0), force_n=(8.0, 0.0, -10.0)),
        1200: ask(mask=(0.0, 1.0, 0.0), force_n=(0.0, 12.0, 0.0), base_velocity=(-0.2, 0.0, 0.0)),
        1500: replace(DEFAULT_COMMAND, guidance=True),
        1900: ask(mask=(1.0, 1.0, 1.0), force_n=(40.0, 40.0, -40.0)),
        2050: lambda pipeline: pipeline.estop(),
        2100: lambda pipeline: pipeline.clear_estop(),
        2101: DEFAULT_COMMAND,
    },
    mass_scale=1.1,
    pulses={
        900: Pulse(PUSH, 0.8, ramp_s=0.1),
        1300: Pulse(np.array((0.0, 25.0, 0.0)), 0.3, body="base", ramp_s=0.05),
        1550: Pulse(SHOVE, 0.6, ramp_s=0.1),
        2300: Pulse(PUSH, 0.2, ramp_s=0.02),
    },
    broken=2405,
)
MODEL_BASED = Take(
    1000,
    "model_based",
    "adaptive",
    {
        100: ask(base_velocity=(0.3, 0.0, -0.4), position_m=(0.6, -0.2, 0.7)),
        400: ask(mask=(1.0, 1.0, 1.0), force_n=(5.0, -6.0, 12.0)),
        600: lambda pipeline: pipeline.select_estimator("gmo_pi", (8.0, 30.0)),
        750: ask(base_velocity=(0.0, 0.1, 0.2)),
    },
    mass_scale=0.9,
    pulses={420: Pulse(PUSH, 0.7, ramp_s=0.2), 800: Pulse(SHOVE, 0.2, point_m=np.array([0.02, 0.0, 0.01]), ramp_s=0.03)},
)
BOX = Take(
    1100,
    "policy",
    "hybrid",
    {
        0: press(0.0),
        450: press(15.0),
        800: press(20.0, 8.0),
        1000: DEFAULT_COMMAND,
    },
    scene="box",
)
PAPER = Take(
    400,
    "policy",
    "tcn",
    {
        100: lambda pipeline: pipeline.select_controller("policy_paper"),
        150: ask(mask=(0.0, 0.0, 1.0), force_n=(0.0, 0.0, 10.0), base_velocity=(0.2, 0.0, 0.0)),
    },
    pulses={160: Pulse(PUSH, 0.4, ramp_s=0.1)},
)
TAKES = (FREE, MODEL_BASED, BOX, PAPER)
TICKS = sum(take.ticks for take in TAKES)

_FIELDS = {
    "orientation_wxyz": 4,
    "angular_velocity": 3,
    "linear_acceleration": 3,
    "joint_position": 22,
    "joint_velocity": 22,
    "joint_torque": 22,
}
_ENDS = np.cumsum([0, *_FIELDS.values()])


def pack(frame: SensorFrame) -> np.ndarray:
    """(76,) single-precision row of a frame."""
    return np.concatenate([getattr(frame, name) for name in _FIELDS]).astype(np.float32)


def unpack(row: np.ndarray, tick: int) -> SensorFrame:
    """The frame of a row, at a tick of its take."""
    parts = {name: row[a:b].astype(float) for name, a, b in zip(_FIELDS, _ENDS, _ENDS[1:], strict=False)}
    parts["orientation_wxyz"] /= np.linalg.norm(parts["orientation_wxyz"])
    return SensorFrame(tick * TICK_S, **parts)


def play(pipeline: Pipeline, read: Callable[[Take, int], SensorFrame]) -> Iterator[tuple[Take, int, PipelineOutput]]:
    """Every tick of the TAKES: what the pipeline makes of the frames that `read` gives."""
    for take in TAKES:
        pipeline.reset()
        pipeline.select_controller(take.controller)
        pipeline.select_estimator(take.estimator)
        command = DEFAULT_COMMAND
        for tick in range(take.ticks):
            action = take.actions.get(tick, command)
            if isinstance(action, Command):
                command = action
            else:
                action(pipeline)
            yield take, tick, pipeline.step(read(take, tick), command)


def note(rows: dict[str, list[np.ndarray]], pipeline: Pipeline, tick: int, output: PipelineOutput) -> None:
    """Add the golden quantities of one tick; those of the 50 Hz controller once per period."""
    base = output.base
    row: dict[str, np.ndarray] = {
        "base_velocity": base.linear_velocity_in_base,
        "base_height": np.array([base.height_m]),
        "selected_force": output.hand.force_estimated_n,
        "faults": np.array([int(output.safety.faults)], np.uint16),
    }
    if tick % CONTROL_TICKS == 0:
        applied = output.applied_command
        row["target_position"] = output.joint_command.position
        row["target_velocity"] = output.joint_command.velocity
        parts = (applied.mask, applied.force_n, applied.position_m, applied.orientation_wxyz, applied.base_velocity)
        row["applied"] = np.concatenate(parts)
        row["hand"] = np.concatenate([output.hand.position_in_heading, output.hand.rotation_to_heading.ravel()])
    if tick % CONTROL_TICKS == ASKED_SLOT:
        for name in MODEL_BASED_NAMES:
            estimate = pipeline.estimators[name].estimate()
            row[f"{name}.force"] = estimate.force_estimated_n
            row[f"{name}.wheel_forces"] = estimate.wheel_forces_in_heading.ravel()
            row[f"{name}.stale"] = np.array([estimate.stale])
        row["adaptive.mass_scale"] = _given(pipeline.estimators["adaptive"].estimate().mass_scale)
    if tick % CONTROL_TICKS == CONTROL_TICKS - 1:
        for name in LEARNED_NAMES:
            row[f"{name}.force"] = output.estimates[name].force_estimated_n
        row["hybrid.sigma"] = _given(output.estimates["hybrid"].sigma_n)
    for name, value in row.items():
        rows.setdefault(name, []).append(np.array(value))


def _given(value: np.ndarray | float | None) -> np.ndarray:
    assert value is not None
    return np.atleast_1d(value)


def replay(frames: np.ndarray) -> dict[str, np.ndarray]:
    """Golden quantities (n, k) by name of the recorded frames (TICKS, 76), by the code as it is."""
    pipeline = Pipeline(PipelineConfig(base_state=BIASED))
    stream = iter(frames)
    rows: dict[str, list[np.ndarray]] = {}
    for _, tick, output in play(pipeline, lambda _, tick: unpack(next(stream), tick)):
        note(rows, pipeline, tick, output)
    return {name: np.array(values) for name, values in rows.items()}


def record() -> dict[str, np.ndarray]:
    """Simulated takes: their frames as "frames" (TICKS, 76), and the golden quantities."""
    pipeline = Pipeline(PipelineConfig(base_state=BIASED))
    backend = MujocoBackend()
    frames: list[np.ndarray] = []

    def read(take: Take, tick: int) -> SensorFrame:
        if tick == 0:
            start(take)
        if take.pulses and tick in take.pulses:
            backend.wrenches.add(take.pulses[tick])
        row = pack(backend.read())
        if tick == take.broken:
            row[_ENDS[4]] = np.nan
        frames.append(row)
        return unpack(row, tick)

    def start(take: Take) -> None:
        backend.set_scene(take.scene)
        backend.open()
        backend.set_mismatch(Mismatch(mass_scale=take.mass_scale))
        backend.reset(seed=TAKES.index(take))

    rows: dict[str, list[np.ndarray]] = {}
    for _, tick, output in play(pipeline, read):
        note(rows, pipeline, tick, output)
        backend.write(output.joint_command)
    return {"frames": np.array(frames)} | {name: np.array(values) for name, values in rows.items()}


if __name__ == "__main__":
    np.savez_compressed(sys.argv[1], allow_pickle=False, **record())
