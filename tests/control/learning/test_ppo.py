"""Advantages, clipping and value loss per head against numbers computed by hand, and PPO and DAgger on toy problems."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from control.learning.policy.actor_critic import TYPICAL_ERROR, VALUE_HEADS, ActorCritic, imitation_error
from control.learning.policy.dagger import DaggerConfig, SampleRing, imitate
from control.learning.policy.ppo import Ppo, PpoConfig, Rollout, advantages, combined_advantage, policy_loss, value_loss


def rollout(rewards, values, dones) -> Rollout:
    """One robot; only what the advantages need."""
    steps = len(rewards)
    nothing = torch.zeros(steps, 1, 1)
    return Rollout(
        observations=nothing,
        privileged=nothing,
        means=nothing,
        actions=nothing,
        log_probabilities=nothing,
        values=torch.tensor(values)[:, None],
        rewards=torch.tensor(rewards)[:, None],
        dones=torch.tensor(dones)[:, None],
        before=nothing[0],
    )


def test_rare_large_errors_of_imitation_pull_no_harder_than_typical_ones():
    actions = torch.tensor([[0.5 * TYPICAL_ERROR], [2.0 * TYPICAL_ERROR], [30.0 * TYPICAL_ERROR]], requires_grad=True)
    loss = imitation_error(actions, torch.zeros(3, 1))
    loss.backward()
    # Half the square over TYPICAL_ERROR within it, beyond it the size less half of it.
    assert torch.isclose(loss, TYPICAL_ERROR * torch.tensor((0.125 + 1.5 + 29.5) / 3.0))
    assert actions.grad is not None
    assert torch.allclose(3.0 * actions.grad[:, 0], torch.tensor([0.5, 1.0, 1.0]))


def test_advantages_of_two_heads_by_hand():
    data = rollout(
        rewards=[[1.0, 0.0], [2.0, 1.0]],
        values=[[0.5, 1.0], [1.0, 2.0], [2.0, 4.0]],
        dones=[0.0, 0.0],
    )
    result = advantages(data, torch.tensor([0.5, 1.0]), trace=0.5)[:, 0]
    # Head 0, discount 0.5: delta_1 = 2 + 0.5*2 - 1 = 2; delta_0 = 1 + 0.5*1 - 0.5 = 1; A_0 = 1 + 0.25*2 = 1.5.
    # Head 1, discount 1: delta_1 = 1 + 4 - 2 = 3; delta_0 = 0 + 2 - 1 = 1; A_0 = 1 + 0.5*3 = 2.5.
    assert torch.allclose(result, torch.tensor([[1.5, 2.5], [2.0, 3.0]]))


def test_the_end_of_an_episode_cuts_both_bootstrap_and_trace():
    data = rollout(
        rewards=[[1.0, 1.0], [5.0, 5.0]],
        values=[[0.5, 0.5], [9.0, 9.0], [9.0, 9.0]],
        dones=[1.0, 0.0],
    )
    first = advantages(data, torch.tensor([0.9, 0.9]), trace=0.9)[0, 0]
    assert torch.allclose(first, torch.tensor([0.5, 0.5]))


def test_combined_advantage_ignores_the_scale_of_a_head():
    per_head = torch.tensor([[1.0, -2.0], [-1.0, 0.0], [0.0, 2.0], [3.0, 1.0]])
    weights = torch.tensor([[1.0, 1.5], [0.0, 1.0]])
    scaled = per_head * torch.tensor([1.0, 1000.0])
    assert torch.allclose(combined_advantage(per_head, weights), combined_advantage(scaled, weights), atol=1e-5)
    assert torch.allclose(combined_advantage(per_head, weights).std(dim=0), torch.ones(2), atol=1e-5)


def test_a_part_follows_its_own_weights():
    per_head = torch.tensor([[1.0, -2.0], [-1.0, 0.0], [0.0, 2.0], [3.0, 1.0]])
    both = combined_advantage(per_head, torch.tensor([[1.0, 0.0], [0.0, 1.0]]))
    assert torch.allclose(both, (per_head - per_head.mean(dim=0)) / per_head.std(dim=0), atol=1e-5)


@pytest.mark.slow
def test_parts_learn_from_the_heads_that_they_are_judged_by():
    """Each head pays for one action; a part that is judged by the other's head alone learns nothing of use."""

    def rewards(weights: tuple[tuple[float, ...], ...]) -> tuple[float, ...]:
        env = Reaching(256)
        config = PpoConfig(critic_only=2, actor_rate=3e-4, parts=(1, 1), head_weights=weights, mean_penalty=(0.0, 0.0))
        learner = Ppo(network(), replace(config, horizon=4))
        statistics = [learner.iterate(env) for _ in range(25)]
        return statistics[-1].reward

    own, swapped = rewards(((1.0, 0.0), (0.0, 1.0))), rewards(((0.0, 1.0), (1.0, 0.0)))
    assert all(mine > 0.8 * other for mine, other in zip(own, swapped, strict=True))
    with pytest.raises(ValueError, match="2 parts"):
        PpoConfig(parts=(1, 1))


@pytest.mark.parametrize(
    ("ratio", "advantage", "expected"),
    [
        (1.1, 2.0, -2.2),  # inside the clip range
        (1.5, 2.0, -2.4),  # gains beyond 1 + clip are not counted
        (0.5, 2.0, -1.0),  # losses are
        (1.5, -2.0, 3.0),
        (0.5, -2.0, 1.6),  # reductions of a bad action's probability below 1 - clip are not counted
    ],
)
def test_clipped_surrogate_by_hand(ratio: float, advantage: float, expected: float):
    loss = policy_loss(torch.log(torch.tensor([[ratio]])), torch.tensor([[advantage]]), clip=0.2)
    assert loss.item() == pytest.approx(expected, rel=1e-5)


def test_value_loss_clips_each_head_by_itself():
    values, old = torch.tensor([[1.0, 1.05]]), torch.tensor([[0.0, 1.0]])
    returns = torch.tensor([[1.0, 2.0]])
    # Head 0 jumped: clipped to 0.2, so (0.2 - 1)^2 stays. Head 1 moved by 0.05: (1.05 - 2)^2.
    assert torch.allclose(value_loss(values, old, returns, clip=0.2), torch.tensor([0.64, 0.9025]))


class Reaching:
    """Toy task: the action should equal a linear function of the observation; one step each, two reward heads."""

    def __init__(self, count: int) -> None:
        self._random = np.random.default_rng(0)
        self._count = count
        self.teacher_calls = 0
        self._next()

    def _next(self) -> None:
        self.observation = self._random.uniform(-1, 1, (self._count, 2)).astype(np.float32)
        self.privileged = np.zeros((self._count, 1), np.float32)

    def teacher_action(self) -> np.ndarray:
        self.teacher_calls += 1
        return self.observation[:, ::-1] * [1.0, -0.5]

    def step(self, action: np.ndarray):
        error = action - self.observation[:, ::-1] * [1.0, -0.5]
        self._next()
        return _Outcome(-(error**2))


class _Outcome:
    def __init__(self, reward: np.ndarray) -> None:
        self.reward = reward
        self.done = np.ones(len(reward), bool)
        self.ended = np.zeros(0, int)
        self.last_observation, self.last_privileged = np.zeros((0, 2), np.float32), np.zeros((0, 1), np.float32)


def network(std: float = 0.3) -> ActorCritic:
    torch.manual_seed(0)
    return ActorCritic(observation=2, privileged=1, actions=2, std=std, bfloat16=False, hidden=(32, 32))


def test_ppo_improves_both_heads():
    env, learner = Reaching(256), Ppo(network(), PpoConfig(horizon=4, critic_only=2, actor_rate=3e-4))
    first = learner.iterate(env)
    last = first
    for _ in range(25):
        last = learner.iterate(env)
    assert len(last.reward) == VALUE_HEADS
    assert all(after > 0.7 * before for after, before in zip(last.reward, first.reward, strict=True))


@pytest.mark.slow
def test_a_penalised_mean_stays_between_zero_and_what_pays():
    def mean_size(penalty: float) -> float:
        env, net = Reaching(256), network()
        learner = Ppo(net, PpoConfig(horizon=4, critic_only=2, actor_rate=3e-4, mean_penalty=(penalty,)))
        for _ in range(25):
            learner.iterate(env)
        return float(net.mean(torch.from_numpy(env.observation)).detach().square().mean())

    free, penalised = mean_size(0.0), mean_size(0.3)
    assert 0.0 < penalised < 0.5 * free


@pytest.mark.parametrize("memory", [0.0, 0.8])
def test_noise_is_as_large_and_as_lasting_as_asked(memory: float):
    net = network(std=0.3)
    data = Ppo(net, PpoConfig(horizon=12, noise_memory=memory)).collect(Reaching(4000))
    noise = (data.actions - net.mean(data.observations)).detach() / 0.3
    assert noise.std().item() == pytest.approx(1.0, abs=0.02)
    assert (noise[1:] * noise[:-1]).mean().item() == pytest.approx(memory, abs=0.03)
    # The likelihood of an action, given the one before, by hand.
    spread = np.sqrt(1.0 - memory**2)
    innovation = (noise[1:] - memory * noise[:-1]) / spread
    expected = -0.5 * innovation.square().sum(dim=-1) - 2.0 * np.log(0.3 * spread * np.sqrt(2.0 * np.pi))
    assert torch.allclose(data.log_probabilities[1:, :, 0], expected.float(), atol=1e-3)


class Drifting:
    """Toy task in which actions add up: where a robot is tells which noise it had. Zero action is best, everywhere."""

    def __init__(self, count: int) -> None:
        self.observation = np.zeros((count, 1), np.float32)
        self.privileged = np.zeros((count, 1), np.float32)

    def step(self, action: np.ndarray) -> "_Outcome":
        self.observation = 0.9 * self.observation + action
        outcome = _Outcome(-(action**2).repeat(2, axis=1))
        outcome.done[:] = False
        return outcome

    def teacher_action(self) -> np.ndarray:
        raise NotImplementedError


def test_gradient_under_noise_that_lasts_is_that_of_the_reward():
    """By the likelihood of the actions it equals the gradient by way of the reward; as if the noise were white it does not."""
    torch.manual_seed(0)
    net = ActorCritic(observation=1, privileged=1, actions=1, std=0.3, bfloat16=False, hidden=(4,))
    torch.nn.init.zeros_(net.actor_head.weight)
    memory = 0.8
    data = Ppo(net, PpoConfig(horizon=40, noise_memory=memory)).collect(Drifting(4000))
    cost, place = data.rewards[..., 0], data.observations

    def slope(assumed: float) -> float:
        gain = torch.zeros(1, requires_grad=True)
        deviations = data.actions - gain * place
        last = torch.cat([data.before[None], deviations[:-1]])
        likelihood = net.log_probability(deviations, last, assumed)[..., 0]
        (likelihood * (cost - cost.mean()))[1:].mean().backward()
        assert gain.grad is not None
        return gain.grad.item()

    # Feedback `gain` of the place moves the action that follows on the last one by gain * (place - memory * last place).
    moved = place[1:] - memory * place[:-1]
    expected = (-2.0 * data.actions[1:] * moved).mean().item()
    assert slope(memory) == pytest.approx(expected, abs=0.1 * abs(expected))
    assert abs(slope(0.0) - expected) > abs(expected)


def test_critic_only_iterations_leave_the_policy_alone():
    env, net = Reaching(32), network()
    before = [parameter.detach().clone() for parameter in net.actor_parameters()]
    learner = Ppo(net, PpoConfig(horizon=4, critic_only=1))
    learner.iterate(env)
    assert all(torch.equal(a, b) for a, b in zip(before, net.actor_parameters(), strict=True))
    learner.iterate(env)
    assert not all(torch.equal(a, b) for a, b in zip(before, net.actor_parameters(), strict=True))


@pytest.mark.parametrize("minibatches", [1, 4])
def test_first_step_needs_no_pass_of_its_own(minibatches: int):
    """What acting kept gives the parameters that computing means and values again gives."""
    results = []
    for kept in (True, False):
        net = network()
        learner = Ppo(net, PpoConfig(horizon=4, epochs=2, minibatches=minibatches, critic_only=0))
        data = learner.collect(Reaching(64))
        if not kept:
            values = [net.values(seen, truth) for seen, truth in zip(data.observations, data.privileged, strict=True)]
            after = data.values[-1:].detach()
            data = replace(data, means=net.mean(data.observations), values=torch.cat([torch.stack(values), after]))
        learner.update(data)
        results.append(torch.nn.utils.parameters_to_vector(net.parameters()))
    assert torch.allclose(*results, atol=1e-6)


def test_step_size_follows_the_divergence():
    learner = Ppo(network(), PpoConfig(actor_rate=1e-4, target_kl=0.01))
    assert not learner._adapt_rate(0.05)
    assert learner.actor_rate == pytest.approx(1e-4 / 1.5)
    assert learner._adapt_rate(0.001)
    assert learner.actor_rate == pytest.approx(1e-4 / 1.5 * 1.15)


def test_learner_continues_from_its_state():
    env, net = Reaching(32), network()
    learner = Ppo(net, PpoConfig(horizon=4, critic_only=0))
    for _ in range(3):
        learner.iterate(env)
    other = Ppo(net, PpoConfig(horizon=4, critic_only=0))
    other.restore(learner.state())
    assert (other.iteration, other.actor_rate) == (3, learner.actor_rate)


def test_dagger_imitates_and_asks_the_teacher_once_per_step():
    env, net = Reaching(64), network()
    imitate(env, net, DaggerConfig(steps=120, teacher_steps=20, batch=128, capacity=2000), lambda step, loss: None)
    assert env.teacher_calls == 120
    with torch.no_grad():
        error = net.mean(torch.from_numpy(env.observation)).numpy() - env.teacher_action()
    assert np.sqrt(np.mean(error**2)) < 0.1


def test_noise_of_imitation_lasts():
    class Watched(Reaching):
        def step(self, action):
            seen.append(action.copy())
            return super().step(action)

    seen: list[np.ndarray] = []
    net = network()
    for parameter in net.imitation_parameters():
        torch.nn.init.zeros_(parameter)
    still = {"learning_rate": 0.0, "final_rate": 0.0, "exploration": 0.0, "teacher_steps": 1, "batch": 16, "capacity": 2000}
    imitate(Watched(256), net, DaggerConfig(steps=400, drift=0.2, drift_memory=0.9, **still), lambda step, loss: None)
    noise = np.array(seen[100:])
    assert np.std(noise) == pytest.approx(0.2, rel=0.05)
    for lag in (1, 10):
        assert np.mean(noise[lag:] * noise[:-lag]) / np.mean(noise**2) == pytest.approx(0.9**lag, abs=0.03)


def test_sample_ring_forgets_the_oldest():
    ring = SampleRing(capacity=4, observation=1, actions=1)
    for value in range(6):
        ring.add(torch.tensor([[float(value)]]), torch.tensor([[float(value)]]))
    drawn = set(ring.draw(200)[0].flatten().tolist())
    assert ring.count == 4
    assert drawn == {2.0, 3.0, 4.0, 5.0}


def test_the_policy_computes_in_float32_where_its_divergence_is_measured():
    torch.manual_seed(0)
    rough = ActorCritic(observation=2, privileged=1, actions=2, std=0.1, bfloat16=True, hidden=(32, 32))
    fine = ActorCritic(observation=2, privileged=1, actions=2, std=0.1, bfloat16=False, hidden=(32, 32))
    fine.load_state_dict(rough.state_dict())
    observation = torch.randn(16, 2)
    assert torch.equal(rough.mean(observation), fine.mean(observation))
    assert not torch.equal(rough.mean(observation, imitating=True), fine.mean(observation))
    assert not torch.equal(rough.values(observation, torch.ones(16, 1)), fine.values(observation, torch.ones(16, 1)))


def test_gradients_of_the_actor_are_those_of_float32_up_to_rounding():
    torch.manual_seed(0)
    rough = ActorCritic(observation=8, privileged=1, actions=2, std=0.1, bfloat16=True, hidden=(64, 32))
    fine = ActorCritic(observation=8, privileged=1, actions=2, std=0.1, bfloat16=False, hidden=(64, 32))
    fine.load_state_dict(rough.state_dict())
    observation, wanted = torch.randn(256, 8), torch.randn(256, 2)
    for net in (rough, fine):
        ((net.mean(observation) - wanted) ** 2).mean().backward()
    for mine, exact in zip(rough.actor_trunk.parameters(), fine.actor_trunk.parameters(), strict=True):
        assert mine.grad is not None
        assert exact.grad is not None
        assert (mine.grad - exact.grad).norm() < 0.01 * exact.grad.norm()


class Ageing:
    """One robot; every step pays nothing and ends an episode because its time is up."""

    observation, privileged = np.ones((1, 2), np.float32), np.ones((1, 1), np.float32)

    def teacher_action(self) -> np.ndarray:
        raise NotImplementedError

    def step(self, action: np.ndarray):
        outcome = _Outcome(np.zeros((1, 2)))
        outcome.ended, outcome.last_observation, outcome.last_privileged = np.array([0]), self.observation, self.privileged
        return outcome


def test_what_follows_the_end_of_time_is_worth_the_last_state():
    net, config = network(), PpoConfig(horizon=3)
    data = Ppo(net, config).collect(Ageing())
    with torch.no_grad():
        value = net.values(torch.ones(1, 2), torch.ones(1, 1))
    assert torch.allclose(data.values, value.expand(4, 1, 2), atol=1e-6)
    assert torch.allclose(data.rewards, (torch.tensor(config.discounts) * value).expand(3, 1, 2), atol=1e-6)
