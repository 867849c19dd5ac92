"""The emulated robot's body: MuJoCo with a torque law per motor at every physics step, and motors that warm up."""

import numpy as np

from control.joints import ARM_SLICE, JOINT_COUNT, LEG_SLICE, NOMINAL_POSITION, TORQUE_LIMIT
from control.timing import SLOT_COUNT, TICK_S
from control.types import JointCommand, SensorFrame
from sim import scenes
from sim.backends.hardware.io.motions import ARM_FOLDED, CROUCH_LEGS
from sim.backends.simulation.mujoco_backend import MujocoBackend
from sim.backends.simulation.sensors import SensorConfig

AMBIENT_C = 35.0
HEATING_C_PER_S = 1.0
COOLING_TIME_S = 120.0
"""First-order motor temperature: full torque heats by HEATING_C_PER_S, everything cools towards AMBIENT_C."""

CROUCH = NOMINAL_POSITION.copy()
CROUCH[LEG_SLICE], CROUCH[ARM_SLICE] = CROUCH_LEGS, ARM_FOLDED
CROUCH.setflags(write=False)
"""Lying on the wheels with folded legs and arm, (22,) rad: how the robot is switched on."""

_SETTLE_S = 1.5
_HOLD_STIFFNESS = np.array([60.0] * 12 + [0.0] * 4 + [40.0] * 6)
_HOLD_DAMPING = np.array([4.0] * 12 + [1.0] * 4 + [3.0] * 6)


def hold(posture: np.ndarray) -> JointCommand:
    """What the robot's own program uses to hold a posture (22,)."""
    zero = np.zeros(JOINT_COUNT)
    return JointCommand(posture, zero, _HOLD_STIFFNESS, _HOLD_DAMPING)


class RobotBody:
    """Physics at 500 Hz.

    Attributes:
        backend: the simulator, for drags and truth in tests and benchmarks.
        temperature: (22,) of the motors, degrees Celsius.
        time_s: since it was switched on.
        readings: of the scene, by name, of the last control period.
    """

    def __init__(self, sensors: SensorConfig, seed: int, scene: str = "free", behind_m: float = 0.0) -> None:
        """`scene` of sim.scenes.SCENE_NAMES is what it is in, with parameters as `seed` draws them.

        Args:
            behind_m: how far behind the place where the simulation's robot stands. It needs room to rise and to unfold its arm.

        Raises:
            ValueError: no scene has this name.
        """
        self.backend = MujocoBackend(scenes.build(scene, scenes.draw(scene, seed)), sensors, seed)
        self.backend.open()
        self.backend.data.qpos[0] -= behind_m
        self.readings = self.backend.readings()
        self.temperature = np.full(JOINT_COUNT, AMBIENT_C)
        self.time_s = 0.0
        self._settle()

    @property
    def frame(self) -> SensorFrame:
        """What the robot's sensors say now."""
        return self.backend.read()

    def step(self, command: JointCommand) -> None:
        """Advance by TICK_S under a command; torque follows position and velocity at this very step."""
        self.backend.write(command)
        self.time_s += TICK_S
        load = np.minimum(np.abs(self.frame.joint_torque) / TORQUE_LIMIT, 1.0)
        cooling = (self.temperature - AMBIENT_C) / COOLING_TIME_S
        self.temperature += TICK_S * (HEATING_C_PER_S * load * load - cooling)
        if round(self.time_s / TICK_S) % SLOT_COUNT == 0:
            self.readings = self.backend.readings()

    def _settle(self) -> None:
        """Lower the robot from the simulator's stance to how it is switched on."""
        start = self.frame.joint_position.copy()
        steps = int(_SETTLE_S / TICK_S)
        for step in range(steps):
            blend = min(1.0, 1.5 * step / steps)
            self.backend.write(hold(start + blend * (CROUCH - start)))
