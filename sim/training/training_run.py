"""One training run: imitation of the teacher, then PPO; checkpoints scored on the full stack, the best kept.

What is trained is a kind of its own: the policy (sim.training.policy_training) or a baseline (sim.training.baselines.training).
"""

import json
import logging
import time
from abc import ABC, abstractmethod
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import torch

from control.files import replacing, write_whole
from control.learning.policy.actor_critic import CRITIC_HIDDEN, HIDDEN, bfloat16_pays
from control.learning.policy.curves import save_policy_curves
from control.learning.policy.dagger import DaggerConfig, Samples, imitate
from control.learning.policy.event_log import EventLog
from control.learning.policy.ppo import Ppo, PpoConfig
from control.policy.observation import RESIDUAL_FORM
from sim.training.env import TrainingEnv
from sim.trials.policy_score import Score

logger = logging.getLogger("train_policy")

SCHEMA = 4


@dataclass(frozen=True, slots=True)
class PolicyTrainingConfig:
    """Attributes:
    name: of the weights.
    form: of the observation.
    seed: of initialisation, environment and noise.
    count, threads: robots; CPU threads of physics and networks, and trials of a score at a time.
    imitation_steps: environment steps of DAgger; 0 to learn from scratch. The residual form has nothing to imitate.
    ppo_iterations: after it.
    score_every: iterations between two scores.
    score_seed, score_minutes: trials of the score; never those of a benchmark.
    verification_seed: of the trials that the chosen checkpoint is judged by, which had no part in choosing it.
    warm_std, scratch_std, residual_std: action noise after imitation, without it, and of corrections: per action, as much as
        disturbs about as much as there is to gain. With larger action
        noise the policy learns to tolerate noise instead of acting precisely.
    correction_penalty, noise_memory: PpoConfig.mean_penalty and noise_memory of the residual form.
    correction_parts, correction_weights: its PpoConfig.parts and head_weights: legs and wheels are judged by locomotion first,
        the arm by the hand.
    averaging: share of the old average that an iteration leaves in the network that is scored, which is the running average of
        those that learn: what a gradient's noise adds to one iteration's network averages out.
    bfloat16: compute hidden layers in bfloat16; by default where this machine is faster so.
    """

    name: str = "policy"
    form: str = RESIDUAL_FORM
    seed: int = 0
    count: int = 512
    threads: int = 1
    imitation_steps: int = 3000
    ppo_iterations: int = 400
    score_every: int = 200
    score_seed: int = 7000
    score_minutes: float = 2.0
    verification_seed: int = 7500
    warm_std: float = 0.1
    scratch_std: float = 0.6
    residual_std: tuple[float, ...] = (0.03,) * 12 + (0.1, 0.3, 0.1, 0.1) + (0.1,) * 6
    correction_penalty: tuple[float, ...] = (0.03, 0.003, 0.001)
    noise_memory: float = 0.6
    correction_parts: tuple[int, ...] = (12, 4, 6)
    correction_weights: tuple[tuple[float, ...], ...] = ((1.5, 0.7), (1.5, 0.7), (0.3, 1.0))
    averaging: float = 0.98
    bfloat16: bool = field(default_factory=bfloat16_pays)
    dagger: DaggerConfig = field(default_factory=DaggerConfig)
    ppo: PpoConfig = field(default_factory=PpoConfig)

    @property
    def corrects(self) -> bool:
        """The policy corrects the model-based controller."""
        return self.form == RESIDUAL_FORM

    @property
    def from_scratch(self) -> bool:
        """There is nothing that PPO starts from."""
        return self.imitation_steps == 0 and not self.corrects


class RunError(RuntimeError):
    """A run folder belongs to another training."""


class TrainingRun(ABC):
    """Network, learner, environment and log of one run, continued from the checkpoint in its folder; subclasses say of what."""

    def __init__(self, run: Path, config: PolicyTrainingConfig) -> None:
        """
        Raises:
            RunError: `run` holds a checkpoint of another training.
            SurrogateError: the estimator surrogate has not been fitted.
        """
        torch.manual_seed(config.seed)
        torch.set_num_threads(config.threads)
        self.run, self.config = run, config
        self.learner = self._learner()
        self.network = self.learner.network
        self.averaged = self._parameters()
        self.imitated = config.from_scratch or config.corrects
        self.imitation_step = 0
        self.steps = 0
        self.history: dict[str, list[dict[str, Any]]] = {"imitation": [], "ppo": [], "score": []}
        self.best: dict[str, Any] | None = None
        self._resume()
        # What has been learned is kept; the robots start anew, under commands not seen before.
        self.env = self._environment(config.seed + self.learner.iteration + self.imitation_step)
        self._events = EventLog(run / "events", self.steps)

    def fit(self) -> None:
        """Run what is left of the training."""
        self.imitate()
        self.improve()

    def imitate(self) -> None:
        """Run what is left of the imitation, and score what it has led to."""
        config = self.config
        if not self.imitated:
            dagger = replace(config.dagger, steps=config.imitation_steps)
            imitate(self.env, self.network, dagger, self._log_imitation, self._samples(), self.imitation_step)
            self.steps = config.imitation_steps * config.count
            self.imitated = True
            self.averaged = self._parameters()
            self._score()

    def improve(self) -> None:
        """Run what is left of PPO."""
        config = self.config
        started, steps_then = time.perf_counter(), self.steps
        while self.learner.iteration < config.ppo_iterations:
            statistics = self.learner.iterate(self.env)
            for name, tensor in self.network.state_dict().items():
                self.averaged[name].lerp_(tensor, 1.0 - config.averaging)
            self.steps += config.count * self.learner.config.horizon
            self.history["ppo"].append({"steps": self.steps, **asdict(statistics)})
            locomotion, end_effector = statistics.reward
            self._events.add(
                self.steps,
                {
                    "reward/locomotion": locomotion,
                    "reward/end_effector": end_effector,
                    "loss/value": statistics.value_loss,
                    "policy/kl": statistics.kl,
                    "policy/std": statistics.std,
                    "policy/rate": statistics.actor_rate,
                },
            )
            if self.learner.iteration % 10 == 0:
                rate = (self.steps - steps_then) / (time.perf_counter() - started)
                logger.info(
                    "iteration %d, %.2f M steps, %.0f steps/s: reward %s, kl %.4f, rate %.1e, std %.3f, value loss %.4f",
                    self.learner.iteration,
                    self.steps / 1e6,
                    rate,
                    [round(value, 4) for value in statistics.reward],
                    statistics.kl,
                    statistics.actor_rate,
                    statistics.std,
                    statistics.value_loss,
                )
                self._save_checkpoint()
            if self.learner.iteration % config.score_every == 0:
                self._score()
        if not self.history["score"] or self.history["score"][-1]["steps"] != self.steps:
            self._score()

    @abstractmethod
    def _learner(self) -> Ppo:
        """Network and learner to start with; draws from torch's random numbers."""

    @abstractmethod
    def _environment(self, seed: int) -> TrainingEnv:
        """The training world, drawn from a seed."""

    @property
    @abstractmethod
    def _interface(self) -> dict[str, Any]:
        """What the network depends on, as plain JSON values."""

    @abstractmethod
    def _judge(self, parameters: dict[str, torch.Tensor], seed: int) -> Score:
        """Score of a network with these parameters, on trials of `seed`."""

    def _compared_with(self) -> float | None:
        """Score that the curves show beside their own."""
        return None

    def _samples(self) -> Samples | None:
        """What imitation collects in; None for its own."""
        return None

    def _score(self) -> None:
        parameters = {name: tensor.clone() for name, tensor in self.averaged.items()}
        score = self._judge(parameters, self.config.score_seed)
        self.history["score"].append({"steps": self.steps, **asdict(score)})
        self._events.add(self.steps, {"score/total": score.total, "score/falls": score.falls})
        self._events.add(self.steps, {f"score/{name}": value for name, value in score.parts.items()})
        parts = rounded(score.parts)
        logger.info("score %.3f after %.2f M steps: %s, falls %d", score.total, self.steps / 1e6, parts, score.falls)
        if self.best is None or score.total < self.best["score"]["total"]:
            self.best = {"score": asdict(score), "steps": self.steps, "parameters": parameters}
        self._save_checkpoint()
        save_policy_curves(self.run / "curves.png", self.config.name, self.history, self._compared_with())

    def _parameters(self) -> dict[str, torch.Tensor]:
        return {name: tensor.detach().clone() for name, tensor in self.network.state_dict().items()}

    def _log_imitation(self, step: int, loss: float) -> None:
        self.history["imitation"].append({"steps": step * self.config.count, "loss": loss})
        self._events.add(step * self.config.count, {"loss/imitation": loss})
        if step % 100 == 0:
            logger.info("imitation step %d/%d: loss %.5f", step, self.config.imitation_steps, loss)
            self.imitation_step, self.averaged = step, self._parameters()
            self._save_checkpoint()

    @property
    def _identity(self) -> dict[str, Any]:
        """What must be the same for a checkpoint to be continued."""
        layers = {"hidden": list(HIDDEN), "critic_hidden": list(CRITIC_HIDDEN)}
        return {"schema": SCHEMA, "seed": self.config.seed, "interface": self._interface, **layers}

    def _save_checkpoint(self) -> None:
        state = {
            "identity": self._identity,
            "network": self.network.state_dict(),
            "averaged": self.averaged,
            "learner": self.learner.state(),
            "imitated": self.imitated,
            "imitation_step": self.imitation_step,
            "steps": self.steps,
            "history": self.history,
            "best": self.best,
            "generator": torch.get_rng_state(),
        }
        with replacing(self.run / "checkpoint.pt") as file:
            torch.save(state, file)
        write_whole(self.run / "history.json", json.dumps(self.history) + "\n")

    def _resume(self) -> None:
        path = self.run / "checkpoint.pt"
        if not path.is_file():
            return
        state = torch.load(path, weights_only=True)
        if state["identity"] != self._identity:
            raise RunError(f"{path} belongs to another training; choose another --run or delete it")
        self.network.load_state_dict(state["network"])
        self.averaged = state["averaged"]
        self.learner.restore(state["learner"])
        self.imitated, self.imitation_step, self.steps = state["imitated"], state["imitation_step"], state["steps"]
        self.history, self.best = state["history"], state["best"]
        torch.set_rng_state(state["generator"])
        logger.info("resumed after %.2f M steps of %s", self.steps / 1e6, path)


def rounded(parts: dict[str, float]) -> dict[str, float]:
    """For the log."""
    return {name: round(value, 3) for name, value in parts.items()}
