"""The second baseline: demonstrations interpolated by ICP distance (Sec. VII-A2).

A Gaussian is fitted to the successful splines of each demonstrated rope; the exponentials of
negative ICP distances weight the Gaussians' parameters. Our reading: distances are root mean
squares in units of `length_scale`, and each Gaussian is carried along by its alignment.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from knotflow.samplers.demonstrations import load_trials
from knotflow.samplers.sampler import sampler
from knotflow.simulation import Trials, clip_splines
from knotflow.topology import Action
from knotflow.topology.polyline import Floats


@dataclass
class IcpConfig:
    """How demonstrations are interpolated."""

    length_scale: float = 0.003
    """Metres of ICP distance over which a weight falls by e."""


class IcpSampler:
    """Splines from the interpolated Gaussian of an action's demonstrated configurations."""

    def __init__(self, trials: Mapping[Action, Sequence[Trials]], config: IcpConfig) -> None:
        self.config = config
        self._gaussians = {action: _fit(some) for action, some in trials.items()}

    def sample(
        self, points: Floats, action: Action, count: int, rng: np.random.Generator
    ) -> Floats:
        """Splines (count, 6), clipped into range.

        Raises:
            ValueError: for an action without a successful demonstration.
        """
        from scipy.special import softmax

        gaussians = self._gaussians.get(action)
        if not gaussians:
            known = ", ".join(str(one) for one, some in self._gaussians.items() if some)
            raise ValueError(f"no demonstration of {action} succeeded; there are some of {known}")
        motions, distances = zip(*(align(one, points) for one, *_ in gaussians), strict=True)
        weights = softmax(-np.array(distances) / self.config.length_scale)
        moved = [
            _carry(mean, covariance, motion)
            for (_, mean, covariance), motion in zip(gaussians, motions, strict=True)
        ]
        mean = sum(w * m for w, (m, _) in zip(weights, moved, strict=True))
        covariance = sum(w * c for w, (_, c) in zip(weights, moved, strict=True))
        return clip_splines(rng.multivariate_normal(mean, covariance, count))


def align(source: Floats, target: Floats) -> tuple[Floats, float]:
    """Rigid motion on the table that brings one rope (V, 3) onto another by ICP, metres.

    It is a homogeneous matrix (3, 3); with it comes the root mean square distance of closest points
    after it. The search starts from the motion that brings equal vertices closest.
    """
    import small_gicp

    flat_source, flat_target = source * [1, 1, 0], target * [1, 1, 0]
    # The rotation that best turns one centred polygon into the other is the phase of their product.
    a, b = flat_source[:, 0] + 1j * flat_source[:, 1], flat_target[:, 0] + 1j * flat_target[:, 1]
    phase = np.vdot(a - a.mean(), b - b.mean())
    phase = phase / abs(phase) if abs(phase) > 0 else 1.0
    shift = b.mean() - phase * a.mean()
    guess = np.eye(4)
    guess[:2, :2] = [[phase.real, -phase.imag], [phase.imag, phase.real]]
    guess[:2, 3] = shift.real, shift.imag
    # Flat clouds and a flat first guess keep every step on the table.
    found = small_gicp.align(
        small_gicp.PointCloud(flat_target),
        small_gicp.PointCloud(flat_source),
        init_T_target_source=guess,
        registration_type="ICP",
        translation_epsilon=1e-5,
        rotation_epsilon=1e-4,
        max_iterations=50,
    )
    motion = found.T_target_source
    # small_gicp's error is half the sum of squared distances over the inliers.
    distance = np.sqrt(2 * found.error / max(found.num_inliers, 1))
    return motion[np.ix_([0, 1, 3], [0, 1, 3])], float(distance)


def _fit(trials: Sequence[Trials]) -> list[tuple[Floats, Floats, Floats]]:
    """Each rope (V, 3) with at least two successful splines, their mean and covariance."""
    successes = ((one.points[0], one.splines[one.success]) for one in trials)
    return [
        (points, splines.mean(axis=0), np.cov(splines, rowvar=False))
        for points, splines in successes
        if len(splines) > 1
    ]


def _carry(mean: Floats, covariance: Floats, motion: Floats) -> tuple[Floats, Floats]:
    """Mean and covariance of splines after a motion (3, 3) on the table."""
    turn = np.eye(6)
    turn[1:3, 1:3] = turn[4:6, 4:6] = motion[:2, :2]
    shift = np.array([0, *motion[:2, 2], 0, *motion[:2, 2]])
    return turn @ mean + shift, turn @ covariance @ turn.T


@sampler("icp", needs=("demonstrations",))
def build(config: IcpConfig, inputs: Mapping[str, Path]) -> IcpSampler:
    """From the output of a `demonstrations` stage."""
    return IcpSampler(load_trials(inputs["demonstrations"]), config)
