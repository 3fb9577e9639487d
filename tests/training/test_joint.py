"""Joint finetuning, on ropes whose shape decides what comes next."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pytest
import torch

from knotflow.demonstrations import Trials, task
from knotflow.primitives import Primitive, PrimitiveLibrary, encode
from knotflow.simulation import (
    Rollouts,
    RopeConfig,
    SimulationConfig,
    random_curve,
    resample,
    state_or_none,
)
from knotflow.topology import IllegalActionError, TopologicalState
from knotflow.topology.draw import draw
from knotflow.training import (
    ExplorationConfig,
    JointConfig,
    JointFinetuning,
    LearnerConfig,
    Transitions,
    joint,
    parse_path,
)
from knotflow.training.augmentation import AugmentationConfig
from knotflow.training.fitting import fit_each

PATH = parse_path("R1(0,1,1) C(0,1,1) C(2,0,1)")
STATES = [TopologicalState.trivial()]
for _action in PATH:
    STATES.append(STATES[-1].apply(_action))
ROPE = RopeConfig()
CONFIG = JointConfig(
    LearnerConfig(demonstration_trials=4, rollout_ropes=16, rollout_trials=1),
    population=16,
    rounds=3,
    episodes=8,
    steps=2,
    decay_steps=2,
    tries=1,
    guess_below_value=0.0,
    gamma=0.9,
)


@dataclass(frozen=True)
class Shapes:
    """Two shapes of each state of the path, one of them twice as wide as the other."""

    wide: dict[TopologicalState, np.ndarray]
    narrow: dict[TopologicalState, np.ndarray]

    @classmethod
    def drawn(cls):
        wide = {state: resample(draw(state, samples=40), ROPE) for state in STATES[1:]}
        narrow = {state: points * [1, 0.5, 1] for state, points in wide.items()}
        narrow = {state: resample(points, ROPE) for state, points in narrow.items()}
        for shapes in (wide, narrow):
            assert all(state_or_none(points) == state for state, points in shapes.items())
        return cls(wide, narrow)


class Toy:
    """Every step succeeds where, in the network's frame, the spline ends with y > -1, and leaves
    a wide rope where y > 0; from a narrow one only the first step can be done."""

    def __init__(self, shapes):
        self.config, self.shapes = SimulationConfig(rope=ROPE), shapes

    def execute(self, points, splines):
        ends = np.array(points)
        for row, (rope, spline) in enumerate(zip(points, splines, strict=True)):
            step = STATES.index(TopologicalState.from_curve(rope))
            y = encode(rope[None], [PATH[step]]).frames.to_network(spline[None, None])[0, 0, 5]
            stuck = any(np.array_equal(rope, narrow) for narrow in self.shapes.narrow.values())
            if y > -1 and not stuck:
                shapes = self.shapes.wide if y > 0 else self.shapes.narrow
                ends[row] = shapes[STATES[step + 1]]
        moved = np.stack([points, ends], axis=1).astype(np.float32)
        lost = np.zeros(len(ends), bool)
        return Rollouts(np.array([0.0, 1.0]), moved, moved[:, :, 0], ends, lost)


@pytest.fixture(scope="module")
def toy():
    return Toy(Shapes.drawn())


@pytest.fixture
def library(primitive_config):
    torch.manual_seed(0)
    return PrimitiveLibrary(
        {number: Primitive(primitive_config) for number in (1, 2, 3, 4)},
        {number: [] for number in (1, 2, 3, 4)},
        ROPE,
    )


@pytest.fixture
def start(library, toy):
    def make(config=CONFIG, path=PATH, trials=None, earlier=(), seed=5):
        return JointFinetuning(library, path, trials or {}, earlier, toy, config, seed)

    return make


def weights(library, *numbers):
    values = [library.primitives[n].state_dict().values() for n in numbers or (1, 2, 3, 4)]
    return torch.cat([value.flatten() for some in values for value in some])


def items(training, number):
    return training.state_dict()["learners"][str(number)]["rollouts"]["items"]


def frozen(library):
    """A configuration that learns nothing, and critics of known constant value."""
    for number, primitive in library.primitives.items():
        last = primitive.critic.head[-1]
        torch.nn.init.zeros_(last.weight)
        torch.nn.init.constant_(last.bias, float(number))
    return replace(CONFIG, learner=replace(CONFIG.learner, learning_rate=0.0), rounds=1)


def test_episodes_advance_step_by_step_from_untangled_ropes(start):
    rounds = list(start())
    assert [one.index for one in rounds] == [0, 1, 2]
    for one in rounds:
        first, *_ = one.attempts
        assert len(first) == CONFIG.episodes
        assert {state_or_none(points) for points in first.points} == {STATES[0]}
        for number, tried in enumerate(one.attempts):
            assert (tried.action, tried.start) == (PATH[number], STATES[number])
        for before, after in zip(one.attempts[:-1], one.attempts[1:], strict=True):
            reached = before.rollouts.end_points[before.success]
            np.testing.assert_array_equal(after.points, reached)
        assert set(one.metrics) == {1, 3, 4}
        assert all(np.isfinite(list(some.values())).all() for some in one.metrics.values())
        tied = one.attempts[2].success.sum() if len(one.attempts) == 3 else 0
        assert one.metrics[4]["episode_success"] == tied / CONFIG.episodes
    starts = np.concatenate([one.attempts[0].points for one in rounds])
    assert len(np.unique(starts, axis=0)) == len(starts)


def test_a_step_that_failed_is_tried_again(start):
    config = replace(CONFIG, rounds=1, tries=3)
    (one,) = start(config)
    for step, action in enumerate(PATH):
        own = [tried for tried in one.attempts if tried.action == action]
        assert 1 < len(own) <= config.tries, step
        for before, after in zip(own[:-1], own[1:], strict=True):
            np.testing.assert_array_equal(after.points, before.points[~before.success])
    entered = sum(len(tried) for tried in one.attempts if tried.action == PATH[1])
    first = [tried for tried in one.attempts if tried.action == PATH[0]]
    assert entered >= sum(tried.success.sum() for tried in first)


@pytest.mark.parametrize(("guess_below_value", "guessed"), [(0.0, False), (1.0, True)])
def test_where_the_critic_sees_no_way_a_demonstrator_guesses(
    start, library, guess_below_value, guessed
):
    with torch.no_grad():  # the policy's splines of the first step all end at y = -9
        head = library.primitives[1].actor.head[-1]
        head.weight.zero_()
        head.bias[5] = -9.0
    config = ExplorationConfig(search=0.0, spread=0.0)
    (one,) = start(
        replace(
            CONFIG,
            rounds=1,
            guess_below_value=guess_below_value,
            guess_fraction=1.0,
            exploration=config,
        )
    )
    first = one.attempts[0]
    ends = encode(first.points, [PATH[0]] * len(first)).frames.to_network(first.splines[:, None])
    assert (ends[:, 0, 5] > -1).any() == guessed
    assert ("policy_success/R1(0,1,1)" in one.metrics[1]) != guessed


def test_the_target_is_the_next_value_then_the_reward(start, library):
    training = start(frozen(library))
    (one,) = training
    assert len(one.attempts) == 3
    for number, tried in zip((1, 3, 4), one.attempts, strict=True):
        kept, success = items(training, number), tried.success
        assert 0 < success.sum()
        following = {1: 3, 3: 4}.get(number)
        reward, value = kept["reward"][:, 0].numpy(), kept["next_value"].numpy()
        if following is None:
            np.testing.assert_array_equal(reward, success)
            assert (value == 0).all()
        else:
            best = CONFIG.gamma / (1 + np.exp(-following))
            assert (reward == 0).all()
            np.testing.assert_allclose(value, best * success, rtol=1e-5)


def test_primitives_that_take_no_step_stay_as_they_were(start, library):
    before = [weights(library, number) for number in (1, 2, 3, 4)]
    list(start())
    after = [weights(library, number) for number in (1, 2, 3, 4)]
    same = [torch.equal(one, other) for one, other in zip(before, after, strict=True)]
    assert same == [False, True, False, False]


@pytest.mark.slow
def test_an_interrupted_training_ends_with_the_same_weights(
    start, library, primitive_config, tmp_path
):
    first_weights = weights(library)
    through = [one.metrics for one in start()]
    ended = weights(library)

    def again():
        torch.nn.utils.vector_to_parameters(
            first_weights, [p for n in (1, 2, 3, 4) for p in _stored(library.primitives[n])]
        )

    again()
    first = start()
    next(iter(first))
    first.save(tmp_path / "checkpoint")
    again()
    second = start()
    second.load(tmp_path / "checkpoint")
    assert second.rounds_done == 1
    assert [one.metrics for one in second] == through[1:]
    torch.testing.assert_close(weights(library), ended, atol=0, rtol=0)
    again()
    list(start(seed=6))
    assert not torch.equal(weights(library), ended)


def test_primitives_that_are_fitted_side_by_side_learn_what_they_learn_one_by_one(
    start, library, monkeypatch
):
    first_weights = weights(library)
    outcomes = []
    for threads in (1, 3):
        torch.nn.utils.vector_to_parameters(
            first_weights.clone(), [p for n in (1, 2, 3, 4) for p in _stored(library.primitives[n])]
        )
        monkeypatch.setattr(joint, "fit_each", partial(fit_each, threads=threads))
        metrics = [one.metrics for one in start()]
        outcomes.append((metrics, weights(library)))
    (one_by_one, ended), (side_by_side, ended_too) = outcomes
    assert one_by_one == side_by_side
    assert not torch.equal(ended, first_weights)
    torch.testing.assert_close(ended_too, ended, atol=0, rtol=0)


def test_an_error_in_one_fit_ends_the_others(start):
    learners = start()._learners
    steps = {number: 0 for number in learners}

    def counted(number):
        def update(rate):
            steps[number] += 1
            if number == 3:
                raise RuntimeError("diverged")
            return {}

        return update

    for number, learner in learners.items():
        learner.update = counted(number)
    with pytest.raises(RuntimeError, match="diverged"):
        fit_each({3: learners[3], 4: learners[4]}, 10_000_000)
    assert steps[4] < 10_000_000


def _stored(primitive):
    """Parameters in the order of the state dictionary."""
    named = dict(primitive.named_parameters())
    return [named[name] for name in primitive.state_dict()]


def tried_before(action, start, points, count=5):
    rng = np.random.default_rng(0)
    splines = rng.uniform(
        [0, -0.3, -0.3, 0.08, -0.3, -0.3], [1, 0.3, 0.3, 0.2, 0.3, 0.3], (count, 6)
    )
    success = np.arange(count) < 3
    return points, splines, success


def test_what_was_tried_before_stays_and_is_valued_too(start, library, toy):
    wide = toy.shapes.wide
    points, splines, success = tried_before(PATH[1], STATES[1], np.stack([wide[STATES[1]]] * 5))
    ends = np.stack([wide[STATES[2]]] * 5)
    other = parse_path("C(0,2,1)")[0]
    earlier = [
        Transitions(PATH[1], STATES[1], points, splines, success, ends),
        Transitions(other, STATES[1], points, splines, success, ends),
    ]
    training = start(frozen(library), earlier=earlier)
    (one,) = training
    kept = items(training, 3)
    assert len(kept["reward"]) == 10 + len(one.attempts[1])
    # The path's action leads on; the other one is single-step, as it was.
    best = CONFIG.gamma / (1 + np.exp(-4))
    np.testing.assert_allclose(kept["next_value"][:5].numpy(), best * success, rtol=1e-5)
    assert (kept["reward"][:5] == 0).all()
    np.testing.assert_array_equal(kept["reward"][5:10, 0].numpy(), success)
    assert (kept["next_value"][5:10] == 0).all()


def test_demonstrations_that_do_not_tell_where_they_led_are_left_out(start, toy):
    points, splines, success = tried_before(PATH[1], STATES[1], toy.shapes.wide[STATES[1]][None])
    trials = {
        task(action): Trials(task(action).action, points, np.zeros(5, int), splines, success)
        for action in ("C(0,1,1)", "C(0,2,1)")
    }
    learner = start(trials=trials)._learners[3]
    assert learner.demonstrations.trials == 5
    frames = encode(points, [task("C(0,2,1)").action]).frames
    kept = learner.demonstrations.state_dict()["items"]["spline"][0].numpy()
    np.testing.assert_allclose(kept, frames.to_network(splines[None])[0], atol=1e-5)
    assert start(path=PATH[:2], trials=trials)._learners[3].demonstrations.trials == 10


@pytest.mark.slow
def test_a_primitive_learns_to_leave_what_the_next_one_needs(start, library):
    """The first step succeeds from y > -1, but only y > 0 leaves a rope that leads on."""
    config = JointConfig(
        LearnerConfig(
            learning_rate=5e-3,
            rollout_ropes=64,
            rollout_trials=1,
            augmentation=AugmentationConfig(0.0, 0.0),
        ),
        ExplorationConfig(search=0.2, spread=0.3),
        population=16,
        rounds=5,
        episodes=32,
        tries=1,
        guess_below_value=0.0,
        steps=20,
        decay_steps=20,
    )
    rng = np.random.default_rng(1)
    points = np.stack([random_curve(ROPE, rng) for _ in range(64)])

    def share():
        seen = encode(points, [PATH[0]] * len(points))
        found, _ = library.primitives[1].search(seen, 4, np.random.default_rng(0))
        return float((found[..., 5] > 0).float().mean())

    assert share() < 0.7
    list(start(config, PATH[:2]))
    assert share() > 0.9


def test_a_primitive_that_no_episode_needs_yet_waits(start, library):
    with torch.no_grad():  # every spline of the first step ends at y = -9, where it fails
        head = library.primitives[1].actor.head[-1]
        head.weight.zero_()
        head.bias[5] = -9.0
    before = weights(library, 3, 4)
    (one,) = start(replace(CONFIG, rounds=1))
    assert len(one.attempts) == 1
    assert one.metrics[4] == {"episode_success": 0.0}
    assert torch.equal(weights(library, 3, 4), before)


def test_what_cannot_be_trained_is_refused(start, library, primitive_config, toy):
    with pytest.raises(ValueError, match="at least one action"):
        start(path=())
    with pytest.raises(IllegalActionError, match=r"C\(2,0,1\)"):
        start(path=PATH[2:])
    few = PrimitiveLibrary({1: library.primitives[1]}, {1: []}, ROPE)
    with pytest.raises(ValueError, match=r"no primitive 3, which takes the step C\(0,1,1\)"):
        JointFinetuning(few, PATH, {}, [], toy, CONFIG, 0)
    blind = Primitive(replace(primitive_config, variant="actor_only"))
    library.primitives[4] = blind
    with pytest.raises(ValueError, match="primitive 4 is actor_only"):
        start()
