"""The whole path from sensors to drives, composed here and nowhere else.

sensors -> base state -> model terms -> momentum observers -> wrench projections -> command filter and guidance ->
controller -> safety gate. Physics, observers and the selected projection run at 500 Hz; the controller and the
projections that are only shown run at 50 Hz, spread over the ticks between (control.timing.TIMETABLE).

A controller or an estimator that raises stops nothing else: its last good result grows old, the safety gate acts on that, and
the fault names it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import reduce
from operator import or_
from pathlib import Path
from types import MappingProxyType

import numpy as np

from control.baselines.baseline_controller import make_baselines
from control.command.blocked_base import BlockedBase, BlockedBaseConfig
from control.command.filter import CommandFilter
from control.command.guidance import Guidance, GuidanceConfig
from control.command.hand_state import hand_state
from control.command.limits import DEFAULT_COMMAND, CommandLimits, HandState, clip_command
from control.command.reach_watch import ReachWatch
from control.command.self_contact import SelfContactBorder, SelfContactConfig
from control.command.tip_over import feasible_force_scale, relief_velocity
from control.estimation.base_state import BaseStateConfig, BaseStateEstimator
from control.estimation.force_estimator import EstimatorInput, ForceEstimator, require_sound
from control.estimation.mistrust import EstimatorFlag, Mistrust, MistrustConfig
from control.estimation.odometry import OdometryConfig, WheelOdometry
from control.estimation.registry import EstimatorsConfig, adaptive_of, bases, make_estimators
from control.estimation.rolling_contact import rolling_velocity
from control.failures import FailureError, Failures
from control.faults import Fault
from control.hand_load.load import HandLoad
from control.hand_load.tool import IdentificationConfig
from control.joints import JOINT_COUNT
from control.paths import WEIGHTS_DIRECTORY
from control.policy.policy_controller import make_policies
from control.robot_model import RobotModel
from control.safety import SafetyConfig, SafetyGate, SafetyStatus
from control.timing import CONTROL_PERIOD_S, SLOT_COUNT, Job, due, shown_slots
from control.types import BaseState, Command, ForceEstimate, JointCommand, Odometry, SensorFrame
from control.values import value
from control.whole_body.controller import Controller, ControllerInput
from control.whole_body.model_based import ModelBasedController

MASS_SCALES = (0.6, 1.4)
"""Estimated masses beyond these are not believed: a robot that is lifted seems lighter than it is."""


@dataclass(frozen=True, slots=True)
class PipelineConfig:
    """Everything that shapes the pipeline, composed once by whoever starts it.

    `policies` is the folder with the weights of learned controllers; None to run without them, on "model_based".
    """

    controller: str = "policy"
    estimator: str = "hybrid"
    policies: Path | None = WEIGHTS_DIRECTORY
    limits: CommandLimits = field(default_factory=CommandLimits)
    base_state: BaseStateConfig = field(default_factory=BaseStateConfig)
    odometry: OdometryConfig = field(default_factory=OdometryConfig)
    estimators: EstimatorsConfig = field(default_factory=EstimatorsConfig)
    mistrust: MistrustConfig = field(default_factory=MistrustConfig)
    identification: IdentificationConfig = field(default_factory=IdentificationConfig)
    guidance: GuidanceConfig = field(default_factory=GuidanceConfig)
    self_contact: SelfContactConfig = field(default_factory=SelfContactConfig)
    blocked_base: BlockedBaseConfig = field(default_factory=BlockedBaseConfig)
    safety: SafetyConfig = field(default_factory=SafetyConfig)


@value
class PipelineOutput:
    """One tick's result.

    Attributes:
        joint_command: to the drives.
        applied_command: after guidance, limits, tip-over limit and filter.
        base: estimated state of the base.
        odometry: where it has rolled to since the last reset.
        hand: pose, and the force that the selected estimator gives; zero before its first estimate.
        estimates: newest estimate by estimator, of those that have given one.
        estimator_flags: why the estimate that feeds the controller is to be mistrusted.
        safety: what the gate did and why.
        failures: which controller or estimators raised what, by CONTROLLER_ERROR and ESTIMATOR_ERROR; empty when all is well.
    """

    joint_command: JointCommand
    applied_command: Command
    base: BaseState
    odometry: Odometry
    hand: HandState
    estimates: dict[str, ForceEstimate]
    estimator_flags: EstimatorFlag
    safety: SafetyStatus
    failures: dict[Fault, str]

    def raise_failures(self) -> None:
        """For trials and recordings, in which a contained failure must not pass for a result.

        Raises:
            FailureError: a controller or an estimator failed.
        """
        if self.failures:
            raise FailureError("; ".join(self.failures.values()))


class UnknownNameError(ValueError):
    """A controller or estimator name that does not exist; the message lists those that do."""

    def __init__(self, kind: str, name: str, known: tuple[str, ...]) -> None:
        super().__init__(f"unknown {kind} {name!r}; available: {', '.join(known)}")


class Pipeline:
    """Steps at 500 Hz from a sensor frame to a joint command. Holds no clock and sees no simulator.

    Attributes:
        estimator_names: force estimators that run side by side.
        bases: the estimator from whose estimate another one makes its own, by the name of the other one.
        hand_load: tool and tare.
        shown_slots: slot of the timetable in which each estimator but the selected one is shown.
    """

    STATE = (
        "model",
        "_base_state",
        "_odometry",
        "_estimators",
        "_controllers",
        "hand_load",
        "_filter",
        "_guidance",
        "_self_contact",
        "_reach",
        "_blocked_base",
        "_safety",
        "_failures",
        "controller_name",
        "estimator_name",
        "shown_slots",
        "_asked_for",
        "_tick",
        "_estimates",
        "_applied",
        "_asked",
        "_clipped",
        "_limited",
        "_starting",
        "_controller_reset_due",
    )

    def __init__(self, config: PipelineConfig) -> None:
        self.config = config
        self.model = RobotModel()
        self._base_state = BaseStateEstimator(config.base_state, self.model)
        self._odometry = WheelOdometry(config.odometry, self.model)
        self._estimators = make_estimators(self.model, config.estimators)
        self.estimator_names = tuple(self._estimators)
        self.bases = bases(self._estimators)
        self._observed = adaptive_of(self._estimators)
        self._controllers: dict[str, Controller] = {"model_based": ModelBasedController(self.model)}
        self._controllers |= make_policies(config.policies, self.model) | make_baselines(config.policies)
        self.hand_load = HandLoad(config.identification, self.model, self._observed)
        self._filter = CommandFilter(config.limits)
        self._guidance = Guidance(config.guidance)
        self._led_limits = replace(config.limits, force_n=config.limits.guidance_force_n)
        self._mistrust = Mistrust(config.mistrust, self.model)
        self._self_contact = SelfContactBorder(config.self_contact, self.model)
        self._reach = ReachWatch()
        self._blocked_base = BlockedBase(config.blocked_base)
        self._safety = SafetyGate(config.safety, self.model)
        self._failures = Failures()
        self.controller_name = ""
        self.estimator_name = ""
        self.select_controller(config.controller)
        self.select_estimator(config.estimator)
        self.reset()

    @property
    def controller_names(self) -> tuple[str, ...]:
        """Controllers that can be selected."""
        return tuple(self._controllers)

    @property
    def controllers(self) -> Mapping[str, Controller]:
        """The controllers themselves, by name, for those that show what is inside."""
        return MappingProxyType(self._controllers)

    @property
    def estimators(self) -> Mapping[str, ForceEstimator]:
        """The estimators themselves, by name, for those that record what is inside."""
        return MappingProxyType(self._estimators)

    def reset(self) -> None:
        """Forget everything, as at power-on: the next frame initialises filters and observers."""
        self._tick = 0
        self._estimates: dict[str, ForceEstimate] = {}
        self._applied = DEFAULT_COMMAND
        self._asked: Command | None = None
        self._clipped = DEFAULT_COMMAND
        self._limited = Fault.NONE
        self._starting = True
        self._controller_reset_due = True
        self._failures.clear()
        self._base_state.reset()
        self._odometry.reset()
        for estimator in self._estimators.values():
            estimator.reset()
        self.hand_load.reset()
        self._filter.reset()
        self._guidance.reset()
        self._reach.reset()
        self._blocked_base.reset()
        self._self_contact.reset()
        self._safety.reset()

    def add_controller(self, name: str, controller: Controller) -> None:
        """Offer one more controller, or another one under a known name; it can be selected from now on."""
        self._controllers[name] = controller

    def select_controller(self, name: str) -> None:
        """Switch controllers; the new one starts from rest and the safety gate blends its targets in.

        Raises:
            UnknownNameError: no controller has that name.
        """
        if name not in self._controllers:
            raise UnknownNameError("controller", name, self.controller_names)
        self._failures.forgive(Fault.CONTROLLER_ERROR, self.controller_name)
        self.controller_name = name
        self._controller_reset_due = True
        self._safety.hand_over()

    def select_estimator(self, name: str, gains: tuple[float, float] | None = None) -> None:
        """Choose which estimate feeds the controller, optionally with new observer gains (K1, K2).

        Raises:
            UnknownNameError: no estimator has that name.
            ValueError: gains that are not positive.
        """
        if name not in self._estimators:
            raise UnknownNameError("estimator", name, self.estimator_names)
        if gains is not None:
            self._estimators[name].set_gains(*gains)
        self.estimator_name = name
        self._failures.forgive(Fault.ESTIMATOR_ERROR, name)
        self.shown_slots = shown_slots(self.estimator_names, name, self.bases)
        shown = self.shown_slots.items()
        self._asked_for = [(name, *(other for other, own in shown if own == slot)) for slot in range(SLOT_COUNT)]

    @property
    def applied_command(self) -> Command:
        """Of the last tick, after guidance, limits and filter."""
        return self._applied

    @property
    def estop_latched(self) -> bool:
        """Whether the e-stop is latched."""
        return self._safety.estop_latched

    def estop(self) -> None:
        """Latch the e-stop: damping from the next tick on."""
        self._safety.estop()

    def clear_estop(self) -> None:
        """Clear the latched e-stop and any latched fault; the robot stands up from where it is."""
        self._safety.clear()
        self._starting = True
        self._filter.reset()
        self._controller_reset_due = True

    def step(self, sensor: SensorFrame, command: Command, command_age_s: float = 0.0) -> PipelineOutput:
        """Advance one 2 ms tick.

        Args:
            sensor: newest sensor frame.
            command: newest command as asked, which is not changed afterwards: it is checked once.
            command_age_s: time since the operator's side was last heard.

        Raises:
            CommandError: the command is malformed (out of range is clipped).
        """
        base = self._base_state.step(sensor)
        self.model.update_velocity(base.linear_velocity_in_base, base.angular_velocity_in_base, sensor.joint_velocity)
        self._estimate(EstimatorInput(self._tick, self.model, sensor, base, self._applied.mask))
        flags, estimate = EstimatorFlag.NONE, self._estimates.get(self.estimator_name)
        if estimate is not None:
            unexplained = _EXPLAINED if self._observed is None else self._observed.unexplained
            distance = self._self_contact.distance_m
            flags, estimate = self._mistrust.judge(estimate, sensor.joint_position, unexplained, distance)
            self._estimates[self.estimator_name] = estimate
        odometry = self._odometry.step()
        hand = hand_state(self.model, base.height_m, _NO_FORCE if estimate is None else estimate.force_estimated_n)
        if estimate is not None:  # no controller acts on a force that nobody has estimated
            if due(Job.REFERENCES, self._tick) or self._starting:
                self.hand_load.step(hand.force_estimated_n + self.hand_load.offset(self.estimator_name), sensor.joint_velocity)
                self._refer(self._safety.check_command(command, command_age_s), hand, base, _bounded(estimate.mass_scale))
            if due(Job.CONTROLLER, self._tick) or self._starting:
                masses = _NOMINAL if estimate.mass_scales is None else estimate.mass_scales.clip(*MASS_SCALES)
                self._control(ControllerInput(sensor, base, self.model, self._applied, hand.force_estimated_n, masses))
            self._starting = False
        failures = self._failures.at(self._tick)
        reported = reduce(or_, failures, self._limited) if failures else self._limited
        if estimate is None or estimate.stale:
            reported |= Fault.ESTIMATOR_STALE
        joint_command, safety = self._safety.step(sensor, base, reported)
        self._tick += 1
        return PipelineOutput(joint_command, self._applied, base, odometry, hand, self._estimates, flags, safety, failures)

    def estimate_alone(self, sensor: SensorFrame, mask: np.ndarray | None = None) -> ForceEstimate:
        """Advance one tick with the selected estimator alone: no controller, no other estimator, nothing to drive.

        Args:
            sensor: newest sensor frame.
            mask: (3,) applied at the tick before; None for the last one of `step`.
        """
        base = self._base_state.step(sensor)
        self.model.update_velocity(base.linear_velocity_in_base, base.angular_velocity_in_base, sensor.joint_velocity)
        estimator = self._estimators[self.estimator_name]
        estimator.observe(EstimatorInput(self._tick, self.model, sensor, base, self._applied.mask if mask is None else mask))
        self._tick += 1
        return self._tared(self.estimator_name, estimator.estimate())

    def _refer(self, command: Command, hand: HandState, base: BaseState, mass_scale: float) -> None:
        if not self._safety.in_control:
            # References start from wherever the robot is when the controller gets hold of it.
            self._filter.reset()
            self._self_contact.reset()
            self._controller_reset_due = True
        limits = self.config.limits
        command = self.hand_load.refer(command, self._safety.in_control)
        command = self._guidance.step(command, hand, CONTROL_PERIOD_S)
        bearable = feasible_force_scale(hand.force_estimated_n, self.model, limits.tip_over_margin_m, mass_scale)
        relieved = bearable < 1.0 and not command.guidance
        drive = command.base_velocity
        if relieved:
            drive = drive + relief_velocity(hand.force_estimated_n, bearable)
        velocity = self.model.rotation_heading_to_world.T @ base.rotation_base_to_world @ base.linear_velocity_in_base
        velocity[2] = base.angular_velocity_in_base[2]
        rolled = self.model.rotation_heading_to_world.T @ rolling_velocity(self.model)
        applied = self._applied.base_velocity
        self._blocked_base.step(command.base_velocity, drive, applied, velocity, rolled, CONTROL_PERIOD_S)
        if self._blocked_base.blocked:
            free = self._blocked_base.free(drive)
            self._filter.drive_no_faster(velocity, free != drive)
            drive = free
        if drive is not command.base_velocity:
            command = replace(command, base_velocity=drive)
        if command is not self._asked:
            bounds = self._led_limits if command.guidance else limits
            self._asked, self._clipped = command, clip_command(command, bounds)
        command = self._clipped
        # A led hand asks for no force of its own: with less it would give way to the pull, not bear less of it.
        asked = _NO_FORCE if command.guidance else command.mask * command.force_n
        share = feasible_force_scale(asked, self.model, limits.tip_over_margin_m, mass_scale)
        limited = Fault.TIP_OVER_LIMIT if relieved or share < 1.0 else Fault.NONE
        if self._blocked_base.blocked:
            limited |= Fault.BASE_BLOCKED
        if share < 1.0:
            command = replace(command, force_n=share * command.force_n)
        command, held = self._self_contact.step(command, hand)
        if held:
            limited |= Fault.SELF_CONTACT_LIMIT
        self._applied = self._filter.step(command, hand, CONTROL_PERIOD_S)
        if self._reach.step(self._applied, hand.position_in_heading, CONTROL_PERIOD_S):
            limited |= Fault.OUT_OF_REACH
        # Where the drives damp, nothing of the command acts that could be limited.
        self._limited = limited if self._safety.in_control else Fault.NONE

    def _control(self, inputs: ControllerInput) -> None:
        """New targets. Where the controller raises, the last ones grow old, which the safety gate answers."""
        controller = self._controllers[self.controller_name]
        try:
            if self._controller_reset_due:
                controller.reset()
                self._controller_reset_due = False
            self._safety.accept(controller.step(inputs), inputs.sensor.time_s)
        except Exception as error:
            self._failures.note(Fault.CONTROLLER_ERROR, self.controller_name, error, self._tick)

    def _estimate(self, inputs: EstimatorInput) -> None:
        """New estimates of those whose turn it is. Where an estimator raises, its last good estimate is marked stale."""
        asked = self._asked_for[inputs.tick % SLOT_COUNT]
        for name, estimator in self._estimators.items():
            try:
                estimator.observe(inputs)
                if name in asked:
                    self._estimates[name] = self._tared(name, require_sound(estimator.estimate()))
            except Exception as error:
                self._failures.note(Fault.ESTIMATOR_ERROR, name, error, self._tick)
                if name in self._estimates:
                    self._estimates[name] = replace(self._estimates[name], stale=True)

    def _tared(self, name: str, estimate: ForceEstimate) -> ForceEstimate:
        offset = self.hand_load.offset(name)
        return replace(estimate, force_estimated_n=estimate.force_estimated_n - offset) if offset.any() else estimate


def _bounded(mass_scale: float | None) -> float:
    """`mass_scale` as far as control believes it; 1 where nothing estimates it."""
    return 1.0 if mass_scale is None else min(max(mass_scale, MASS_SCALES[0]), MASS_SCALES[1])


_NOMINAL = np.ones(2)
_EXPLAINED = np.zeros(6 + JOINT_COUNT)
_NO_FORCE = np.zeros(3)
_NO_FORCE.setflags(write=False)
_NOMINAL.setflags(write=False)
