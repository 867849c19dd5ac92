"""What the hand carries and reads without contact: its tool, its tare, and the motion that finds the tool."""

from dataclasses import dataclass, field

import numpy as np

from control.command.command_record import COMMAND
from control.estimation.adaptive_estimator import AdaptiveEstimator
from control.hand_load.tare import Tare, TareError
from control.hand_load.tool import IdentificationConfig, Tool, ToolError, ToolIdentification
from control.robot_model import GRAVITY_MPS2, RobotModel
from control.timing import CONTROL_PERIOD_S
from control.types import Command

SLOW_RPS = 0.2
"""No joint of a robot at rest is faster."""

WEIGHED_N, FELT_SHARE = 5.0, 0.3
"""A change of the tool's weight by so much shows in what the hand reads; less than this share of it was not there."""

WEIGHING_S = 1.5
"""What the hand reads is averaged over so long to tell whether a tool hangs there: longer than a touch."""


@dataclass(frozen=True, slots=True)
class HandLoadState:
    """Attributes:
    tool: as set or found.
    offset_n: (3,) N, in heading, that is taken from the selected estimate.
    identifying: progress of the motion, 0 to 1; None without one.
    message: why the last motion found nothing, or why the tool as told seems not to be there; empty otherwise.
    """

    tool: Tool = field(default_factory=Tool)
    offset_n: np.ndarray = field(default_factory=lambda: np.zeros(3))
    identifying: float | None = None
    message: str = ""


class HandLoad:
    """Tool and tare of one robot. The tool stays when the pipeline is reset, the tare does not."""

    STATE = ("_tool", "_weighed", "_weighing_s", "_read_n", "_tare", "_motion", "_asked", "_message")

    def __init__(self, config: IdentificationConfig, model: RobotModel, observed: AdaptiveEstimator | None) -> None:
        """`observed`: whose residual shows what the model lacks, and whose masses begin anew with another tool, if it runs."""
        self._config, self._model, self._observed = config, model, observed
        self._tool, self._weighed = Tool(), True
        self._weighing_s, self._read_n = 0.0, 0.0
        self._tare = Tare()
        self._motion: ToolIdentification | None = None
        self._asked: Command | None = None
        self._message = ""

    def state(self, estimator: str) -> HandLoadState:
        """As it is now, for the selected estimator."""
        progress = None if self._motion is None else self._motion.progress
        return HandLoadState(self._tool, self.offset(estimator), progress, self._message)

    def reset(self) -> None:
        """Forget the tare and end the motion."""
        self._tare.clear()
        self._motion = None
        self._weighing_s = 0.0

    def offset(self, estimator: str) -> np.ndarray:
        """(3,) N, in heading, that belongs to no contact."""
        return self._tare.offsets.get(estimator, _NONE)

    def tare(self, estimator: str, applied: Command) -> np.ndarray:
        """Make what a free hand reads its zero; the offset (3,), N.

        Raises:
            TareError: the hand presses, is led, moves, or reads more than a bias.
        """
        _require_idle(applied, "tare")
        return self._tare.take(estimator)

    def clear_tare(self) -> None:
        """Forget all offsets."""
        self._tare.clear()

    def set_tool(self, tool: Tool) -> None:
        """Let model, controller and estimators carry a tool from the next tick on.

        A weight that the resting hand does not read is carried all the same, for it may be put on later, but said so. The
        lever of a heavy tool is inert only once the hand reads no more with it than what touches it: where 3 kg at 0.3 m were
        told and are not there, the wrist would seem fifty times as inert as it is, its every turn would be taken for a force,
        and the robot would throw itself over.
        """
        self._message = self._doubt(tool)
        self._carry(tool, weighed=GRAVITY_MPS2 * tool.mass_kg < WEIGHED_N)
        if self._observed is not None:
            self._observed.forget_parameters()
        self._tare.clear()

    def identify_tool(self, applied: Command) -> None:
        """Begin the motion that finds the tool; any other command ends it.

        Raises:
            TareError: the hand presses or is led, or no estimator runs that would show the tool.
        """
        if self._observed is None:
            raise TareError("the motion that finds a tool needs the estimator `adaptive`")
        _require_idle(applied, "the motion that finds a tool")
        self._motion, self._asked = ToolIdentification(self._config, self._model, applied), None
        self._message = ""

    def refer(self, asked: Command, in_control: bool) -> Command:
        """The command of now: the motion's while there is one, else the operator's.

        Args:
            asked: by the operator; a change ends the motion.
            in_control: the controller moves the robot.
        """
        if self._motion is None:
            return asked
        if self._asked is None:
            self._asked = asked
        if not in_control or not _same(asked, self._asked):
            self._motion, self._message = None, "no tool was found: another command or a stop ended the motion"
            return asked
        return self._motion.command()

    def step(self, force_n: np.ndarray, joint_velocity: np.ndarray) -> None:
        """Take in one control period.

        Args:
            force_n: (3,) N, of the selected estimator, without its offset.
            joint_velocity: (22,) rad/s.
        """
        if np.abs(joint_velocity).max() > SLOW_RPS:
            self._tare.restart()
        else:
            self._tare.observe(force_n, CONTROL_PERIOD_S)
        if not self._weighed:
            self._weigh(force_n[2])
        if self._motion is None or self._observed is None:
            return
        self._motion.step(self._model, self._observed.momentum.residual, CONTROL_PERIOD_S)
        if self._motion.finished:
            motion, self._motion = self._motion, None
            try:
                self.set_tool(motion.tool(self._tool))
            except ToolError as error:
                self._message = f"no tool was found: {error}"

    def _carry(self, tool: Tool, *, weighed: bool) -> None:
        self._tool, self._weighed, self._weighing_s = tool, weighed, 0.0
        self._model.carry(tool.mass_kg, tool.center_of_mass_m, inert_lever=weighed)

    def _weigh(self, upward_n: float) -> None:
        """A tool hangs on the hand unless that reads upwards what the tool would weigh."""
        self._weighing_s += CONTROL_PERIOD_S
        self._read_n += CONTROL_PERIOD_S / min(self._weighing_s, WEIGHING_S) * (upward_n - self._read_n)
        bound = max(0.5 * WEIGHED_N, FELT_SHARE * GRAVITY_MPS2 * self._tool.mass_kg)
        if self._weighing_s > WEIGHING_S and self._read_n < bound:
            self._carry(self._tool, weighed=True)

    def _doubt(self, tool: Tool) -> str:
        """Why this tool seems not to hang on the hand; empty where it may."""
        reads, weight = self._tare.steady(), GRAVITY_MPS2 * (self._tool.mass_kg - tool.mass_kg)
        if reads is None or abs(weight) < WEIGHED_N or reads[2] / weight > FELT_SHARE:
            return ""
        return f"before this change the hand read {reads[2]:.1f} N upwards, not {weight:.1f} N: is the tool mounted as told?"


def _require_idle(applied: Command, what: str) -> None:
    """Raises TareError where the hand is asked for a force or led."""
    if applied.guidance or applied.mask.any():
        raise TareError(f"{what} needs a hand on position control: set the mask to 0 0 0 and guidance to false")


def _same(one: Command, other: Command) -> bool:
    return one.guidance == other.guidance and all(
        np.array_equal(getattr(one, name), getattr(other, name)) for name in COMMAND.names or ()
    )


_NONE = np.zeros(3)
_NONE.setflags(write=False)
