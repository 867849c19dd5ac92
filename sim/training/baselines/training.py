"""One training run of a baseline: as the policy's (sim.training.training_run), with the baseline's network and rewards."""

import logging
import shutil
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import torch

from control.baselines.baseline_controller import make_baseline
from control.baselines.baseline_weights import METHODS, RETUNED, BaselineManifest, baseline_interface, save_baseline
from control.files import replacing
from control.learning.baselines.history_ring import HistoryRing
from control.learning.baselines.networks import make_network
from control.learning.baselines.ppo import BaselinePpo
from control.learning.flatness import flattened
from control.provenance import commit
from sim.training.baselines.env import BaselineEnv, BaselineEnvConfig
from sim.training.baselines.rewards import PUBLISHED
from sim.training.baselines.rewards import RETUNED as RETUNED_REWARDS
from sim.training.commands import CommandRanges
from sim.training.env import PRIVILEGED_SIZE, TrainingEnvConfig
from sim.training.policy_training import FROM_SCRATCH
from sim.training.training_run import PolicyTrainingConfig, RunError, TrainingRun
from sim.trials.policy_score import Score, score_controller

logger = logging.getLogger("train_policy")

FORCE_N = 30.0
"""Largest force asked for, as the paper trains the methods that it compares with."""

JUDGED_MINUTES = 2.0
"""A score of fewer minutes has not seen enough to say that a baseline stands."""

CURVE_POINTS = 200
"""At most so many points of a curve go into the manifest."""


class BaselineTraining(TrainingRun):
    """See TrainingRun; `config.form` is the method's name."""

    def __init__(self, run: Path, config: PolicyTrainingConfig, warm_start: Path | None = None) -> None:
        """`warm_start`: checkpoint to begin with where `run` has none: an imitation, which no reward has a part in.

        Raises:
            RunError: `run` holds a checkpoint of another training.
            SurrogateError: the estimator surrogate has not been fitted.
        """
        self._method = METHODS[config.form]
        if warm_start is not None and not (run / "checkpoint.pt").is_file():
            with replacing(run / "checkpoint.pt") as partial_copy:
                shutil.copy2(warm_start, partial_copy)
        # A history tells what its robot weighs; noise that lasts costs portela's hand two centimetres, and gains nothing.
        super().__init__(run, replace(config, dagger=replace(config.dagger, drift=0.0)))

    def imitate(self) -> None:
        """See TrainingRun; what it has led to is kept for other rewards to start from."""
        if not self.imitated:
            super().imitate()
            with replacing(self.imitation) as partial_copy:
                shutil.copy2(self.run / "checkpoint.pt", partial_copy)

    @property
    def imitation(self) -> Path:
        """Checkpoint at the end of the imitation."""
        return self.run / "imitated.pt"

    def export(self, directory: Path, command: str) -> BaselineManifest:
        """Write the best checkpoint's weights with their manifest, judged on trials that did not choose it."""
        if self.best is None:
            raise RunError(f"{self.run} has no scored checkpoint; run fit() first")
        config = self.config
        manifest, arrays = self._candidate(self.best["parameters"])
        score = self._score_candidate(manifest, arrays, config.verification_seed)
        learned = self.history["ppo"][config.ppo.critic_only :]
        curve = self.history["ppo"][:: max(1, len(self.history["ppo"]) // CURVE_POINTS)]
        manifest = replace(
            manifest,
            stands=score.falls == self.best["score"]["falls"] == 0 and config.score_minutes >= JUDGED_MINUTES,
            flattened=flattened([record["reward"][1] for record in learned]),
            training={
                "command": command,
                "commit": commit(),
                "seed": config.seed,
                "imitation_steps": min(self.steps, config.imitation_steps * config.count),
                "ppo_iterations": self.learner.iteration,
                "steps": self.steps,
                "best_at_steps": self.best["steps"],
                "config": asdict(config),
            },
            metrics={"score": asdict(score), "selection_score": self.best["score"]},
            curve={
                "steps": [record["steps"] for record in curve],
                "reward": [round(record["reward"][1], 5) for record in curve],
                "imitation_steps": [record["steps"] for record in self.history["imitation"]],
                "imitation_loss": [round(record["loss"], 5) for record in self.history["imitation"]],
            },
        )
        path = save_baseline(directory, manifest, arrays)
        logger.info("wrote %s: score %.3f, falls %d, %s", path, score.total, score.falls, shape_word(manifest.flattened))
        return manifest

    def _learner(self) -> BaselinePpo:
        config = self.config
        std = config.scratch_std if config.from_scratch else config.warm_std
        network = make_network(config.form, PRIVILEGED_SIZE, std, config.bfloat16)
        return BaselinePpo(network, FROM_SCRATCH if config.from_scratch else config.ppo)

    def _environment(self, seed: int) -> BaselineEnv:
        config = self.config
        commands = CommandRanges(force_n=FORCE_N)
        world = TrainingEnvConfig(count=config.count, threads=config.threads, seed=seed, commands=commands)
        rewards = RETUNED_REWARDS if config.name.endswith(RETUNED) else PUBLISHED
        return BaselineEnv(BaselineEnvConfig(config.form, world, rewards))

    def _samples(self) -> HistoryRing:
        if not isinstance(self.env, BaselineEnv):
            raise TypeError("a baseline is trained in its own environment")
        return HistoryRing(self.env, self._method.frames, self.config.dagger.capacity)

    def _judge(self, parameters: dict[str, torch.Tensor], seed: int) -> Score:
        return self._score_candidate(*self._candidate(parameters), seed)

    def _score_candidate(self, manifest: BaselineManifest, arrays: dict[str, Any], seed: int) -> Score:
        save_baseline(self.run, manifest, arrays)
        make = partial(make_baseline, self.run, manifest.name)
        return score_controller(manifest.name, make, seed, self.config.score_minutes, self.config.threads)

    def _candidate(self, parameters: dict[str, Any]) -> tuple[BaselineManifest, dict[str, Any]]:
        network = make_network(self.config.form, PRIVILEGED_SIZE, self.config.warm_std, self.config.bfloat16)
        network.load_state_dict(parameters)
        return BaselineManifest(self.config.name, self.config.form, baseline_interface(self._method)), network.arrays()

    @property
    def _interface(self) -> dict[str, Any]:
        return baseline_interface(self._method)


def shape_word(has_flattened: bool) -> str:
    """What is said of a learning curve."""
    return "flattened" if has_flattened else "not flattened"
