"""Replay buffers, batches, and buffers of start shapes."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from knotflow.samplers.primitives import encode
from knotflow.samplers.primitives.encoding import (
    PLANE_SCALE,
    STREAM_POINTS,
    control_features,
)
from knotflow.simulation import SPLINE_HIGH, RopeConfig, resample, state_or_none
from knotflow.topology import TopologicalState, all_states, parse_action
from knotflow.topology.draw import draw
from knotflow.topology.symmetry import Symmetry, representative
from knotflow.training.buffers import (
    InitialStateBuffer,
    StateBuffer,
    TransitionBuffer,
    TrialBuffer,
    add_random_splines,
    augment,
    mix,
)
from knotflow.training.config import AugmentationConfig
from knotflow.training.learner import demonstration_buffer

ACTION = parse_action("R1(0,1,1)")


@pytest.fixture
def states(curves):
    return encode(curves, [ACTION] * len(curves)).states


@pytest.fixture
def buffer(states):
    made = TransitionBuffer(10, torch.Generator().manual_seed(0))
    next_primitive = torch.tensor([-1, -1, 1, 1, 2, 2])
    made.extend(
        TensorDict(
            {
                "states": states,
                "next_states": states.flip(0),
                "next_primitive": next_primitive,
                "spline": torch.arange(6.0)[:, None].expand(6, 6),
                "reward": torch.tensor([1.0, 0, 1, 1, 1, 1]),
                "baseline": torch.zeros(6),
                "next_value": torch.where(next_primitive < 0, torch.nan, 0.0),
            },
            batch_size=[6],
        )
    )
    return made


@pytest.fixture
def batch(trials):
    return demonstration_buffer(trials, torch.Generator().manual_seed(0)).sample(4, 10)


def test_trial_buffer_returns_what_was_added(batch):
    buffer = TrialBuffer(10, 3, torch.Generator().manual_seed(0))
    states = batch["states"][:2]
    splines = [torch.full((1, 6), 1.0), torch.full((3, 6), 2.0)]
    buffer.extend(states, splines, [torch.ones(1), torch.tensor([0.0, 1.0, 0.0])])
    assert len(buffer) == 2
    drawn = buffer.sample(5, 2)
    assert sorted(drawn["owner"].tolist()) == [0, 1, 1]
    assert (drawn["spline"] == (drawn["owner"] + 1.0)[:, None]).all()
    torch.testing.assert_close(drawn["baseline"], torch.tensor([1.0, 1 / 3, 1 / 3]))
    other = TrialBuffer(10, 3, torch.Generator().manual_seed(0))
    other.load_state_dict(buffer.state_dict())
    assert len(other.sample(5, 3)["owner"]) == 4
    with pytest.raises(ValueError, match="1 to 3 trials, not 4"):
        buffer.extend(states[:1], [torch.zeros(4, 6)], [torch.zeros(4)])


def made_up(count, first=0):
    """Transitions told apart by their rewards."""
    return TensorDict(
        {
            "reward": torch.arange(float(first), float(first + count)),
            "spline": torch.zeros(count, 6),
        },
        batch_size=[count],
    )


@pytest.mark.parametrize("added", [3, 5, 8, 13])
def test_restored_buffer_overwrites_the_same_items(added):
    """Also where the ring is full and the write cursor stands in its middle."""
    whole = TransitionBuffer(5, torch.Generator())
    whole.extend(made_up(added))
    restored = TransitionBuffer(5, torch.Generator())
    restored.load_state_dict(whole.state_dict())
    for buffer in (whole, restored):
        buffer.extend(made_up(2, first=100))
    assert torch.equal(*(one.state_dict()["items"]["reward"] for one in (whole, restored)))


def next_values(batch):
    """In the order in which trials were added."""
    return batch["next_value"][batch["spline"][:, 0].argsort()]


def test_next_values_are_those_of_the_last_refresh(buffer, states):
    assert next_values(buffer.sample(6, 1))[2:].tolist() == [0] * 4
    asked = {}

    def value(primitive, some):
        asked[primitive] = some["streams"]
        return some["streams"][:, 0, 0] * 0 + 0.1 * primitive

    buffer.refresh(value, 6)
    # Primitives are asked about the ropes that they would begin with, not those tried on.
    expected = {one.tobytes() for one in states["streams"][[3, 2]].numpy()}
    assert {one.tobytes() for one in asked[1].numpy()} == expected
    values = next_values(buffer.sample(6, 1))
    torch.testing.assert_close(values[2:], torch.tensor([0.1, 0.1, 0.2, 0.2]))
    assert values[:2].isnan().all()
    assert len(buffer.sample(3, 1)["next_value"]) == 3
    other = TransitionBuffer(10, torch.Generator().manual_seed(0))
    other.load_state_dict(buffer.state_dict())
    torch.testing.assert_close(next_values(other.sample(6, 1)), values, equal_nan=True)


def test_refresh_of_some_trials(buffer):
    buffer.refresh(lambda primitive, some: torch.ones(len(some)), 1)
    assert next_values(buffer.sample(6, 1))[2:].sum() <= 1


def test_oldest_trials_are_overwritten(buffer):
    again = buffer._replay[:].clone()
    again["spline"] = again["spline"] + 10
    buffer.extend(again)
    kept = buffer.sample(20, 1)["spline"][:, 0].sort().values
    assert kept.tolist() == [2, 3, 4, 5, 10, 11, 12, 13, 14, 15]


def test_successes_are_counted(buffer):
    assert buffer.num_successes == 5
    assert TransitionBuffer(3, torch.Generator()).num_successes == 0


def test_mixed_batches_count_each_source_with_its_share(batch):
    few = {"owner": torch.zeros(5, dtype=torch.long)}
    small = batch.clone()
    for key in ("spline", "reward", "baseline", "weight"):
        small[key] = batch[key][:5]
    small["owner"] = few["owner"]
    both = mix([batch, small], [0.25, 0.75])
    size = len(batch["owner"])
    assert both["weight"].mean() == pytest.approx(1.0)
    assert both["weight"][:size].sum() / both["weight"].sum() == pytest.approx(0.25)
    # Trials keep their ropes.
    torch.testing.assert_close(
        both["states"][both["owner"][size:]]["streams"], batch["states"][small["owner"]]["streams"]
    )


def test_mixed_in_demonstrations_have_no_next_value(buffer, states):
    single = TrialBuffer(2, 1, torch.Generator().manual_seed(0))
    single.extend(states[:2], [torch.zeros(1, 6)] * 2, [torch.ones(1), torch.zeros(1)])
    both = mix([single.sample(2, 1), buffer.sample(6, 1)], [0.5, 0.5])
    assert both["next_value"][:2].isnan().all()
    assert both["next_value"].isnan().sum() == 4
    assert mix([single.sample(2, 1)], [1.0])["next_value"].isnan().all()


def test_augmentation_moves_rope_and_spline_together(trials):
    generator = torch.Generator().manual_seed(0)
    batch = demonstration_buffer(trials, generator).sample(6, 10)
    before = batch.clone()
    copy = augment(batch, AugmentationConfig(turn=1.0, shift=1.0), generator)
    torch.testing.assert_close(batch["spline"], before["spline"])  # untouched
    assert not torch.allclose(copy["spline"], batch["spline"], atol=0.1)

    def distances(some):
        """From middle and end point to every point of the spline's rope."""
        rope = some["states"]["streams"][some["owner"]][:, -STREAM_POINTS[-1] :, :2]
        spline = some["spline"]
        return torch.cat([(rope - spline[:, None, k : k + 2]).norm(dim=-1) for k in (1, 4)], dim=1)

    torch.testing.assert_close(distances(copy), distances(batch), atol=1e-4, rtol=1e-4)
    kept = [0, 3]
    torch.testing.assert_close(copy["spline"][:, kept], batch["spline"][:, kept])

    def held(some):
        """Where the grasped point's direction points, seen from the middle control point."""
        features = control_features(some["states"][some["owner"]], some["spline"][:, None])[:, 0]
        arm = features[:, 7:9] - some["spline"][:, 1:3]
        return (arm * features[:, 10:12]).sum(dim=1)

    torch.testing.assert_close(held(copy), held(batch), atol=1e-4, rtol=1e-4)


def test_random_splines_beside_trials_fail_with_their_share_of_the_weight(trials):
    generator = torch.Generator().manual_seed(0)
    batch = demonstration_buffer(trials, generator).sample(6, 10)
    both, count = add_random_splines(batch, 0.25, generator), len(batch["owner"])
    torch.testing.assert_close(both["spline"][:count], batch["spline"])
    assert torch.equal(both["owner"][count:], batch["owner"])
    assert both["reward"][count:].sum() == 0
    assert both["weight"].mean().item() == pytest.approx(1)
    assert both["weight"][count:].sum() / both["weight"].sum() == pytest.approx(0.25)
    centre, unit = batch["states"]["grasp"][batch["owner"]].unbind(-1)
    position = centre + unit * both["spline"][count:, 0]
    assert 0 <= position.min() < 0.2 and 0.8 < position.max() <= 1
    plane = both["spline"][count:, [1, 2, 4, 5]] * PLANE_SCALE
    assert 0.4 < plane.abs().max() <= SPLINE_HIGH[1]


@pytest.mark.slow
@pytest.mark.parametrize("symmetry", Symmetry.all())
def test_shapes_are_transformed_as_states_are(symmetry):
    for state in all_states(2)[::7]:
        points = resample(draw(state, samples=40), RopeConfig())
        if state_or_none(points) == state:  # resampling may cut a corner
            assert state_or_none(symmetry.of_points(points)) == symmetry.of_state(state)
            np.testing.assert_array_equal(symmetry.of_points(symmetry.of_points(points)), points)


def test_state_buffer_keeps_shapes_of_representatives_up_to_its_capacity():
    buffer, rng = StateBuffer(3), np.random.default_rng(0)
    state = TopologicalState.parse("1o2-")
    first, _symmetry = representative(state)
    for number in range(5):
        buffer.add(np.full((4 + number, 3), float(number)), state, rng, number)
    assert list(buffer) == [first]

    def drawn(some: StateBuffer) -> set[tuple[int, float, int]]:
        shapes = (some.draw(first, rng) for _ in range(100))
        return {(len(shape), float(np.abs(shape[0, 0])), rope) for shape, rope in shapes}

    kept = drawn(buffer)
    assert len(kept) == 3 and all(one == (4 + one[2], one[2], one[2]) for one in kept)
    other = StateBuffer(3)
    other.load_state_dict(buffer.state_dict())
    assert drawn(other) == kept


def shapes(count: int, first: int = 0) -> np.ndarray:
    """Ropes that are told apart by their first coordinate."""
    out = np.zeros((count, 41, 3))
    out[:, 0, 0] = np.arange(first, first + count)
    return out


def names(points: np.ndarray) -> list[int]:
    return points[:, 0, 0].astype(int).tolist()


def test_given_shapes_are_drawn_without_repetition_where_there_are_enough(rng):
    pool = InitialStateBuffer(shapes(10), recycled_share=0.5, capacity=5)
    assert sorted(names(pool.draw(10, rng))) == list(range(10))
    assert set(names(pool.draw(30, rng))) <= set(range(10))


def test_recycled_shapes_have_their_share(rng):
    pool = InitialStateBuffer(shapes(10), recycled_share=0.3, capacity=100)
    pool.recycle(shapes(20, first=100))
    drawn = np.array(names(pool.draw(2000, rng)))
    assert (drawn >= 100).mean() == pytest.approx(0.3, abs=0.05)


def test_newest_recycled_shapes_are_kept(rng):
    pool = InitialStateBuffer(shapes(1), recycled_share=1.0, capacity=3)
    pool.recycle(shapes(2, first=100))
    pool.recycle(shapes(2, first=200))
    assert set(names(pool.draw(100, rng))) == {101, 200, 201}


def test_initial_state_buffer_is_restored(rng):
    pool = InitialStateBuffer(shapes(4), recycled_share=0.5, capacity=5)
    pool.recycle(shapes(3, first=100))
    again = InitialStateBuffer(shapes(4), recycled_share=0.5, capacity=5)
    again.load_state_dict(pool.state_dict())
    draws = [p.draw(8, np.random.default_rng(1)) for p in (pool, again)]
    np.testing.assert_array_equal(*draws)
