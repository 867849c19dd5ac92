"""Trials of any controller on the full stack: random whole-body commands and box dragging, judged by simulator truth.

The robot runs its real estimators on noisy sensors; for studies the controller's force input can be replaced.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from control.command.limits import DEFAULT_COMMAND
from control.estimation.registry import LEARNED_NAMES, EstimatorsConfig
from control.frames import rotation_from_quaternion
from control.joints import END_EFFECTOR_FRAME
from control.pipeline import PipelineConfig
from control.policy.policy_controller import make_policy
from control.policy.policy_weights import available_policies
from control.robot_model import RobotModel
from control.timing import CONTROL_PERIOD_S
from control.types import Command
from control.whole_body.controller import Controller, ControllerInput
from sim.backends.simulation.wrenches import Pulse
from sim.runtime.session import Session, SessionConfig
from sim.scenes.box import CENTER_X_M, TOP_HEIGHT_M
from sim.trials.control_trials import SETTLE_S, SWITCH_S, RandomSegments, Trial


@dataclass(frozen=True, slots=True)
class TrialSetup:
    """What is tried.

    Attributes:
        controller: name in the pipeline, or of `make`.
        make: builds a controller that the pipeline does not have.
        estimator: that feeds the controller.
        gains: observer gains (K1, K2) of it, or None.
        force_input: "estimate", "truth" or "zero".
        mass_scale: of the simulated robot; the pipeline is not told.
        push_n: pushes of up to this size on every axis at the hand, one in each segment; 0 for none.
    """

    controller: str = "model_based"
    make: Callable[[RobotModel], Controller] | None = None
    estimator: str = "adaptive"
    gains: tuple[float, float] | None = None
    force_input: str = "estimate"
    mass_scale: float = 1.0
    push_n: float = 0.0


def controller_setups(directory: Path) -> dict[str, TrialSetup]:
    """What there is to try, by name: the model-based controller, and the policies of `directory` whatever they scored."""
    setups = {"model_based": TrialSetup()}
    for name in available_policies(directory):
        setups[name] = TrialSetup(controller=name, make=partial(make_policy, directory, name))
    return setups


class ReplacedForce:
    """A controller whose force input is another one than the estimate."""

    def __init__(self, controller: Controller, force: Callable[[], np.ndarray]) -> None:
        """`force` gives (3,) N in heading."""
        self._controller, self._force = controller, force

    def reset(self) -> None:
        """Forget the controller's history."""
        self._controller.reset()

    def step(self, inputs: ControllerInput) -> np.ndarray:
        """See `Controller.step`."""
        return self._controller.step(replace(inputs, force_estimated_n=self._force()))


class ControllerTrial(Trial):
    """A trial of a setup in a scene."""

    def __init__(self, setup: TrialSetup, seed: int, scene: str = "free", settle_s: float = 1.0) -> None:
        # Networks that feed nothing would only take time.
        estimators = EstimatorsConfig() if setup.estimator in LEARNED_NAMES else EstimatorsConfig(weights=None)
        config = PipelineConfig(controller="model_based", estimator=setup.estimator, estimators=estimators, policies=None)
        self.session = Session(SessionConfig(scene=scene, seed=seed, pipeline=config))
        pipeline = self.session.pipeline
        if setup.gains is not None:
            pipeline.select_estimator(setup.estimator, setup.gains)
        if setup.make is not None:
            pipeline.add_controller(setup.controller, setup.make(pipeline.model))
        pipeline.select_controller(setup.controller)
        if setup.force_input != "estimate":
            controller = pipeline.controllers[setup.controller]
            pipeline.add_controller(setup.controller, ReplacedForce(controller, self._force_input(setup.force_input)))
        if setup.mass_scale != 1.0:
            self.session.set_mismatch(setup.mass_scale)
        for _ in self.run(DEFAULT_COMMAND, settle_s):
            pass

    def _force_input(self, name: str) -> Callable[[], np.ndarray]:
        if name == "zero":
            return lambda: np.zeros(3)
        if name == "truth":
            return lambda: self.truth.force_true_n
        raise ValueError(f"force input {name!r} is none of 'estimate', 'truth', 'zero'")


@dataclass(slots=True)
class Errors:
    """Errors of a random run, one entry per controller period: NaN where an axis is in the other mode.

    `force[mask, level]` (n, 3) N, `position` (n, 3) m, `orientation` (n,) rad, `forward` (n,) m/s, `yaw` (n,) rad/s,
    `estimate` (n, 3) N, `power` (n,) W of all drives, `overshoot` N per axis that changed to force control: the largest
    error beyond the reference in its first second.
    """

    force: dict[tuple[str, float], list[np.ndarray]] = field(default_factory=dict)
    position: list[np.ndarray] = field(default_factory=list)
    orientation: list[float] = field(default_factory=list)
    forward: list[float] = field(default_factory=list)
    yaw: list[float] = field(default_factory=list)
    estimate: list[np.ndarray] = field(default_factory=list)
    power: list[float] = field(default_factory=list)
    overshoot: list[float] = field(default_factory=list)
    falls: int = 0
    pushes: int = 0
    robot_minutes: float = 0.0

    def force_at(self, level_n: float) -> np.ndarray:
        """(n, 3) N, of all masks at a level."""
        parts = [errors for (_, level), errors in self.force.items() if level == level_n and errors]
        return np.concatenate(parts) if parts else np.empty((0, 3))

    def add(self, other: "Errors") -> None:
        """Take in another run."""
        for key, errors in other.force.items():
            self.force.setdefault(key, []).extend(errors)
        for name in ("position", "orientation", "forward", "yaw", "estimate", "power", "overshoot"):
            getattr(self, name).extend(getattr(other, name))
        self.falls += other.falls
        self.pushes += other.pushes
        self.robot_minutes += other.robot_minutes


def random_commands(setup: TrialSetup, seed: int, minutes: float, levels_n: tuple[float, ...] = (10.0, 20.0)) -> Errors:
    """Random commands against virtual springs for a time; after a fall the robot is put back on its wheels."""
    errors, random = Errors(), np.random.default_rng(seed + 1)
    segments = RandomSegments(seed, levels_n)
    trial, last_mask = ControllerTrial(setup, seed), np.zeros(3)
    while errors.robot_minutes < minutes:
        segment, level = segments.draw(trial.hand_in_heading)
        wrench = trial.session.backend.wrenches.add(segment.spring)
        if setup.push_n > 0.0:
            push = Pulse(random.uniform(-setup.push_n, setup.push_n, 3), duration_s=0.3, ramp_s=0.05)
            trial.session.backend.wrenches.add(push)
            errors.pushes += 1
        elapsed = _run_segment(trial, segment.command, segment.duration_s, level, last_mask, errors)
        errors.robot_minutes += elapsed / 60.0
        last_mask = segment.command.mask
        if trial.fallen:
            errors.falls += 1
            seed += 1
            trial, last_mask = ControllerTrial(setup, seed), np.zeros(3)
        else:
            trial.session.backend.wrenches.remove(wrench)
    return errors


def _run_segment(
    trial: ControllerTrial, command: Command, seconds: float, level: float, last_mask: np.ndarray, errors: Errors
) -> float:
    on_force = command.mask > 0.5
    force = errors.force.setdefault(("".join(str(int(m)) for m in command.mask), level), [])
    target = rotation_from_quaternion(command.orientation_wxyz)
    beyond = np.zeros(3)
    elapsed = 0.0
    for elapsed in trial.run(command, seconds):
        truth, output = trial.truth, trial.session.output
        error = truth.force_true_n - command.force_n
        if elapsed <= SWITCH_S:
            applied = truth.force_true_n - output.applied_command.force_n
            beyond = np.maximum(beyond, np.abs(applied) * on_force * (last_mask < 0.5))
        else:
            force.append(np.where(on_force, error, np.nan))
            errors.estimate.append(output.hand.force_estimated_n - truth.force_true_n)
            forward = truth.base_linear_velocity @ truth.rotation_heading_to_world[:, 0]
            errors.forward.append(float(forward - command.base_velocity[0]))
            errors.yaw.append(float(truth.base_angular_velocity[2] - command.base_velocity[2]))
            sensor = trial.session.backend.read()
            errors.power.append(float(np.abs(sensor.joint_torque * sensor.joint_velocity).sum()))
        if elapsed > SETTLE_S:
            errors.position.append(np.where(on_force, np.nan, trial.hand_in_heading - command.position_m))
            hand = trial.session.backend.data.site(END_EFFECTOR_FRAME).xmat.reshape(3, 3)
            turned = truth.rotation_heading_to_world.T @ hand
            cosine = 0.5 * (np.trace(target.T @ turned) - 1.0)
            errors.orientation.append(float(np.arccos(np.clip(cosine, -1.0, 1.0))))
        if trial.fallen:
            break
    errors.overshoot += [float(value) for value in beyond[on_force & (last_mask < 0.5)]]
    return elapsed


@dataclass(frozen=True, slots=True)
class DragResult:
    """One box drag: RMSE of lateral and vertical force, N; extrema of the box, m; whether contact was kept."""

    error_y_n: float
    error_z_n: float
    box_low_m: float
    box_high_m: float
    kept: bool


PRESS_N, DRAG_N, DRAG_HZ = 20.0, 8.0, 0.2
APPROACH_S, PRESS_S, DRAG_PERIODS = 2.5, 2.0, 2
_POINTING_DOWN = np.array([np.cos(0.5), 0.0, np.sin(0.5), 0.0])


def lateral_force(time_s: float) -> float:
    """Force, N, asked for sideways. The first half period has half the amplitude: so the box swings evenly about its place."""
    amplitude = DRAG_N * (0.5 if time_s < 0.5 / DRAG_HZ else 1.0)
    return amplitude * float(np.sin(2.0 * np.pi * DRAG_HZ * time_s))


def drag_box(setup: TrialSetup, seed: int) -> DragResult:
    """Press on the box with 20 N and drag it by a lateral force of 8 N at 0.2 Hz (paper Sec. III.F)."""
    trial = ControllerTrial(setup, seed, scene="box")
    above = replace(
        DEFAULT_COMMAND, position_m=np.array([CENTER_X_M, 0.0, TOP_HEIGHT_M + 0.05]), orientation_wxyz=_POINTING_DOWN
    )
    for _ in trial.run(above, APPROACH_S):
        pass
    touching = replace(above, mask=np.array([0.0, 0.0, 1.0]), force_n=np.array([0.0, 0.0, 3.0]))
    for _ in trial.run(touching, 1.0):
        pass
    pressing = replace(touching, force_n=np.array([0.0, 0.0, PRESS_N]))
    for _ in trial.run(pressing, PRESS_S):
        pass
    errors, places, contact = [], [], []
    for step in range(round(DRAG_PERIODS / DRAG_HZ / CONTROL_PERIOD_S)):
        lateral = lateral_force(CONTROL_PERIOD_S * step)
        command = replace(pressing, mask=np.array([0.0, 1.0, 1.0]), force_n=np.array([0.0, lateral, PRESS_N]))
        for _ in trial.run(command, CONTROL_PERIOD_S):
            pass
        if step * CONTROL_PERIOD_S < 0.5:
            continue
        truth = trial.truth
        errors.append(truth.force_true_n[1:] - command.force_n[1:])
        places.append(float(truth.object_positions[0, 1]))
        contact.append(truth.force_true_n[2] > 0.5)
        if trial.fallen:
            break
    error_y, error_z = np.sqrt(np.mean(np.square(errors), axis=0))
    kept = bool(np.mean(contact) > 0.99) and not trial.fallen
    return DragResult(float(error_y), float(error_z), min(places), max(places), kept)
