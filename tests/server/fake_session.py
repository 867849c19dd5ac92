"""Sessions without a robot, for tests of the loop and of the processes around it."""

import os
import time
from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from control.command.limits import DEFAULT_COMMAND
from control.state.capture import StateError
from control.timing import TICK_S
from sim.backends.protocol import BackendError
from sim.runtime.robot_session import RobotSession
from sim.runtime.session import SessionError
from sim.runtime.simulation import Simulation, SimulationConfig
from sim.runtime.snapshot import Mode, command_from_record


class FakeSession(Simulation):
    """A simulation that does nothing but count.

    Ticks add 2 ms. Scene "broken" makes them fail, "slow" makes them late; controller "suicide" ends the process.
    """

    def __init__(self, config: SimulationConfig | None = None) -> None:
        self.config = config or SimulationConfig()
        self.time_s = 0.0
        self.ticks = 0
        self.ages_s: list[float] = []
        self.calls: list[tuple[Any, ...]] = []
        self.loaded = self.config.scene
        self.latched = False
        self.pipeline = SimpleNamespace(controller_names=("model_based",), estimator_names=("adaptive",))
        self._backend = SimpleNamespace(close=lambda: None)
        self.command_sequence = 0
        self._command = DEFAULT_COMMAND
        self.dragged = False
        self.own_deeds = {"reset": 0, "tare": 0}
        self.tasks = SimpleNamespace(running=False)

    def pack_state(self) -> None:
        raise StateError("a fake carries nothing")

    @property
    def scene(self) -> str:
        return self.loaded

    @property
    def mode(self) -> Mode:
        return Mode.ESTOP if self.latched else Mode.RUNNING

    def tick_setpoint(self, setpoint: np.void, age_s: float) -> None:
        if self.loaded == "broken":
            raise BackendError("the simulation diverged; reset it")
        if self.loaded == "slow":
            time.sleep(0.004)
        self.ticks += 1
        self.time_s += TICK_S
        self.ages_s = [*self.ages_s[-9:], age_s]
        self.command_sequence = int(setpoint["sequence"])
        self._command = command_from_record(setpoint["command"])
        self.dragged = bool(setpoint["drag_active"])

    def track_errors(self, interval_s: float) -> None:
        self.calls.append(("track_errors", interval_s))

    def fill(self, record: np.void) -> None:
        record["time_s"] = self.time_s
        record["mode"] = self.mode
        record["scene"] = self.loaded
        record["controller"] = "model_based"
        record["estimator"] = "adaptive"
        record["command_sequence"] = self.command_sequence

    def reset(self, seed: int | None = None, keyframe: str = "stand") -> None:
        self.calls.append(("reset", seed, keyframe))
        self.time_s = 0.0
        self.loaded = "free"

    def set_scene(self, name: str, parameters: Mapping[str, float] | None = None, rigid: bool = False) -> None:
        self.loaded = name

    def select_controller(self, name: str) -> None:
        if name == "suicide":
            os._exit(3)
        raise RuntimeError("a defect")

    def select_estimator(self, name: str, k1: float | None = None, k2: float | None = None) -> None:
        raise ValueError(f"unknown estimator {name!r}")

    def set_mismatch(
        self,
        mass_scale: float,
        per_link: dict[str, float] | None = None,
        payload_kg: float = 0.0,
        payload_center_m: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> None:
        self.calls.append(("set_mismatch", mass_scale, per_link))

    def estop(self) -> None:
        self.calls.append(("estop",))
        self.latched = True

    def clear_estop(self) -> None:
        self.calls.append(("clear_estop",))
        self.latched = False

    def add_wrench(self, **spec: Any) -> int:
        self.calls.append(("add_wrench", spec))
        return 1

    def list_wrenches(self) -> tuple[Any, ...]:
        return ()

    def remove_wrench(self, key: int) -> None:
        raise KeyError(f"wrench {key} is not at work")


class FakeRobotSession(RobotSession):
    """A robot that can be asked for nothing but a change of its drives' state."""

    def __init__(self) -> None:
        self.pipeline = SimpleNamespace(controller_names=("model_based",), estimator_names=("adaptive",))

    def drive(self, request: str) -> int:
        if request == "stand":
            raise SessionError("the e-stop is latched")
        return 7


def failing_session(config: SimulationConfig) -> FakeSession:
    """Like a session whose robot cannot be reached."""
    raise BackendError("no robot answers; switch it on")
