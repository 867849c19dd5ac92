"""The simulated robot behind the Backend protocol: drives, sensors, scenes, mismatch, wrenches and ground truth."""

import math
from collections.abc import Mapping
from dataclasses import replace

import mujoco
import numpy as np

from control.joints import JOINT_COUNT, JOINT_NAMES, NOMINAL_POSITION
from control.kernels.compiled import kernel
from control.types import JointCommand, SensorFrame
from sim import scenes
from sim.backends.protocol import BackendError, GroundTruth
from sim.backends.simulation.applied_wrenches import AppliedWrenches
from sim.backends.simulation.drag_spring import drag_spring
from sim.backends.simulation.drives import Drives
from sim.backends.simulation.ground_truth import GroundTruthReader
from sim.backends.simulation.ideal_sensors import IdealSensors
from sim.backends.simulation.mismatch import Mismatch, NominalParameters
from sim.backends.simulation.sensors import SensorConfig, SensorModel
from sim.scenes import SceneModel

DIVERGED_SPEED = 1000.0
"""m/s or rad/s: no body of a simulation that means anything is as fast."""

_CHANGEABLE = (
    "body_pos",
    "body_quat",
    "body_mass",
    "body_inertia",
    "body_ipos",
    "body_iquat",
    "bvh_aabb",
    "dof_armature",
    "dof_damping",
    "dof_frictionloss",
    "geom_aabb",
    "geom_friction",
    "geom_pos",
    "geom_quat",
    "geom_rbound",
    "geom_size",
    "jnt_stiffness",
    "qpos_spring",
)
"""Fields of a model that the parameters of a scene may change while it runs."""

PHYSICS = mujoco.mjtState.mjSTATE_INTEGRATION
"""What MuJoCo integrates from: besides positions and velocities the start of its solver and the applied forces."""

KEYFRAMES = {"stand": NOMINAL_POSITION}
"""Postures (22,) that a reset can start from; the wheels just touch the ground."""


class MujocoBackend:
    """One robot in one scene. `read` and `write` as in sim.backends.protocol; the rest is for simulation only."""

    STATE = (
        "_physics",
        "_scene",
        "_memories",
        "_mismatch",
        "_mass_scale",
        "_seed",
        "_sensors",
        "_ideal_sensors",
        "wrenches",
        "_frame",
    )
    SCRATCH = ("_data", "_qvel", "_drives", "_truth", "_nominal", "_kinematics_are_current", "_compiled_values")

    name = "simulation"

    def __init__(self, scene: str | SceneModel = "free", sensors: SensorConfig | None = None, seed: int = 0) -> None:
        """`scene` of sim.scenes.SCENE_NAMES, or one's own; `seed` draws the errors of the sensors, by default SensorConfig().

        Raises:
            ValueError: no scene has this name.
        """
        self._sensor_config = SensorConfig() if sensors is None else sensors
        self._seed = seed
        self._mismatch = Mismatch()
        self._opened = False
        self.set_scene(scene)

    def open(self) -> None:
        """Put the robot on its wheels."""
        self._opened = True
        self.reset()

    def close(self) -> None:
        """Stop; `open` starts anew."""
        self._opened = False

    def read(self) -> SensorFrame:
        """The sensor frame of this tick, with the errors and delay of the sensor configuration."""
        self._require_open()
        return self._frame

    def write(self, command: JointCommand) -> None:
        """Drive the joints with `command` and advance the world by one tick.

        Raises:
            BackendError: the backend is not open, or the simulation diverged (cure: reset).
        """
        self._require_open()
        self._drives.act(command)
        if self.wrenches.acting:
            self._update_kinematics()
        self.wrenches.apply()
        mujoco.mj_step(self._model, self._data)
        if not largest_speed(self._qvel) < DIVERGED_SPEED:
            raise BackendError("the simulation diverged; reset it")
        self._kinematics_are_current = False
        self._sense(self._drives.torques(command))

    def touches_itself(self) -> bool:
        """Whether two bodies of the robot press on each other, for evaluation."""
        return self._truth.touches_itself()

    def truth(self) -> GroundTruth:
        """Ground truth at the end of the last tick; forces are those that acted during it."""
        self._require_open()
        self._update_kinematics()
        return self._truth.read()

    def reset(self, seed: int | None = None, keyframe: str = "stand") -> None:
        """Back to time zero in a posture of KEYFRAMES, at rest, wheels just touching. Ends all wrenches; mismatch stays.

        Args:
            seed: draws the sensors' errors; None repeats those of the last reset.
            keyframe: name in KEYFRAMES.

        Raises:
            ValueError: the keyframe is unknown.
        """
        if keyframe not in KEYFRAMES:
            raise ValueError(f"no keyframe {keyframe!r}; the keyframes are {', '.join(KEYFRAMES)}")
        self._seed = self._seed if seed is None else seed
        model, data = self._model, self._data
        mujoco.mj_resetData(model, data)
        # Gains of the last command would leave their mark on the first solution, from which the solver starts.
        self._drives.release()
        self.wrenches.clear()
        data.qpos[self._positions] = KEYFRAMES[keyframe]
        mujoco.mj_kinematics(model, data)
        data.qpos[2] -= self._truth.lowest_wheel_points()[:, 2].min()
        mujoco.mj_forward(model, data)
        self._kinematics_are_current = True
        self._sensors = SensorModel(self._sensor_config, self._seed, model.opt.timestep)
        self._ideal_sensors.reset()
        self._sense(np.zeros(JOINT_COUNT))

    @property
    def model(self) -> mujoco.MjModel:
        """The simulated robot and scene; for evaluation, never for the pipeline."""
        return self._model

    @property
    def data(self) -> mujoco.MjData:
        """State of the simulation after the last tick; for evaluation, never for the pipeline. Ask anew after a tick."""
        self._update_kinematics()
        return self._data

    @property
    def time_s(self) -> float:
        """Simulated time since the last reset."""
        return float(self._data.time)

    @property
    def seed(self) -> int:
        """That drew the errors of the sensors at the last reset."""
        return self._seed

    @property
    def scene(self) -> str:
        """Name of the scene."""
        return self._scene.name

    @property
    def movable_bodies(self) -> tuple[str, ...]:
        """Names of the scene's movable bodies, in the order of GroundTruth.object_positions."""
        return self._scene.movable_bodies

    def set_scene(self, scene: str | SceneModel) -> None:
        """Load another scene, by name or one's own, and put the robot on its wheels there; the mismatch stays.

        Raises:
            ValueError: no scene has this name; nothing changes.
        """
        self._load(scenes.build(scene) if isinstance(scene, str) else scene)

    def pack_state(self) -> None:
        """Take MuJoCo's state."""
        mujoco.mj_getState(self._model, self._data, self._physics, PHYSICS)

    def unpack_state(self) -> None:
        """Put MuJoCo's state, parameters and masses back. Contacts are found again by the next tick only."""
        if self._compiled_values is not self._scene.values:
            self._change(scenes.build(self.scene, self._scene.values, rigid=self._scene.rigid), self._scene.values)
        self._nominal.apply(self._model, self._mismatch)
        mujoco.mj_setState(self._model, self._data, self._physics, PHYSICS)
        self._kinematics_are_current = False
        self._update_kinematics()

    @property
    def mismatch(self) -> Mismatch:
        """What the simulated robot differs by from its nominal model."""
        return self._mismatch

    @property
    def mass_scale(self) -> float:
        """Total mass of the simulated robot over nominal."""
        return self._mass_scale

    def set_mismatch(self, mismatch: Mismatch) -> None:
        """Change masses, inertias and frictions from the next tick on; the state stays.

        Raises:
            ValueError: it names a link that the robot has not; nothing changes.
        """
        self._apply(mismatch)

    def readings(self) -> dict[str, float]:
        """What can be read off the scene now."""
        self._update_kinematics()
        return {reading.name: reading.read(self._data) for reading in self._scene.readings}

    @property
    def parameters(self) -> Mapping[str, float]:
        """Of the scene, by name."""
        return self._scene.values

    def set_parameters(self, values: Mapping[str, float]) -> None:
        """Change parameters of the scene from the next tick on; the state stays.

        Raises:
            ValueError: the scene has no such parameter, or not with this value; nothing changes.
        """
        scene = scenes.build(self.scene, {**self._scene.values, **values}, rigid=self._scene.rigid)
        self._change(scene, scene.values)
        self._nominal.apply(self._model, self._mismatch)
        self._scene = replace(self._scene, values=scene.values, primitives=scene.primitives)
        self._kinematics_are_current = False

    def set_drag(self, target_in_world: np.ndarray | None) -> None:
        """Pull the end effector towards a point (3,) m in world by the drag spring, or let go with None.

        Raises:
            ValueError: the target is not three finite numbers.
        """
        if target_in_world is None:
            self.wrenches.set_drag(None)
        elif self.wrenches.drag is None or not np.array_equal(target_in_world, self.wrenches.drag.anchor_m):
            self.wrenches.set_drag(drag_spring(target_in_world))

    def _load(self, scene: SceneModel) -> None:
        self._scene, self._compiled_values = scene, scene.values
        self._memories = tuple(reading.memory for reading in scene.readings if reading.memory is not None)
        model = self._model = scene.model
        # Without this MuJoCo would answer a divergence with a silent reset.
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        self._positions = np.array([model.joint(joint).qposadr[0] for joint in JOINT_NAMES])
        data = self._data = mujoco.MjData(model)
        self._qvel = data.qvel
        self._physics = np.empty(mujoco.mj_stateSize(model, PHYSICS))
        self._drives, self._ideal_sensors = Drives(model, data), IdealSensors(model, data)
        self.wrenches = AppliedWrenches(model, data)
        self._truth = GroundTruthReader(model, data, self._scene.robot_bodies, self._scene.movable_bodies)
        self._nominal = NominalParameters(model, self._scene.robot_bodies)
        self._apply(self._mismatch)
        self.reset()

    def _change(self, scene: SceneModel, values: Mapping[str, float]) -> None:
        """Let the model have the parameters of another one of the same scene."""
        for name in _CHANGEABLE:
            getattr(self._model, name)[...] = getattr(scene.model, name)
        self._compiled_values = values

    def _apply(self, mismatch: Mismatch) -> None:
        self._nominal.apply(self._model, mismatch)
        self._mismatch = mismatch
        self._mass_scale = self._nominal.total_mass_scale(self._model)

    def _update_kinematics(self) -> None:
        # mj_step leaves poses and velocities of the tick's start; wrenches and truth need those of its end.
        if not self._kinematics_are_current:
            mujoco.mj_kinematics(self._model, self._data)
            mujoco.mj_comPos(self._model, self._data)
            mujoco.mj_comVel(self._model, self._data)
            self._kinematics_are_current = True

    def _sense(self, torque: np.ndarray) -> None:
        self._frame = self._sensors.measure(self._data.time, self._ideal_sensors.read(torque))

    def _require_open(self) -> None:
        if not self._opened:
            raise BackendError("the simulation is not open; call open() first")


@kernel("f8(f8[::1])")
def largest_speed(qvel: np.ndarray) -> float:
    """max |dq|, or not a number where one of them is not."""
    largest = 0.0
    for speed in qvel:
        if math.isnan(speed):
            return speed
        largest = max(largest, abs(speed))
    return largest
