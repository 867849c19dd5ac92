"""One training run of the policy: imitation of the teacher, then PPO; checkpoints scored on the full stack, the best kept."""

import json
import logging
import time
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import torch

from control.files import replacing, write_whole
from control.joints import JOINT_COUNT
from control.learning.policy.actor_critic import CRITIC_HIDDEN, HIDDEN, ActorCritic
from control.learning.policy.curves import save_policy_curves
from control.learning.policy.dagger import DaggerConfig, imitate
from control.learning.policy.event_log import EventLog
from control.learning.policy.ppo import Ppo, PpoConfig
from control.policy.observation import RESIDUAL_FORM, Observation
from control.policy.policy_controller import make_policy
from control.policy.policy_weights import PolicyManifest, interface, save_policy
from control.provenance import commit
from sim.training.env import PRIVILEGED_SIZE, TrainingEnv, TrainingEnvConfig
from sim.trials.policy_score import Score, score_controller

logger = logging.getLogger("train_policy")

SCHEMA = 3
_FROM_SCRATCH = PpoConfig(actor_rate=1e-3, epochs=5, minibatches=4, target_kl=0.012, entropy=0.002, critic_only=0)


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
    bfloat16: compute hidden layers in bfloat16; pays on CPUs with such instructions.
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
    bfloat16: bool = True
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


def make_learner(config: PolicyTrainingConfig) -> Ppo:
    """Network and learner that a run starts with; draws from torch's random numbers."""
    std = config.residual_std if config.corrects else config.scratch_std if config.from_scratch else config.warm_std
    network = ActorCritic(Observation(config.form).size, PRIVILEGED_SIZE, JOINT_COUNT, std, config.bfloat16)
    if not config.corrects:
        return Ppo(network, _FROM_SCRATCH if config.from_scratch else config.ppo)
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


class RunError(RuntimeError):
    """A run folder belongs to another training."""


class PolicyTraining:
    """Network, learner, environment and log of one run; continues from the checkpoint in its folder."""

    def __init__(self, run: Path, config: PolicyTrainingConfig) -> None:
        """
        Raises:
            RunError: `run` holds a checkpoint of another training.
            SurrogateError: the estimator surrogate has not been fitted.
        """
        torch.manual_seed(config.seed)
        torch.set_num_threads(config.threads)
        self.run, self.config = run, config
        self.learner = make_learner(config)
        self.network = self.learner.network
        self.averaged = self._parameters()
        self.imitated = config.from_scratch or config.corrects
        self.steps = 0
        self.history: dict[str, list[dict[str, Any]]] = {"imitation": [], "ppo": [], "score": []}
        self.best: dict[str, Any] | None = None
        self._resume()
        # What has been learned is kept; the robots start anew, under commands not seen before.
        self.env = TrainingEnv(
            TrainingEnvConfig(
                count=config.count, threads=config.threads, seed=config.seed + self.learner.iteration, form=config.form
            )
        )
        self._events = EventLog(run / "events", self.steps)
        self._reference: Score | None = None

    @property
    def reference(self) -> Score:
        """Score of the model-based controller on the same trials."""
        if self._reference is None:
            self._reference = self._score_reference(self.config.score_seed)
            logger.info("model_based scores %.3f: %s", self._reference.total, _rounded(self._reference.parts))
        return self._reference

    def fit(self) -> None:
        """Run what is left of the training."""
        config = self.config
        if not self.imitated:
            dagger = replace(config.dagger, steps=config.imitation_steps)
            imitate(self.env, self.network, dagger, self._log_imitation)
            self.steps = config.imitation_steps * config.count
            self.imitated = True
            self.averaged = self._parameters()
            self._score()
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

    def _score_candidate(self, manifest: PolicyManifest, arrays: dict[str, Any], seed: int) -> Score:
        save_policy(self.run, manifest, arrays)
        make = partial(make_policy, self.run, manifest.name)
        return score_controller(manifest.name, make, seed, self.config.score_minutes, self.config.threads)

    def _score_reference(self, seed: int) -> Score:
        return score_controller("model_based", None, seed, self.config.score_minutes, self.config.threads)

    def _score(self) -> None:
        parameters = {name: tensor.clone() for name, tensor in self.averaged.items()}
        score = self._score_candidate(*self._candidate(parameters), self.config.score_seed)
        self.history["score"].append({"steps": self.steps, **asdict(score)})
        self._events.add(self.steps, {"score/total": score.total, "score/falls": score.falls})
        self._events.add(self.steps, {f"score/{name}": value for name, value in score.parts.items()})
        parts = _rounded(score.parts)
        logger.info("score %.3f after %.2f M steps: %s, falls %d", score.total, self.steps / 1e6, parts, score.falls)
        if self.best is None or score.total < self.best["score"]["total"]:
            self.best = {"score": asdict(score), "steps": self.steps, "parameters": parameters}
        self._save_checkpoint()
        save_policy_curves(self.run / "curves.png", self.config.name, self.history, self.reference.total)

    def _parameters(self) -> dict[str, torch.Tensor]:
        return {name: tensor.detach().clone() for name, tensor in self.network.state_dict().items()}

    def _candidate(self, parameters: dict[str, torch.Tensor]) -> tuple[PolicyManifest, dict[str, Any]]:
        config, arrays = self.config, {}
        names = [f"actor_trunk.{2 * index}" for index in range(len(HIDDEN))] + ["actor_head"]
        for index, name in enumerate(names):
            arrays[f"weight_{index}"] = parameters[f"{name}.weight"].numpy()
            arrays[f"bias_{index}"] = parameters[f"{name}.bias"].numpy()
        layers = (Observation(config.form).size, *HIDDEN, JOINT_COUNT)
        return PolicyManifest(config.name, config.form, interface(config.form), layers), arrays

    def _log_imitation(self, step: int, loss: float) -> None:
        self.history["imitation"].append({"steps": step * self.config.count, "loss": loss})
        self._events.add(step * self.config.count, {"loss/imitation": loss})
        if step % 250 == 0:
            logger.info("imitation step %d/%d: loss %.5f", step, self.config.imitation_steps, loss)

    @property
    def _identity(self) -> dict[str, Any]:
        """What must be the same for a checkpoint to be continued."""
        layers = {"hidden": list(HIDDEN), "critic_hidden": list(CRITIC_HIDDEN)}
        return {"schema": SCHEMA, "seed": self.config.seed, "interface": interface(self.config.form), **layers}

    def _save_checkpoint(self) -> None:
        state = {
            "identity": self._identity,
            "network": self.network.state_dict(),
            "averaged": self.averaged,
            "learner": self.learner.state(),
            "imitated": self.imitated,
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
        self.imitated, self.steps = state["imitated"], state["steps"]
        self.history, self.best = state["history"], state["best"]
        torch.set_rng_state(state["generator"])
        logger.info("resumed after %.2f M steps of %s", self.steps / 1e6, path)


def _rounded(parts: dict[str, float]) -> dict[str, float]:
    return {name: round(value, 3) for name, value in parts.items()}
