"""A trained baseline as a controller: history -> network -> joint targets, at 50 Hz, with an estimate of its own."""

from pathlib import Path

import numpy as np

from control.baselines.baseline_weights import METHODS, BaselineManifest, available_baselines, load_baseline, read_baseline
from control.baselines.history import History
from control.baselines.method import OBSERVED, Network, force_estimate
from control.joints import JOINT_COUNT
from control.policy.action import ActionMap
from control.policy.observation import advance_phase
from control.robot_model import RobotModel
from control.whole_body.controller import Controller, ControllerInput
from control.whole_body.task_memory import TASK_MEMORY
from control.whole_body.task_signals import task_signals


class BaselineController:
    """Runs a baseline's network; implements `Controller`. The estimate of the pipeline is not looked at.

    Attributes:
        manifest: of the weights.
        force_estimated_n: (3,) N, environment on hand, in heading: its own estimate at the last step.
        action: (22,) of the last step.
    """

    STATE = ("_history", "_started", "_phase", "action", "force_estimated_n")

    def __init__(self, manifest: BaselineManifest, network: Network) -> None:
        self.manifest = manifest
        self._method = METHODS[manifest.method]
        self._network = network
        self._map = ActionMap()
        self._history = History(1, self._method.frames, self._method.frame_size)
        self.reset()

    def reset(self) -> None:
        """Forget history, phase and the previous action."""
        self._history.reset()
        self._started = False
        self._phase = np.zeros(1)
        self.action = np.zeros(JOINT_COUNT)
        self.force_estimated_n = np.zeros(3)

    def step(self, inputs: ControllerInput) -> np.ndarray:
        """Joint targets (22,), see `Controller.step`."""
        signals = task_signals(inputs)
        if not self._started:
            self.action = self._map.held_actions(signals)[0]
            self._started = True
        observed = OBSERVED.assemble(signals, _NO_MEMORY, self.action[None], self._phase)
        self._history.push(self._method.frame(observed))
        action, estimates = self._network(self._history.flat[0])
        actions = self._map.limited(action.astype(float)[None])
        self.action = actions[0]
        self.force_estimated_n = force_estimate(self._method.targets, estimates)
        self._phase = advance_phase(self._phase)
        return self._map.targets(actions)[0]


def make_baseline(directory: Path, name: str, _model: RobotModel) -> BaselineController:
    """The baseline `name` of `directory`, whatever it scored.

    Raises:
        PolicyWeightsError: the weights do not fit.
    """
    return BaselineController(*load_baseline(name, directory))


def make_baselines(directory: Path | None) -> dict[str, Controller]:
    """The baselines of `directory` that stand, by name; none without a directory.

    Raises:
        PolicyWeightsError: weights exist but do not fit.
    """
    if directory is None:
        return {}
    names = [name for name in available_baselines(directory) if read_baseline(directory / f"{name}.json").stands]
    return {name: BaselineController(*load_baseline(name, directory)) for name in names}


_NO_MEMORY = np.zeros(1, TASK_MEMORY)
"""The paper's form, of which frames are made, looks at none."""
