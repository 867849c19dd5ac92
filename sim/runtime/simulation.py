"""The session of the simulated robot: besides what every session does, its world can be reset, changed and pushed."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from control.pipeline import PipelineConfig, PipelineOutput
from control.types import Command
from sim import scenes
from sim.backends.protocol import GroundTruth
from sim.backends.simulation.applied_wrenches import ActiveWrench
from sim.backends.simulation.drag_spring import DRAG_HEARTBEAT_S
from sim.backends.simulation.mujoco_backend import MujocoBackend
from sim.backends.simulation.sensors import SensorConfig
from sim.backends.simulation.wrenches import Pulse
from sim.runtime.session import Session
from sim.runtime.snapshot_limits import check_scene


@dataclass(frozen=True, slots=True)
class SimulationConfig:
    """What a simulation is made of. `seed` draws the sensors' errors."""

    scene: str = "free"
    seed: int = 0
    sensors: SensorConfig = field(default_factory=SensorConfig)
    pipeline: PipelineConfig = field(default_factory=PipelineConfig)


class Simulation(Session[MujocoBackend]):
    """A session around MujocoBackend.

    Raises:
        ValueError: unknown scene.
        SnapshotLimitError: what is registered does not fit into a snapshot.
    """

    STATE = ("_truth", "_drag_target")

    def __init__(self, config: SimulationConfig | None = None) -> None:
        config = config or SimulationConfig()
        super().__init__(MujocoBackend(_build_scene(config.scene), config.sensors, config.seed), config.pipeline)
        self._truth: GroundTruth | None = None
        self._drag_target: np.ndarray | None = None

    def tick(self, command: Command, command_age_s: float = 0.0) -> PipelineOutput:
        """See Session."""
        self._truth = None
        return super().tick(command, command_age_s)

    def tick_setpoint(self, setpoint: np.void, age_s: float) -> None:
        """See Session; with the drag spring while its operator is alive."""
        dragging = bool(setpoint["drag_active"]) and age_s < DRAG_HEARTBEAT_S
        self._set_drag(setpoint["drag_target_in_world"].copy() if dragging else None)
        super().tick_setpoint(setpoint, age_s)

    def pack_state(self) -> None:
        """Truth goes with the moment: the contacts that it is read from do not."""
        self.truth()

    def truth(self) -> GroundTruth:
        """Ground truth after the last tick, for evaluation."""
        if self._truth is None:
            self._truth = self.backend.truth()
        return self._truth

    def reset(self, seed: int | None = None, keyframe: str = "stand") -> None:
        """Put the robot back and restart the pipeline.

        Raises:
            ValueError: unknown keyframe.
        """
        self.backend.reset(seed=seed, keyframe=keyframe)
        self._restart()

    def set_scene(self, name: str) -> None:
        """Load another scene with the robot at its start.

        Raises:
            ValueError: unknown scene.
            SnapshotLimitError: the scene does not fit into a snapshot.
        """
        self.backend.set_scene(_build_scene(name))
        self._restart()

    def set_mismatch(self, mass_scale: float, per_link: dict[str, float] | None = None) -> None:
        """Change the robot's masses while it runs; the pipeline is not told.

        Raises:
            ValueError: out of range, or an unknown link.
        """
        self.backend.set_mismatch(replace(self.backend.mismatch, mass_scale=mass_scale, per_link=per_link or {}))

    def add_wrench(self, **spec: Any) -> int:
        """Start a scripted wrench (fields of sim.backends.simulation.wrenches.Pulse) and return its id.

        Raises:
            ValueError: the message names the field.
        """
        return self.backend.wrenches.add(Pulse(**spec))

    def list_wrenches(self) -> tuple[ActiveWrench, ...]:
        """What acts now, oldest first; the operator's drag is apart."""
        return self.backend.wrenches.list()

    def remove_wrench(self, key: int) -> None:
        """End one wrench. Raises KeyError when it is not at work."""
        self.backend.wrenches.remove(key)

    def fill(self, record: np.void) -> None:
        """See Session."""
        super().fill(record)
        record["scene"] = self.backend.scene
        record["mass_scale_true"] = self.backend.mass_scale
        record["drag_active"] = self._drag_target is not None
        record["drag_target_in_world"] = np.nan if self._drag_target is None else self._drag_target
        record["drag_force_n"] = self.backend.wrenches.drag_force_in_world @ self.truth().rotation_heading_to_world

    def _set_drag(self, target_in_world: np.ndarray | None) -> None:
        if target_in_world is not None or self._drag_target is not None:
            self.backend.set_drag(target_in_world)
        self._drag_target = target_in_world

    def _restart(self) -> None:
        self._reset_pipeline()
        self._forget()
        self._truth = None
        self._drag_target = None


def _build_scene(name: str) -> scenes.SceneModel:
    scene = scenes.build(name)
    check_scene(scene.name, scene.movable_bodies)
    return scene
