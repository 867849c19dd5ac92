"""The learned whole-body policy as a controller: observation -> actor -> joint targets, at 50 Hz.

A policy of the residual form adds a bounded correction to the targets of the model-based controller, which it runs inside:
in joints for the legs, in the references of base and hand for wheels and arm.
"""

from pathlib import Path

import numpy as np

from control.joints import DAMPING, NOMINAL_POSITION, STIFFNESS, WHEEL_SLICE
from control.policy.action import ActionScales
from control.policy.actor import Actor
from control.policy.observation import RESIDUAL_FORM, Observation, advance_phase, task_signals
from control.policy.policy_weights import PolicyManifest, available_policies, load_policy
from control.policy.task_memory import TaskMemory, TaskMemoryConfig, TaskSignals
from control.robot_model import RobotModel
from control.whole_body.controller import Controller, ControllerInput
from control.whole_body.model_based import ModelBasedController


class PolicyController:
    """Runs an actor; implements `Controller`.

    Attributes:
        manifest: of the weights.
        observation: (o,) float32 of the last step; zeros before. `observation_groups` says what lies where.
        action: (22,) of the last step; with the residual form, the corrected one.
    """

    def __init__(self, manifest: PolicyManifest, actor: Actor, model: RobotModel) -> None:
        self.manifest = manifest
        self._actor = actor
        self._form = Observation(manifest.form)
        self._memory = TaskMemory(TaskMemoryConfig())
        self._corrected = ModelBasedController(model) if manifest.form == RESIDUAL_FORM else None
        scales = ActionScales()
        self._scales, self._scale, self._limit = scales, scales.per_joint(), scales.limit
        self._nominal = NOMINAL_POSITION.copy()
        self._nominal[WHEEL_SLICE] = 0.0
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
        self.action = np.zeros(len(self._scale))

    def step(self, inputs: ControllerInput) -> np.ndarray:
        """Joint targets (22,), see `Controller.step`."""
        signals = task_signals(inputs)
        if not self._started:
            self.action = self._held_action(signals)
            self._started = True
        self._memory.step(signals)
        self.observation = self._form.assemble(signals, self._memory, self.action, self._phase)
        action = self._actor(self.observation).astype(float)
        if self._corrected is not None:
            added = np.clip(action, -self._scales.correction_limit, self._scales.correction_limit)
            targets = self._corrected.step(inputs, self._scales.reference_correction(added))
            action = (targets - self._nominal) / self._scale + self._scales.joint_correction(added)
        self.action = np.clip(action, -self._limit, self._limit)
        self._phase = advance_phase(self._phase)
        return self._nominal + self._scale * self.action

    def _held_action(self, signals: TaskSignals) -> np.ndarray:
        """The action that keeps the present torques: what the previous one was, whoever gave it."""
        q, dq, torque = signals.joint_position, signals.joint_velocity, signals.joint_torque
        on_velocity = STIFFNESS == 0.0
        stiffness = np.where(on_velocity, 1.0, STIFFNESS)
        target = np.where(on_velocity, dq + torque / DAMPING, q + (torque + DAMPING * dq) / stiffness)
        return np.clip((target - self._nominal) / self._scale, -self._limit, self._limit)


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
