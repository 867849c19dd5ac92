"""One robot on trial: the full stack as it ships, or with one thing changed, and the simulator's truth beside it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from control.baselines.baseline_controller import BaselineController, make_baseline
from control.baselines.baseline_weights import available_baselines
from control.command.limits import DEFAULT_COMMAND
from control.estimation.registry import LEARNED_NAMES, EstimatorsConfig
from control.pipeline import PipelineConfig
from control.policy.policy_controller import make_policy
from control.policy.policy_weights import available_policies
from control.robot_model import RobotModel
from control.timing import SLOT_COUNT, TICK_S
from control.types import Command
from control.whole_body.controller import Controller, ControllerInput
from sim.backends.protocol import GroundTruth
from sim.runtime.simulation import Simulation, SimulationConfig

FALLEN_UP_COSINE = 0.75
FALLEN_HEIGHT_M = 0.2
SHIPPED_ESTIMATOR = PipelineConfig().estimator


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
    estimator: str = SHIPPED_ESTIMATOR
    gains: tuple[float, float] | None = None
    force_input: str = "estimate"
    mass_scale: float = 1.0
    push_n: float = 0.0


def controller_setups(directory: Path) -> dict[str, TrialSetup]:
    """What can be tried, by name: the model-based controller, policies and baselines of `directory`, whatever they scored."""
    setups = {"model_based": TrialSetup()}
    for name in available_policies(directory):
        setups[name] = TrialSetup(controller=name, make=partial(make_policy, directory, name))
    for name in available_baselines(directory):
        setups[name] = TrialSetup(controller=name, make=partial(make_baseline, directory, name))
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


class Trial:
    """A setup in a scene, on the full stack with noisy sensors: run, look at truth, put a wrench on."""

    def __init__(self, setup: TrialSetup, seed: int, scene: str = "free", settle_s: float = 1.0) -> None:
        # Networks that feed nothing would only take time.
        estimators = EstimatorsConfig() if setup.estimator in LEARNED_NAMES else EstimatorsConfig(weights=None)
        config = PipelineConfig(controller="model_based", estimator=setup.estimator, estimators=estimators, policies=None)
        self.session = Simulation(SimulationConfig(scene=scene, seed=seed, pipeline=config))
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

    @property
    def truth(self) -> GroundTruth:
        """Truth of the last tick."""
        return self.session.truth()

    @property
    def hand_in_heading(self) -> np.ndarray:
        """(3,) m, true hand position in the true heading frame."""
        truth = self.truth
        origin = truth.base_position * [1.0, 1.0, 0.0]
        return (truth.end_effector_position - origin) @ truth.rotation_heading_to_world

    @property
    def fallen(self) -> bool:
        """The base lies or leans beyond recovery, or the safety gate damps."""
        w, x, y, z = self.truth.base_orientation_wxyz
        up = w * w - x * x - y * y + z * z
        floor_normal = self.session.backend.data.geom("floor").xmat.reshape(3, 3)[:, 2]  # the floor holds the origin
        low = floor_normal @ self.truth.base_position < FALLEN_HEIGHT_M
        return bool(up < FALLEN_UP_COSINE or low or self.session.output.safety.damping)

    @property
    def own_force_n(self) -> np.ndarray | None:
        """(3,) N, environment on hand, in heading, as the controller itself estimates it; None where it does not."""
        pipeline = self.session.pipeline
        controller = pipeline.controllers[pipeline.controller_name]
        return controller.force_estimated_n if isinstance(controller, BaselineController) else None

    def run(self, command: Command, seconds: float) -> Iterator[float]:
        """Tick under a command; yields the elapsed time, s, every controller period.

        Raises:
            FailureError: a controller or an estimator failed.
        """
        for tick in range(1, round(seconds / TICK_S) + 1):
            self.session.tick(command).raise_failures()
            if tick % SLOT_COUNT == 0:
                yield tick * TICK_S

    def _force_input(self, name: str) -> Callable[[], np.ndarray]:
        if name == "zero":
            return lambda: np.zeros(3)
        if name == "truth":
            return lambda: self.truth.force_true_n
        raise ValueError(f"force input {name!r} is none of 'estimate', 'truth', 'zero'")
