"""The second baseline: demonstrations interpolated by ICP distance (Sec. VII-A2).

A Gaussian is fitted to the successful splines of each demonstrated rope and carried along by the
rope's alignment; the exponentials of negative distances weight the Gaussians' parameters. As in the
authors' code, equal vertices correspond, and the distance is the sum of 64 squared ones.
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

NODES = 64
"""Vertices of the authors' rope; distances are sums over so many."""
AUTHORS_STD = np.array([0.03, 0.05, 0.05, 0.05, 0.05, 0.05])
"""Standard deviations (6,) of the grasp, a fraction of the rope's length, and the other numbers of
a spline, metres."""


@dataclass
class IcpConfig:
    """How demonstrations are interpolated."""

    scale: float = 0.2
    """Distance over which a weight falls by e, m^2; see `align`."""
    authors: bool = False
    """As in the authors' code: the demonstrated splines are interpolated, with fixed deviations
    `AUTHORS_STD`, in place of the Gaussians of what succeeds of their copies (Sec. VII-A2)."""


class IcpSampler:
    """Splines from the interpolated Gaussian of an action's demonstrated configurations."""

    capabilities: frozenset[str] = frozenset()
    """None beside `sample`: nobody demonstrated how to undo or arrange."""

    def __init__(self, trials: Mapping[Action, Sequence[Trials]], config: IcpConfig) -> None:
        self.config = config
        fit = _fit_copies if config.authors else _fit
        self._gaussians = {action: fit(some) for action, some in trials.items()}

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
        weights = softmax(-np.array(distances) / self.config.scale)
        moved = [
            _carry(mean, covariance, motion)
            for (_, mean, covariance), motion in zip(gaussians, motions, strict=True)
        ]
        mean = sum(w * m for w, (m, _) in zip(weights, moved, strict=True))
        covariance = sum(w * c for w, (_, c) in zip(weights, moved, strict=True))
        return clip_splines(rng.multivariate_normal(mean, covariance, count))


def align(source: Floats, target: Floats) -> tuple[Floats, float]:
    """Rigid motion on the table that brings the vertices of one rope (V, 3) closest to another's.

    It is a homogeneous matrix (3, 3); with it comes 64 times the mean squared distance after it,
    m^2.
    """
    # The rotation that best turns one centred polygon into the other is the phase of their product.
    a, b = source[:, 0] + 1j * source[:, 1], target[:, 0] + 1j * target[:, 1]
    product = np.vdot(a - a.mean(), b - b.mean())
    phase = product / abs(product) if product else 1.0
    shift = b.mean() - phase * a.mean()
    motion = np.eye(3)
    motion[:2] = [[phase.real, -phase.imag, shift.real], [phase.imag, phase.real, shift.imag]]
    return motion, float(NODES * np.mean(np.abs(phase * a + shift - b) ** 2))


def _fit(trials: Sequence[Trials]) -> list[tuple[Floats, Floats, Floats]]:
    """Each rope (V, 3) with at least two successful splines, their mean and covariance."""
    successes = ((one.points[0], one.splines[one.success]) for one in trials)
    return [
        (points, splines.mean(axis=0), np.cov(splines, rowvar=False))
        for points, splines in successes
        if len(splines) > 1
    ]


def _fit_copies(trials: Sequence[Trials]) -> list[tuple[Floats, Floats, Floats]]:
    """Each rope (V, 3), the mean of all copies of its spline, and `AUTHORS_STD` as covariance."""
    return [(one.points[0], one.splines.mean(axis=0), np.diag(AUTHORS_STD**2)) for one in trials]


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
