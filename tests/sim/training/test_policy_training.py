"""A training run in miniature: it learns, is cut off and continues, keeps its best checkpoint and exports what loads."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from control.learning.policy.dagger import DaggerConfig
from control.learning.policy.ppo import PpoConfig
from control.policy.observation import EXTENDED_FORM, RESIDUAL_FORM
from control.policy.policy_weights import load_policy
from sim.training import policy_training
from sim.training.policy_training import PolicyTraining
from sim.training.training_run import PolicyTrainingConfig, RunError
from sim.trials.policy_score import Score

TINY = PolicyTrainingConfig(
    form=EXTENDED_FORM,
    count=8,
    imitation_steps=20,
    ppo_iterations=2,
    score_every=1,
    bfloat16=False,
    dagger=DaggerConfig(teacher_steps=5, batch=32, updates=1),
    ppo=PpoConfig(horizon=2, epochs=1, minibatches=1, critic_only=1),
)


@pytest.fixture
def scores(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[str]]:
    """Scores 3, 1, 2, ... for successive checkpoints, 1.5 for the model-based controller; lists what was scored.

    The judgement on other trials gives the policy 1.2.
    """
    asked: list[str] = []
    totals = iter([3.0, 1.0, 2.0, 4.0, 5.0])

    def score(name: str, make: object, seed: int, minutes: float, workers: int) -> Score:
        asked.append(name)
        if seed == TINY.verification_seed:
            return Score(1.5 if name == "model_based" else 1.2, {"yaw_rps": 0.1}, 0)
        return Score(1.5 if name == "model_based" else next(totals), {"yaw_rps": 0.1}, 0)

    monkeypatch.setattr(policy_training, "score_controller", score)
    yield asked
    torch.set_num_threads(1)


def test_run_keeps_and_exports_its_best_checkpoint(tmp_path: Path, scores: list[str]):
    training = PolicyTraining(tmp_path / "run", TINY)
    training.fit()
    assert scores.count("policy") == 3
    manifest = training.export(tmp_path / "out", "command")
    assert manifest.metrics["selection_score"]["total"] == 1.0
    assert manifest.metrics["score"]["total"] == 1.2
    assert manifest.meets_score
    loaded, _ = load_policy("policy", tmp_path / "out")
    assert loaded.training["steps"] == (20 + 2) * 8
    assert (tmp_path / "run" / "curves.png").is_file()


@pytest.mark.slow
def test_what_is_scored_is_the_running_average_of_what_learned(tmp_path: Path, scores: list[str]):
    training = PolicyTraining(tmp_path, replace(TINY, ppo_iterations=0, averaging=0.75))
    training.fit()
    expected = {name: tensor.clone() for name, tensor in training.network.state_dict().items()}
    assert all(torch.equal(expected[name], tensor) for name, tensor in training.averaged.items())
    for iterations in (1, 2, 3):
        training.config = replace(training.config, ppo_iterations=iterations)
        training.fit()
        for name, tensor in training.network.state_dict().items():
            expected[name] = 0.75 * expected[name] + 0.25 * tensor
    assert not torch.equal(expected["actor_head.weight"], training.network.state_dict()["actor_head.weight"])
    for name, tensor in training.averaged.items():
        torch.testing.assert_close(tensor, expected[name])
    again = PolicyTraining(tmp_path, training.config)
    assert all(torch.equal(tensor, again.averaged[name]) for name, tensor in training.averaged.items())


@pytest.mark.slow
def test_run_continues_where_it_was_cut_off(tmp_path: Path, scores: list[str]):
    first = PolicyTraining(tmp_path, replace(TINY, ppo_iterations=1))
    first.fit()
    second = PolicyTraining(tmp_path, TINY)
    assert (second.imitated, second.learner.iteration, second.steps) == (True, 1, first.steps)
    second.fit()
    assert second.learner.iteration == 2
    assert len(second.history["score"]) == 3


def test_checkpoint_of_another_training_is_refused(tmp_path: Path, scores: list[str]):
    PolicyTraining(tmp_path, replace(TINY, ppo_iterations=0)).fit()
    with pytest.raises(RunError, match="another training"):
        PolicyTraining(tmp_path, replace(TINY, seed=5))


def test_a_policy_below_the_reference_does_not_meet_the_score(
    tmp_path: Path, scores: list[str], monkeypatch: pytest.MonkeyPatch
):
    training = PolicyTraining(tmp_path / "run", replace(TINY, ppo_iterations=0))
    training.fit()
    judged = {"policy": Score(1.6, {}, 0), "model_based": Score(1.5, {}, 0)}
    monkeypatch.setattr(policy_training, "score_controller", lambda name, *_: judged[name])
    assert not training.export(tmp_path / "out", "command").meets_score


def test_residual_training_starts_as_the_model_based_controller(tmp_path: Path, scores: list[str]):
    training = PolicyTraining(tmp_path, replace(TINY, form=RESIDUAL_FORM, ppo_iterations=0))
    assert not training.network.mean(torch.from_numpy(training.env.observation)).any()
    training.fit()
    assert training.history["imitation"] == []
