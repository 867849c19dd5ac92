"""The estimators under test beside the one that drives: all fed the same ticks and asked at the same instants."""

from collections import deque
from collections.abc import Sequence

import numpy as np

from control.estimation.force_estimator import EstimatorInput, ForceEstimator
from control.estimation.registry import EstimatorsConfig, make_estimators
from control.frames import rotation_from_quaternion
from control.robot_model import RobotModel
from control.types import BaseState, SensorFrame
from sim.backends.protocol import GroundTruth
from sim.benchmarks.estimator_ablations import Ablation, make_ablation
from sim.benchmarks.estimator_scores import Scores


class EstimatorPanel:
    """Estimators that watch one rollout, and how far each is off.

    Attributes:
        force_true_n: (3,) N in heading at every sample that was scored.
    """

    def __init__(self, model: RobotModel, delay_ticks: int, ablations: Sequence[Ablation] = ()) -> None:
        """`model` is the pipeline's, updated at every tick; `delay_ticks` is the age of its sensor frames."""
        config = EstimatorsConfig()
        self._model = model
        self._estimators: dict[str, ForceEstimator] = make_estimators(model, config)
        self._true_model = RobotModel()
        self._true_velocities: deque[np.ndarray] = deque(maxlen=delay_ticks + 1)
        self._informed: dict[str, ForceEstimator] = {}
        for ablation in ablations:
            group, its_model = (self._informed, self._true_model) if ablation.true_velocity else (self._estimators, model)
            group[ablation.name] = make_ablation(ablation, its_model, config)
        self.force_true_n: list[np.ndarray] = []
        self._tick = 0
        self._errors: dict[str, list[np.ndarray]] = {name: [] for name in self.names}
        self._sigmas: dict[str, list[np.ndarray]] = {name: [] for name in self.names}

    @property
    def names(self) -> tuple[str, ...]:
        """Estimators, then ablations."""
        return (*self._estimators, *self._informed)

    def observe(self, sensor: SensorFrame, base: BaseState, mask: np.ndarray, truth: GroundTruth) -> None:
        """Feed one tick, after the pipeline has taken it."""
        inputs = EstimatorInput(self._tick, self._model, sensor, base, mask)
        self._tick += 1
        for estimator in self._estimators.values():
            estimator.observe(inputs)
        if self._informed:
            informed = self._with_true_velocity(inputs, truth)
            for estimator in self._informed.values():
                estimator.observe(informed)

    def sample(self, truth: GroundTruth, scored: bool) -> None:
        """Ask every estimator, once per control period from the first tick on, whatever the live loop spends on it.

        Args:
            truth: of this tick.
            scored: note the errors.
        """
        if scored:
            self.force_true_n.append(truth.force_true_n)
        for name, estimator in (self._estimators | self._informed).items():
            estimate = estimator.estimate()
            if scored:
                self._errors[name].append(estimate.force_estimated_n - truth.force_true_n)
                self._sigmas[name].append(np.full(3, np.nan) if estimate.sigma_n is None else estimate.sigma_n)

    def scores(self) -> dict[str, Scores]:
        """Errors so far by estimator; empty where nothing was scored."""
        if not self.force_true_n:
            return {}
        return {name: Scores(np.array(self._errors[name]), np.array(self._sigmas[name])) for name in self.names}

    def _with_true_velocity(self, inputs: EstimatorInput, truth: GroundTruth) -> EstimatorInput:
        rotation = rotation_from_quaternion(truth.base_orientation_wxyz)
        self._true_velocities.append(truth.base_linear_velocity @ rotation)
        base, sensor, velocity = inputs.base, inputs.sensor, self._true_velocities[0]
        known = BaseState(base.rotation_base_to_world, velocity, base.angular_velocity_in_base, base.height_m)
        self._true_model.update(
            known.rotation_base_to_world,
            sensor.joint_position,
            velocity,
            known.angular_velocity_in_base,
            sensor.joint_velocity,
        )
        return EstimatorInput(inputs.tick, self._true_model, sensor, known, inputs.mask)
