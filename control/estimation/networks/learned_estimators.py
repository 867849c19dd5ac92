"""Force estimators with a network: the paper's `tcn` and `hybrid_paper`, and our `hybrid`, eqs. (12)-(15).

The model-based part runs at 500 Hz, the network at 50 Hz; in between its last correction holds.
"""

import numpy as np

from control.estimation.force_estimator import EstimatorInput
from control.estimation.networks.force_network import ForceNetwork, SampleError
from control.estimation.networks.force_signals import signals_at
from control.estimation.projecting_estimator import ProjectingEstimator
from control.timing import Job, due
from control.types import ForceEstimate


class LearnedEstimator:
    """A network on the signals of a model-based estimator, which it corrects or, for `tcn`, replaces.

    The model-based estimator may be one that also runs by itself: it ignores a tick that it has already seen.
    """

    STATE = ("_nominal", "_network", "_inputs", "_asked_tick", "_step_tick", "_force", "_sigma", "_held")

    def __init__(self, nominal: ProjectingEstimator, network: ForceNetwork, period_s: float) -> None:
        """`period_s` is the tick length; the network's own period comes from its manifest."""
        self._nominal = nominal
        self._network = network
        self._ticks_per_step = round(network.manifest.period_s / period_s)
        self._corrects = network.manifest.nominal is not None
        self.reset()

    @property
    def nominal(self) -> ProjectingEstimator:
        """The model-based estimator."""
        return self._nominal

    def set_gains(self, k1: float, k2: float) -> None:
        """Change the gains of the model-based estimator. The network was trained with the default ones.

        Raises:
            ValueError: a gain is not positive and finite.
        """
        self._nominal.set_gains(k1, k2)

    def reset(self) -> None:
        """Forget the past."""
        self._nominal.reset()
        self._network.reset()
        self._inputs: EstimatorInput | None = None
        self._asked_tick = 0
        self._step_tick: int | None = None
        self._force = np.zeros(3)
        self._sigma: np.ndarray | None = None
        self._held = False

    def observe(self, inputs: EstimatorInput) -> None:
        """Take in one 500 Hz tick."""
        if self._nominal.momentum.newest is not inputs:
            self._nominal.observe(inputs)
        self._inputs = inputs

    def estimate(self) -> ForceEstimate:
        """Nominal force plus the correction, or the network's own force; wheel forces are the nominal ones.

        Where a step of the network is not finite, its last force holds, and the estimate is stale until the next sound step.

        Raises:
            RuntimeError: nothing has been observed since the last reset.
            SampleError: the first step of the network is not finite.
        """
        nominal = self._nominal.estimate()
        if self._inputs is None:
            raise RuntimeError("no tick observed since the last reset; call observe before estimate")
        tick = self._inputs.tick
        if self._network_due(tick):
            self._step(signals_at(self._inputs, self._nominal, nominal))
            self._step_tick = tick
        self._asked_tick = tick
        force = nominal.force_estimated_n + self._force if self._corrects else self._force.copy()
        return ForceEstimate(
            force,
            nominal.wheel_forces_in_heading,
            self._sigma,
            mass_scale=nominal.mass_scale if self._corrects else None,
            mass_scales=nominal.mass_scales if self._corrects else None,
            mass_adapting=nominal.mass_adapting and self._corrects,
            stale=nominal.stale or self._held,
        )

    def _step(self, signals: np.ndarray) -> None:
        try:
            self._force, self._sigma = self._network.step(signals)
            self._held = False
        except SampleError:
            if self._step_tick is None:
                raise
            self._held = True

    def _network_due(self, tick: int) -> bool:
        """Where every tick asks, the network steps in its slot of the timetable; where few do, at those."""
        if self._step_tick is None:
            return True
        elapsed = tick - self._step_tick
        if tick - self._asked_tick > 1:
            return elapsed >= self._ticks_per_step
        # Half a step: after the first tick, or after one that few asked, the slot may come early, but not at once.
        return due(Job.NETWORK_STEP, tick) and 2 * elapsed > self._ticks_per_step
