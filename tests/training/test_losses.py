from __future__ import annotations

import pytest
import torch
from torch.nn.functional import binary_cross_entropy_with_logits

from knotflow.samplers.primitives import Actor, Critic, NetworkConfig
from knotflow.training import ActorLoss, CriticLoss
from knotflow.training.buffer import TrialBuffer, mixed
from knotflow.training.learner import demonstration_buffer
from knotflow.training.losses import returns

NETWORK = NetworkConfig(lstm=8, attention=4, stream=8, feature=8, head=8)


@pytest.fixture
def batch(trials):
    torch.manual_seed(0)
    generator = torch.Generator().manual_seed(0)
    buffer = demonstration_buffer([(trials, trials.start >= 0)], generator)
    return buffer.sample(4, 10)


def test_the_critic_loss_is_the_cross_entropy_with_the_reward(batch):
    critic = Critic(NETWORK)
    success, _ = critic(batch["states"], batch["spline"], batch["owner"]).unbind(-1)
    expected = binary_cross_entropy_with_logits(success, batch["reward"])
    torch.testing.assert_close(CriticLoss(critic)(batch)["loss_critic"], expected)


def test_what_is_left_is_learned_from_successes_that_were_valued(batch):
    critic = Critic(NETWORK)
    alone = CriticLoss(critic)(batch)["loss_critic"]
    hits = torch.nonzero(batch["reward"] > 0)[:, 0]
    assert len(hits) > 1
    batch["next_value"] = torch.full_like(batch["reward"], 0.8)
    batch["next_value"][hits[0]] = torch.nan
    _, onward = critic(batch["states"], batch["spline"], batch["owner"]).unbind(-1)
    valued = onward[hits[1:]]
    expected = binary_cross_entropy_with_logits(
        valued, torch.full_like(valued, 0.8), reduction="sum"
    ) / len(batch["reward"])
    loss = CriticLoss(critic)(batch)["loss_critic"]
    torch.testing.assert_close(loss, alone + expected)
    loss.backward()
    assert all(p.grad is None or p.grad.isfinite().all() for p in critic.parameters())


def test_the_actor_is_pulled_less_towards_what_leaves_no_room(batch):
    batch["next_value"] = torch.full_like(batch["reward"], torch.nan)
    assert returns(batch, 0.5).tolist() == batch["reward"].tolist()
    batch["next_value"] = torch.zeros_like(batch["reward"])
    assert returns(batch, 0.25).tolist() == (0.25 * batch["reward"]).tolist()
    assert returns(batch, 0.0).sum() == 0
    batch["next_value"] = torch.ones_like(batch["reward"])
    assert returns(batch, 0.25).tolist() == batch["reward"].tolist()


def test_without_a_baseline_the_actor_loss_is_the_likelihood_of_the_successes(batch):
    actor = Actor(NETWORK)
    mean, factor = actor(batch["states"])
    log_prob = torch.stack(
        [
            torch.distributions.MultivariateNormal(
                mean[owner], factor[owner] @ factor[owner].T
            ).log_prob(spline)
            for owner, spline in zip(batch["owner"], batch["spline"], strict=True)
        ]
    )
    expected = -log_prob[batch["reward"] > 0].mean()
    loss = ActorLoss(actor)(batch)["loss_actor"]
    torch.testing.assert_close(loss, expected, atol=1e-4, rtol=1e-4)


def test_failures_push_the_actor_only_while_it_would_still_propose_them(batch):
    actor = Actor(NETWORK)
    batch["reward"] = torch.zeros_like(batch["reward"])
    batch["baseline"] = torch.full_like(batch["baseline"], 0.5)
    near = batch.clone()
    near["spline"] = actor(batch["states"])[0].detach()[batch["owner"]]
    far = batch.clone()
    far["spline"] = near["spline"] + 100
    loss = ActorLoss(actor, failure_weight=1.0)

    def gradient(some):
        actor.zero_grad()
        loss(some)["loss_actor"].backward()
        return sum(float(p.grad.abs().sum()) for p in actor.parameters())

    assert gradient(near) > 0
    assert gradient(far) == 0
    assert ActorLoss(actor, failure_weight=0.0)(near)["loss_actor"] == 0


def test_mixed_batches_count_each_source_with_its_share(batch):
    few = {"owner": torch.zeros(5, dtype=torch.long)}
    small = batch.clone()
    for key in ("spline", "reward", "baseline", "weight"):
        small[key] = batch[key][:5]
    small["owner"] = few["owner"]
    both = mixed([batch, small], [0.25, 0.75])
    size = len(batch["owner"])
    assert both["weight"].mean() == pytest.approx(1.0)
    assert both["weight"][:size].sum() / both["weight"].sum() == pytest.approx(0.25)
    # Trials keep their ropes.
    torch.testing.assert_close(
        both["states"][both["owner"][size:]]["streams"], batch["states"][small["owner"]]["streams"]
    )


def test_a_buffer_gives_back_what_it_was_given(batch):
    buffer = TrialBuffer(10, 3, torch.Generator().manual_seed(0))
    states = batch["states"][:2]
    splines = [torch.full((1, 6), 1.0), torch.full((3, 6), 2.0)]
    buffer.extend(states, splines, [torch.ones(1), torch.tensor([0.0, 1.0, 0.0])])
    assert (len(buffer), buffer.trials) == (2, 4)
    drawn = buffer.sample(5, 2)
    assert sorted(drawn["owner"].tolist()) == [0, 1, 1]
    assert (drawn["spline"] == (drawn["owner"] + 1.0)[:, None]).all()
    torch.testing.assert_close(drawn["baseline"], torch.tensor([1.0, 1 / 3, 1 / 3]))
    other = TrialBuffer(10, 3, torch.Generator().manual_seed(0))
    other.load_state_dict(buffer.state_dict())
    assert other.trials == 4
    with pytest.raises(ValueError, match="1 to 3 trials, not 4"):
        buffer.extend(states[:1], [torch.zeros(4, 6)], [torch.zeros(4)])


def test_trials_pull_the_actor_by_their_pull_and_only_gains_do_where_so_chosen(batch):
    actor = Actor(NETWORK)
    hits = batch["reward"] > 0
    loss = ActorLoss(actor)(batch)["loss_actor"]
    batch["pull"] = torch.where(hits, 1.0, 7.0)  # failures have no advantage to be weighed
    torch.testing.assert_close(ActorLoss(actor)(batch)["loss_actor"], loss)
    batch["pull"] = torch.where(hits, 0.0, 1.0)
    assert ActorLoss(actor)(batch)["loss_actor"] == 0
    del batch["pull"]
    batch["baseline"] = torch.full_like(batch["baseline"], 2.0)
    pushed = ActorLoss(actor, failure_weight=1.0)(batch)["loss_actor"]
    assert pushed != 0
    assert ActorLoss(actor, failure_weight=1.0, gains_only=True)(batch)["loss_actor"] == 0
