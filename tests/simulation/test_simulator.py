"""The simulator's contract: any spline, any thread count, and rope that stays on its side."""

from dataclasses import replace

import numpy as np
import pytest

from knotflow.simulation import (
    SPLINE_HIGH,
    SPLINE_LOW,
    Rollouts,
    RopeConfig,
    RopeSimulator,
    ShapeError,
    SimulationConfig,
    SplineError,
    arc,
    control_points,
    random_curve,
    resample,
    spline_path,
    straight,
)
from knotflow.topology import TopologicalState


def random_batch(simulator, rng, count):
    rope = simulator.config.rope
    points = np.stack([random_curve(rope, rng) for _ in range(count)])
    return points, rng.uniform(SPLINE_LOW, SPLINE_HIGH, (count, 6))


@pytest.fixture(scope="module")
def batch(simulator):
    """Splines on ropes, more than a chunk of them, and their rollouts."""
    points, splines = random_batch(simulator, np.random.default_rng(7), 96)
    return points, splines, simulator.execute(points, splines)


def test_shapes_and_times(simulator, rng):
    points, splines = random_batch(simulator, rng, 3)
    rollouts = simulator.execute(points, splines)
    frames = len(rollouts.times)
    assert rollouts.times[0] == 0
    assert frames == rollouts.frames.max()
    rest = rollouts.times[rollouts.frames - 1] - rollouts.release_times
    assert (rest >= 0.1).all() and (rest < simulator.config.settle_time + 0.1).all()
    assert rollouts.trajectory.shape == (3, frames, 41, 3)
    assert rollouts.gripper.shape == (3, frames, 3)
    assert rollouts.end_points.shape == points.shape
    np.testing.assert_allclose(rollouts.trajectory[:, 0], points, atol=1e-6)
    np.testing.assert_allclose(rollouts.trajectory[:, -1], rollouts.end_points, atol=1e-6)


@pytest.mark.slow
def test_random_splines_are_stable(simulator, batch):
    _, _, rollouts = batch
    assert not rollouts.diverged.any()
    lengths = np.linalg.norm(np.diff(rollouts.trajectory, axis=2), axis=-1)
    np.testing.assert_allclose(lengths, simulator.config.rope.link_length, atol=1e-5)
    # Contacts are soft and only every other link has feet: in motion a vertex dips, by no more than
    # the rope's thickness; at rest all lie on the table.
    radius = simulator.config.rope.radius
    assert rollouts.trajectory[..., 2].min() > -radius
    assert rollouts.end_points[..., 2].min() > 0.7 * radius
    speed = np.linalg.norm(np.diff(rollouts.trajectory, axis=1), axis=-1) / 0.1
    assert speed.max() < 4.0  # a strand that falls or springs back is faster than the gripper


@pytest.mark.slow
def test_rope_is_at_rest_before_and_after(simulator, batch):
    _, _, rollouts = batch
    last = np.linalg.norm(rollouts.trajectory[:, -1] - rollouts.trajectory[:, -2], axis=-1)
    assert np.median(last.max(axis=1)) < 0.005  # metres in the last tenth of a second
    # Nothing moves before the gripper does: a spline that stays where it grasped changes little.
    rope = simulator.config.rope
    lying = straight(rope)
    stay = np.array([0.5, lying[20, 0] + 0.0125, 0.0, 0.02, lying[20, 0] + 0.0125, 0.0])
    kept = simulator.execute(lying[None], stay[None]).end_points[0]
    assert np.linalg.norm(kept - lying, axis=1).max() < 0.02


@pytest.mark.slow
def test_gripper_moves_grasped_link_to_end_point(batch):
    _, splines, rollouts = batch
    released = np.searchsorted(rollouts.times, rollouts.release_times) - 1
    link = np.minimum((splines[:, 0] * 40).astype(int), 39)
    rows = np.arange(len(splines))
    centre = (
        rollouts.trajectory[rows, released, link] + rollouts.trajectory[rows, released, link + 1]
    ) / 2
    distance = np.linalg.norm(centre - rollouts.gripper[rows, released], axis=1)
    assert np.median(distance) < 0.015  # a frame is of a time step earlier
    np.testing.assert_allclose(rollouts.gripper[:, -1, :2], splines[:, 4:], atol=1e-5)


@pytest.mark.slow
def test_results_are_independent_of_threads_and_batches(simulator, rng):
    points, splines = random_batch(simulator, rng, 5)
    together = simulator.execute(points, splines)
    single = RopeSimulator(replace(simulator.config, threads=1))
    for i in range(5):
        alone = single.execute(points[i : i + 1], splines[i : i + 1])
        assert np.array_equal(alone.motion(0).trajectory, together.motion(i).trajectory)
        assert np.array_equal(alone.end_points[0], together.end_points[i])


@pytest.mark.slow
def test_batch_larger_than_a_chunk(simulator, batch):
    points, splines, together = batch
    last = simulator.execute(points[-3:], splines[-3:])
    assert np.array_equal(together.end_points[-3:], last.end_points)


def test_dragged_rope_does_not_pass_through(simulator):
    """The tail is dragged over, then back against, the head: crossings never flip over to under."""
    rope = simulator.config.rope
    # A hook: the tail runs beside the head and is drawn over it, far and fast.
    heading = np.linspace(0, 1.15 * np.pi, 60)
    hook = np.stack([np.cumsum(np.cos(heading)), np.cumsum(np.sin(heading)), 0 * heading], axis=1)
    points = resample(hook / np.linalg.norm(np.diff(hook, axis=0), axis=1).sum(), rope)
    points[:, :2] -= points[:, :2].mean(axis=0)
    points[:, 2] = rope.radius
    across = points[8, :2] - (points[-1, :2] - points[8, :2]) * 0.5
    over = np.array([0.99, *points[20, :2], 0.15, *np.clip(across, -0.6, 0.6)])
    crossed = simulator.execute(points[None], over[None]).end_points[0]
    state = TopologicalState.from_curve(crossed)
    assert state.num_crossings > 0
    # Dragging flat along the table cannot lift rope over rope: over stays over at every frame.
    tops = set()
    for shift in ((0.25, 0.0), (-0.25, 0.0), (0.0, 0.25), (0.0, -0.25)):
        end = np.clip(crossed[20, :2] + shift, -0.6, 0.6)
        drag = np.array([0.5, *((crossed[20, :2] + end) / 2), 0.02, *end])
        trajectory = simulator.execute(crossed[None], drag[None]).trajectory[0]
        tops |= flipped(trajectory)
    assert not tops


def flipped(trajectory):
    """Pairs of links whose strands change over for under between frames while they cross."""
    pairs = set()
    signs = None
    for frame in trajectory.astype(float):
        start, step = frame[:-1], np.diff(frame, axis=0)
        u, v = step[:, None, :], step[None, :, :]
        gap = start[None] - start[:, None]
        turn = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            s = (gap[..., 0] * v[..., 1] - gap[..., 1] * v[..., 0]) / turn
            t = (gap[..., 0] * u[..., 1] - gap[..., 1] * u[..., 0]) / turn
        crossing = (s > 0) & (s < 1) & (t > 0) & (t < 1)
        height = (
            gap[..., 2]
            + np.where(crossing, t, 0) * v[..., 2]
            - np.where(crossing, s, 0) * u[..., 2]
        )
        now = np.where(crossing, np.sign(height), 0)
        if signs is not None:
            pairs |= {tuple(pair) for pair in np.argwhere(signs * now < 0).tolist()}
        signs = now
    return pairs


@pytest.mark.parametrize("count", [0, 1])
def test_empty_and_single_batches(simulator, rng, count):
    points, splines = random_batch(simulator, rng, 2)
    assert len(simulator.execute(points[:count], splines[:count])) == count


def test_invalid_input_is_rejected(simulator, rng):
    points, splines = random_batch(simulator, rng, 2)
    with pytest.raises(ShapeError):
        simulator.execute(points[:, :-1], splines)
    with pytest.raises(SplineError):
        simulator.execute(points, splines + 2)
    with pytest.raises(ValueError, match=r"\(B, V, 3\) and splines \(B, 6\)"):
        simulator.execute(points, splines[:1])


def test_divergence_is_marked_per_rope(rng, tmp_path, monkeypatch):
    """Physics that blows up is a marked failure, not an exception, a file or a neighbour's."""
    monkeypatch.chdir(tmp_path)
    fragile = SimulationConfig(
        rope=RopeConfig(joint_armature=0.0, joint_damping=0.0, density=1.0),
        timestep=0.05,
        contact_time=0.1,
        threads=2,
    )
    simulator = RopeSimulator(fragile)
    points, splines = random_batch(simulator, rng, 16)
    rollouts = simulator.execute(points, splines)
    assert rollouts.diverged.any()
    lost = rollouts.diverged
    np.testing.assert_array_equal(rollouts.end_points[lost], points[lost])
    assert np.isfinite(rollouts.end_points).all()
    assert not list(tmp_path.iterdir())


def test_indexing_and_concatenating_rollouts(simulator, rng):
    points, splines = random_batch(simulator, rng, 3)
    rollouts = simulator.execute(points, splines)
    part = rollouts[[2, 0]]
    np.testing.assert_array_equal(part.end_points, rollouts.end_points[[2, 0]])
    np.testing.assert_array_equal(part.trajectory, rollouts.trajectory[[2, 0]])
    np.testing.assert_array_equal(part.gripper, rollouts.gripper[[2, 0]])
    assert part.times is rollouts.times
    assert len(rollouts[1:]) == len(rollouts[1:].diverged) == 2
    row, count = int(rollouts.frames.argmin()), int(rollouts.frames.min())
    short, whole = rollouts[[row]], rollouts.trajectory[[row]]
    short = replace(short, times=short.times[:count], trajectory=whole[:, :count])
    for parts in ([short, rollouts], [rollouts, short]):
        joined = Rollouts.concatenate(parts)
        assert joined.times is rollouts.times
        assert (joined.trajectory == whole).all(axis=(1, 2, 3)).sum() == 2
    joined = Rollouts.concatenate([rollouts[:2], rollouts[2:]])
    for name in ("times", "trajectory", "gripper", "end_points", "diverged"):
        np.testing.assert_array_equal(getattr(joined, name), getattr(rollouts, name))


def test_spline_takes_its_length_at_the_pace(simulator):
    rope, config = simulator.config.rope, simulator.config
    lying = np.stack([straight(rope)] * 2)
    splines = np.array([[0.5, 0.0125, 0.1, 0.05, 0.0125, 0.2], [0.5, 0.1, 0.3, 0.1, -0.3, 0.3]])
    rollouts = simulator.execute(lying, splines)
    controls = control_points(lying, splines, rope.radius)
    steps = np.diff(spline_path(controls, np.linspace(0, 1, 2001)), axis=1)
    length = np.linalg.norm(steps, axis=-1).sum(axis=1)
    wanted = length / config.pace + config.ramp_time
    np.testing.assert_allclose(rollouts.release_times, wanted, atol=config.timestep)
    speed = np.linalg.norm(np.diff(rollouts.gripper, axis=1), axis=-1) / 0.1
    assert speed.max() <= config.pace * (1 + config.timestep / config.ramp_time)


def test_a_rope_that_is_dragged_slowly_is_not_at_rest():
    config = SimulationConfig(pace=0.009, threads=1)
    assert config.pace < config.rest_speed
    lying = straight(config.rope)
    spline = np.array([0.51, 0.0125, 0.005, 0.02, 0.0125, 0.01])
    rollouts = RopeSimulator(config).execute(lying[None], spline[None])
    assert rollouts.times[-1] > rollouts.release_times[0] > 1.0


def test_spline_that_goes_nowhere_is_simulated(simulator):
    lying = straight(simulator.config.rope)
    place = lying[20:22, :2].mean(axis=0)
    stay = np.array([0.51, *place, 0.02, *place])
    rollouts = simulator.execute(lying[None], stay[None])
    assert rollouts.release_times[0] < 0.1
    np.testing.assert_allclose(rollouts.end_points[0], lying, atol=0.005)


def test_bends_are_kept_where_rest_angles_follow_the_shape():
    moved = []
    for keeps_bends in (False, True):
        rope = RopeConfig(table_friction=0.2, joint_stiffness=0.02, keeps_bends=keeps_bends)
        bow = arc(rope, np.pi)
        place = bow[:2, :2].mean(axis=0)
        stay = np.array([0.0, *place, 0.02, *place])
        simulator = RopeSimulator(SimulationConfig(rope=rope, threads=1))
        end = simulator.execute(bow[None], stay[None]).end_points[0]
        moved.append(np.linalg.norm(end - bow, axis=1).max())
    assert moved[1] < 0.2 * moved[0]
