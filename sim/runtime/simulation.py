"""The session of the simulated robot: besides what every session does, its world can be reset, changed and pushed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from control.pipeline import PipelineConfig, PipelineOutput
from control.types import Command
from sim import scenes
from sim.backends.protocol import GroundTruth
from sim.backends.simulation.applied_wrenches import ActiveWrench
from sim.backends.simulation.drag_spring import DRAG_HEARTBEAT_S
from sim.backends.simulation.leading_person import LeadingPerson
from sim.backends.simulation.mujoco_backend import MujocoBackend
from sim.backends.simulation.sensors import SensorConfig
from sim.backends.simulation.wrenches import Pulse
from sim.runtime.session import Session
from sim.runtime.snapshot_limits import check_scene
from sim.runtime.snapshot_writer import write_named, write_simulation
from sim.tasks.desk import TaskRecord
from sim.tasks.guidance import GuidanceTask


@dataclass(frozen=True, slots=True)
class SimulationConfig:
    """What a simulation is made of. `seed` draws the sensors' errors; `parameters` and `rigid` are of the scene."""

    scene: str = "free"
    seed: int = 0
    parameters: Mapping[str, float] = field(default_factory=dict)
    rigid: bool = False
    sensors: SensorConfig = field(default_factory=SensorConfig)
    pipeline: PipelineConfig = field(default_factory=PipelineConfig)


class Simulation(Session[MujocoBackend]):
    """A session around MujocoBackend.

    Raises:
        ValueError: unknown scene.
        SnapshotLimitError: what is registered does not fit into a snapshot.
    """

    STATE = ("_truth", "_drag_target", "person")

    def __init__(self, config: SimulationConfig | None = None) -> None:
        config = config or SimulationConfig()
        scene = _build_scene(config.scene, config.parameters, config.rigid)
        super().__init__(MujocoBackend(scene, config.sensors, config.seed), config.pipeline)
        self._truth: GroundTruth | None = None
        self._drag_target: np.ndarray | None = None
        self.person: LeadingPerson | None = None

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

    def set_scene(self, name: str, parameters: Mapping[str, float] | None = None, rigid: bool = False) -> None:
        """Load another scene with the robot at its start; see sim.scenes.build.

        Raises:
            ValueError: unknown scene or parameter, or a value out of its range.
            SnapshotLimitError: the scene does not fit into a snapshot.
        """
        self.backend.set_scene(_build_scene(name, parameters, rigid))
        self._restart()

    def set_parameters(self, parameters: Mapping[str, float]) -> None:
        """Change parameters of the scene while it runs.

        Raises:
            ValueError: unknown parameter, or a value out of its range.
        """
        self.backend.set_parameters(parameters)

    def start_task(self, name: str, options: Mapping[str, float], sequence: int = 0) -> TaskRecord:
        """See Session; where a task needs somebody who leads the hand, there is one."""
        record = super().start_task(name, options, sequence)
        if isinstance(record.runner.task, GuidanceTask):
            self.person = LeadingPerson(self.backend.seed, record.options["lead_s"])
            self.backend.wrenches.add(self.person)
        return record

    @property
    def scene(self) -> str:
        """Name of the scene."""
        return self.backend.scene

    def readings(self) -> dict[str, float]:
        """What can be read off the scene."""
        return self.backend.readings()

    def set_mismatch(
        self,
        mass_scale: float,
        per_link: dict[str, float] | None = None,
        payload_kg: float = 0.0,
        payload_center_m: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> None:
        """Change the robot's masses and what its hand carries while it runs; the pipeline is not told.

        Raises:
            ValueError: out of range, or an unknown link.
        """
        x, y, z = payload_center_m
        masses = replace(self.backend.mismatch, mass_scale=mass_scale, per_link=per_link or {})
        self.backend.set_mismatch(replace(masses, payload_kg=payload_kg, payload_center_m=(x, y, z)))

    def add_wrench(self, **spec: Any) -> int:
        """Start a scripted wrench (fields of sim.backends.simulation.wrenches.Pulse) and return its id.

        Raises:
            ValueError: the message names the field.
        """
        return self.backend.wrenches.add(Pulse(**spec))

    def list_wrenches(self) -> tuple[ActiveWrench, ...]:
        """What acts now, oldest first; the operator's drag and a person who leads the hand are apart."""
        return tuple(active for active in self.backend.wrenches.list() if isinstance(active.source, Pulse))

    def remove_wrench(self, key: int) -> None:
        """End one wrench. Raises KeyError when it is not at work."""
        self.backend.wrenches.remove(key)

    def fill(self, record: np.void) -> None:
        """See Session."""
        super().fill(record)
        record["scene"] = self.backend.scene
        write_named(record, "parameter", self.backend.parameters)
        write_simulation(self._numbers, self.backend.mass_scale, self._drag_target, self.backend.wrenches.drag_force_in_world)

    def _set_drag(self, target_in_world: np.ndarray | None) -> None:
        if target_in_world is not None or self._drag_target is not None:
            self.backend.set_drag(target_in_world)
        self._drag_target = target_in_world

    def _restart(self) -> None:
        self._reset_pipeline()
        self._forget()
        self._truth = None
        self._drag_target = None


def _build_scene(name: str, parameters: Mapping[str, float] | None, rigid: bool) -> scenes.SceneModel:
    scene = scenes.build(name, parameters, rigid=rigid)
    check_scene(scene)
    return scene
