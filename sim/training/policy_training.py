"""One training run of the policy (sim.training.training_run): its networks, its world, and what it is compared with."""

import logging
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import torch

from control.joints import JOINT_COUNT
from control.learning.policy.actor_critic import HIDDEN, ActorCritic
from control.learning.policy.ppo import Ppo, PpoConfig
from control.policy.observation import Observation
from control.policy.policy_controller import make_policy
from control.policy.policy_weights import PolicyManifest, interface, save_policy
from control.provenance import commit
from sim.training.env import PRIVILEGED_SIZE, TrainingEnv, TrainingEnvConfig
from sim.training.training_run import PolicyTrainingConfig, RunError, TrainingRun, rounded
from sim.trials.policy_score import Score, score_controller

logger = logging.getLogger("train_policy")

FROM_SCRATCH = PpoConfig(actor_rate=1e-3, epochs=5, minibatches=4, target_kl=0.012, entropy=0.002, critic_only=0)


def make_learner(config: PolicyTrainingConfig) -> Ppo:
    """Network and learner that a run starts with; draws from torch's random numbers."""
    std = config.residual_std if config.corrects else config.scratch_std if config.from_scratch else config.warm_std
    network = ActorCritic(Observation(config.form).size, PRIVILEGED_SIZE, JOINT_COUNT, std, config.bfloat16)
    if not config.corrects:
        return Ppo(network, FROM_SCRATCH if config.from_scratch else config.ppo)
    # The first policy is the model-based controller itself.
    torch.nn.init.zeros_(network.actor_head.weight)
    ppo = replace(
        config.ppo,
        mean_penalty=config.correction_penalty,
        noise_memory=config.noise_memory,
        parts=config.correction_parts,
        head_weights=config.correction_weights,
    )
    return Ppo(network, ppo)


class PolicyTraining(TrainingRun):
    """See TrainingRun."""

    def __init__(self, run: Path, config: PolicyTrainingConfig) -> None:
        """
        Raises:
            RunError: `run` holds a checkpoint of another training.
            SurrogateError: the estimator surrogate has not been fitted.
        """
        self._reference: Score | None = None
        super().__init__(run, config)

    @property
    def reference(self) -> Score:
        """Score of the model-based controller on the same trials."""
        if self._reference is None:
            self._reference = self._score_reference(self.config.score_seed)
            logger.info("model_based scores %.3f: %s", self._reference.total, rounded(self._reference.parts))
        return self._reference

    def export(self, directory: Path, command: str) -> PolicyManifest:
        """Write the best checkpoint's weights with their manifest, judged on trials that did not choose it."""
        if self.best is None:
            raise RunError(f"{self.run} has no scored checkpoint; run fit() first")
        config = self.config
        manifest, arrays = self._candidate(self.best["parameters"])
        score = self._score_candidate(manifest, arrays, config.verification_seed)
        reference = self._score_reference(config.verification_seed)
        training = {
            "command": command,
            "commit": commit(),
            "seed": config.seed,
            "steps": self.best["steps"],
            "config": asdict(config),
        }
        metrics = {"score": asdict(score), "model_based_score": asdict(reference), "selection_score": self.best["score"]}
        manifest = replace(manifest, meets_score=score.total <= reference.total, training=training, metrics=metrics)
        path = save_policy(directory, manifest, arrays)
        logger.info("wrote %s: score %.3f, model_based %.3f", path, score.total, reference.total)
        return manifest

    def _compared_with(self) -> float | None:
        return self.reference.total

    def _learner(self) -> Ppo:
        return make_learner(self.config)

    def _environment(self, seed: int) -> TrainingEnv:
        config = self.config
        return TrainingEnv(TrainingEnvConfig(count=config.count, threads=config.threads, seed=seed, form=config.form))

    def _judge(self, parameters: dict[str, torch.Tensor], seed: int) -> Score:
        return self._score_candidate(*self._candidate(parameters), seed)

    def _score_candidate(self, manifest: PolicyManifest, arrays: dict[str, Any], seed: int) -> Score:
        save_policy(self.run, manifest, arrays)
        make = partial(make_policy, self.run, manifest.name)
        return score_controller(manifest.name, make, seed, self.config.score_minutes, self.config.threads)

    def _score_reference(self, seed: int) -> Score:
        return score_controller("model_based", None, seed, self.config.score_minutes, self.config.threads)

    def _candidate(self, parameters: dict[str, torch.Tensor]) -> tuple[PolicyManifest, dict[str, Any]]:
        config, arrays = self.config, {}
        names = [f"actor_trunk.{2 * index}" for index in range(len(HIDDEN))] + ["actor_head"]
        for index, name in enumerate(names):
            arrays[f"weight_{index}"] = parameters[f"{name}.weight"].numpy()
            arrays[f"bias_{index}"] = parameters[f"{name}.bias"].numpy()
        layers = (Observation(config.form).size, *HIDDEN, JOINT_COUNT)
        return PolicyManifest(config.name, config.form, interface(config.form), layers), arrays

    @property
    def _interface(self) -> dict[str, Any]:
        return interface(self.config.form)
