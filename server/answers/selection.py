"""Schemas of backend, controller and estimator: what is selected and what can be."""

from typing import Literal, NotRequired

from server.answers.schema import Answer

BackendName = Literal["simulation", "hardware", "replay"]


class AvailableBackend(Answer):
    """A backend, and whether it can be chosen."""

    name: BackendName
    """in PUT"""
    available: bool
    """it can be chosen"""
    reason: str | None
    """why not"""


class RobotOptions(Answer):
    """Which robot, and how, or which recording; of the simulation none."""

    dry_run: NotRequired[bool]
    """compute everything and send nothing"""
    allow_robot: NotRequired[bool]
    """consent to a network that may hold a real robot"""
    domain: NotRequired[int]
    """DDS domain of the base"""
    interface: NotRequired[str]
    """network interface that leads to the base"""
    arm_host: NotRequired[str]
    """address of the arm's z1_ctrl"""
    arm_port: NotRequired[int]
    """UDP port on which z1_ctrl listens"""
    recording: NotRequired[str]
    """id of the recording that is shown"""


class BackendAnswer(Answer):
    """What the pipeline drives."""

    name: BackendName
    """of the one at work"""
    options: RobotOptions
    """of the robot; none of the simulation"""
    available: list[AvailableBackend]
    """all backends"""


class ControllerAnswer(Answer):
    """The controller."""

    name: str
    """of the selected one"""
    available: list[str]
    """that can be chosen"""


class ObserverGains(Answer):
    """Gains of the generalized momentum observer."""

    k1: float
    """1/s, on the error of the momentum"""
    k2: float
    """1/s^2, on its integral"""


class AvailableEstimator(Answer):
    """An estimator that runs."""

    name: str
    """in PUT, and in the state's `force_estimates_n`"""
    error_rms_n: float | None
    """N, length of the error against the true force, RMS over the last 5 s; null where truth is not known"""


class EstimatorAnswer(Answer):
    """The estimator that feeds the controller."""

    name: str
    """of the selected one"""
    gains: ObserverGains | None
    """as set last; null: those it starts with"""
    available: list[AvailableEstimator]
    """all run side by side"""
