"""The learned whole-body policy as a controller: observation -> actor -> joint targets, at 50 Hz.

A policy of the residual form adds a bounded correction to the targets of the model-based controller, which it runs inside:
in joints for the legs, in the references of base and hand for wheels and arm.
"""

from pathlib import Path

import numpy as np

from control.joints import JOINT_COUNT
from control.policy.action import ActionMap
from control.policy.actor import Actor
from control.policy.observation import RESIDUAL_FORM, Observation, advance_phase
from control.policy.policy_weights import PolicyManifest, available_policies, load_policy
from control.robot_model import RobotModel
from control.whole_body.body_terms import body_terms
from control.whole_body.controller import Controller, ControllerInput
from control.whole_body.model_based import ModelBasedConfig, ModelBasedLaw
from control.whole_body.task_memory import TaskMemory, TaskMemoryConfig
from control.whole_body.task_signals import task_signals


class PolicyController:
    """Runs an actor; implements `Controller`.

    Attributes:
        manifest: of the weights.
        observation: (o,) float32 of the last step; zeros before. `observation_groups` says what lies where.
        action: (22,) of the last step; with the residual form, the corrected one.
    """

    STATE = ("_memory", "_corrected", "_started", "_phase", "observation", "action")
    SCRATCH = ("_form", "_map", "_actor")

    def __init__(self, manifest: PolicyManifest, actor: Actor, model: RobotModel) -> None:
        self.manifest = manifest
        self._actor = actor
        self._form = Observation(manifest.form)
        self._memory = TaskMemory(TaskMemoryConfig())
        self._corrected = ModelBasedLaw(model, ModelBasedConfig()) if manifest.form == RESIDUAL_FORM else None
        self._map = ActionMap()
        self.reset()

    @property
    def observation_groups(self) -> dict[str, slice]:
        """Parts of the observation by name."""
        return self._form.groups

    def reset(self) -> None:
        """Forget integrals, phase and the previous action."""
        self._memory.reset()
        if self._corrected is not None:
            self._corrected.reset()
        self._started = False
        self._phase = np.zeros(1)
        self.observation = np.zeros(self._form.size, np.float32)
        self.action = np.zeros(JOINT_COUNT)

    def step(self, inputs: ControllerInput) -> np.ndarray:
        """Joint targets (22,), see `Controller.step`."""
        signals = task_signals(inputs)
        if not self._started:
            self.action = self._map.held_actions(signals)[0]
            self._started = True
        self._memory.step(signals)
        self.observation = self._form.assemble(signals, self._memory.values, self.action[None], self._phase)[0]
        actions = self._actor(self.observation).astype(float)[None]
        if self._corrected is None:
            actions = self._map.limited(actions)
        else:
            corrections = self._map.reference_corrections(actions)
            targets = self._corrected.targets(body_terms(inputs.model), signals, self._memory.values, corrections)
            actions = self._map.corrected_actions(targets, actions)
        self.action = actions[0]
        self._phase = advance_phase(self._phase)
        return self._map.targets(actions)[0]


def make_policy(directory: Path, name: str, model: RobotModel) -> PolicyController:
    """The policy `name` of `directory`, whether it met the score or not. `model` is the caller's.

    Raises:
        PolicyWeightsError: the weights do not fit.
    """
    return PolicyController(*load_policy(name, directory), model)


def make_policies(directory: Path | None, model: RobotModel) -> dict[str, Controller]:
    """The policies of `directory`, by name, whatever they scored; none without a directory. `model` is the caller's.

    Raises:
        PolicyWeightsError: weights exist but do not fit.
    """
    if directory is None:
        return {}
    policies = (make_policy(directory, name, model) for name in available_policies(directory))
    return {policy.manifest.name: policy for policy in policies}
