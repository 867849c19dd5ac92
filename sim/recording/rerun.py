"""Runs the pipeline, or one estimator, over what a recording's sensors saw.

From any of its keyframes (sim.recording.keyframes) the pipeline gives the recorded estimates and targets bit for bit, on the
machine and version that made it; elsewhere the last digits differ.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from control.hand_load.tool import Tool
from control.pipeline import Pipeline, PipelineConfig
from control.state.file import unpack_state
from control.types import Command, ForceEstimate, SensorFrame
from sim.recording.messages import read_vectors
from sim.recording.reader import Event, Recording, RecordingFormatError


class Rerun(NamedTuple):
    """What the pipeline gives now, tick by tick.

    Attributes:
        estimates_n: (n, estimators, 3) N, NaN where there is none.
        target_position: (n, 22) rad, to the drives.
    """

    estimates_n: np.ndarray
    target_position: np.ndarray


def recorded_pipeline(recording: Recording) -> Pipeline:
    """The pipeline as it was before the first tick of the recording, or of the part of it that was opened."""
    metadata = recording.metadata
    pipeline = Pipeline(PipelineConfig(controller=metadata["controller"], estimator=metadata["estimator"]))
    if pipeline.estimator_names != recording.estimators:
        raise RecordingFormatError(f"the recording has the estimators {', '.join(recording.estimators)}")
    unpack_state(recording.keyframe(), pipeline)
    return pipeline


def frames(recording: Recording) -> Iterator[SensorFrame]:
    """What the pipeline saw, tick by tick."""
    bodies = recording.sensors()["body"]
    rates, accelerations = read_vectors(bodies, "angular_velocity"), read_vectors(bodies, "linear_acceleration")
    plain = {name: np.ascontiguousarray(bodies[name]) for name in ("orientation_wxyz", "joint_position", "joint_velocity")}
    torques = np.ascontiguousarray(bodies["joint_torque"])
    for index, time_s in enumerate(bodies["time_s"].tolist()):
        yield SensorFrame(
            time_s=time_s,
            orientation_wxyz=plain["orientation_wxyz"][index],
            angular_velocity=rates[index],
            linear_acceleration=accelerations[index],
            joint_position=plain["joint_position"][index],
            joint_velocity=plain["joint_velocity"][index],
            joint_torque=torques[index],
        )


def rerun(recording: Recording) -> Rerun:
    """Step the whole pipeline through the recording."""
    pipeline = recorded_pipeline(recording)
    inputs = recording.inputs()
    ticks = recording.ticks(inputs)
    deeds = _Deeds(recording.events())
    count = len(ticks)
    result = Rerun(np.full((count, len(recording.estimators), 3), np.nan), np.full((count, 22), np.nan))
    for row, frame in enumerate(frames(recording)):
        deeds.do(pipeline, int(ticks[row]), gap=row > 0 and ticks[row] != ticks[row - 1] + 1)
        body = inputs["body"][row]
        output = pipeline.step(frame, _command(body), float(body["command_age_s"]))
        for index, name in enumerate(recording.estimators):
            if name in output.estimates:
                result.estimates_n[row, index] = output.estimates[name].force_estimated_n
        result.target_position[row] = output.joint_command.position
    return result


def reestimate(recording: Recording, estimator: str, gains: tuple[float, float] | None = None) -> Iterator[ForceEstimate]:
    """One estimator alone over the recording, asked at every tick; cheaper than `rerun`.

    Args:
        recording: which one.
        estimator: name of the estimator.
        gains: of its momentum observer, from the start on.
    """
    pipeline = recorded_pipeline(recording)
    pipeline.select_estimator(estimator, gains)
    inputs = recording.inputs()
    masks, ticks = np.ascontiguousarray(inputs["body"]["applied_mask"]), recording.ticks(inputs)
    deeds = _Deeds([event for event in recording.events() if event.name in ("reset", "set_tool")])
    for row, frame in enumerate(frames(recording)):
        deeds.do(pipeline, int(ticks[row]), gap=row > 0 and ticks[row] != ticks[row - 1] + 1)
        yield pipeline.estimate_alone(frame, masks[row - 1] if row else None)


class _Deeds:
    """Does again what was done to the pipeline. A gap in the recording starts it afresh."""

    def __init__(self, events: list[Event]) -> None:
        self._events = events[::-1]

    def do(self, pipeline: Pipeline, tick: int, *, gap: bool) -> None:
        if gap:
            pipeline.reset()
        while self._events and self._events[-1].tick <= tick:
            event = self._events.pop()
            arguments = event.arguments
            match event.name:
                case "reset":
                    latched = pipeline.estop_latched
                    pipeline.reset()
                    if latched:
                        pipeline.estop()
                case "select_controller":
                    pipeline.select_controller(arguments["name"])
                case "select_estimator":
                    k1, k2 = arguments.get("k1"), arguments.get("k2")
                    pipeline.select_estimator(arguments["name"], None if k1 is None or k2 is None else (k1, k2))
                case "tare":
                    pipeline.hand_load.tare(pipeline.estimator_name, pipeline.applied_command)
                case "clear_tare":
                    pipeline.hand_load.clear_tare()
                case "set_tool":
                    pipeline.hand_load.set_tool(Tool(arguments["mass_kg"], np.array(arguments["center_of_mass_m"])))
                case "identify_tool":
                    pipeline.hand_load.identify_tool(pipeline.applied_command)
                case "estop":
                    pipeline.estop()
                case "clear_estop":
                    pipeline.clear_estop()


def _command(body: np.void) -> Command:
    return Command(
        mask=body["mask"].copy(),
        force_n=body["force_n"].copy(),
        position_m=body["position_m"].copy(),
        orientation_wxyz=body["orientation_wxyz"].copy(),
        base_velocity=body["base_velocity"].copy(),
        guidance=bool(body["guidance"]),
    )
