"""Trials on ropes of many proportions, each in a world of its own."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from knotflow.simulation import (
    RopeConfig,
    RopeSimulator,
    control_points,
    draw_ropes,
    draw_worlds,
    end_states,
)
from knotflow.topology import TopologicalState
from knotflow.topology.polyline import Floats
from knotflow.training.config import RopesConfig
from knotflow.training.transitions import Query, TransitionTrainer


class ManyRopes(TransitionTrainer):
    """A trainer whose configuration is a `RopesConfig`, too."""

    @property
    def drawn(self) -> RopesConfig:
        """What ropes and worlds are drawn from."""
        assert isinstance(self.config, RopesConfig)
        return self.config

    def prepare_ropes(self) -> None:
        """Draw the ropes, and let the library know of what proportions they are."""
        drawn, nominal = self.drawn, self.simulator.config.rope
        self.ropes = [nominal, *draw_ropes(drawn.ropes - 1, self.rng, drawn.proportions)]
        self.library.proportions = drawn.proportions if drawn.ropes > 1 else None
        self._simulators = {nominal.links: self.simulator}
        """By the number of links; worlds give each rope its other properties."""
        for rope in self.ropes:
            if rope.links not in self._simulators:
                other = replace(self.simulator.config, rope=rope)
                self._simulators[rope.links] = RopeSimulator(other)

    def draw_rope(self) -> RopeConfig:
        """One of the ropes."""
        usual = self.rng.random() < self.drawn.nominal_share
        return self.ropes[0 if usual else self.rng.integers(len(self.ropes))]

    def simulate(
        self, queries: Sequence[Query], splines: Floats
    ) -> tuple[Iterable[Floats], Sequence[TopologicalState | None]]:
        ends: list[Floats] = [np.empty(0)] * len(queries)
        states: list[TopologicalState | None] = [None] * len(queries)
        ropes = [query.canonical.rope for query in queries]
        worlds = [draw_worlds(rope, 1, self.rng, self.drawn.worlds)[0] for rope in ropes]
        for links, simulator in self._simulators.items():
            rows = [row for row, rope in enumerate(ropes) if rope.links == links]
            if not rows:
                continue
            points = np.stack([queries[row].points for row in rows])
            radii = np.array([ropes[row].radius for row in rows])
            controls = control_points(points, splines[rows], radii)
            own = [worlds[row] for row in rows]
            rollouts = simulator.execute(points, splines[rows], own, controls)
            for row, end, state in zip(
                rows, rollouts.end_points, end_states(rollouts), strict=True
            ):
                ends[row], states[row] = end, state
        return ends, states
