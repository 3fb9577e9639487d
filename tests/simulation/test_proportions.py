"""Ropes of other proportions are drawn in range, and their models are those that are built."""

import re
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
import yaml

from knotflow.simulation import (
    NOMINAL,
    ProportionsConfig,
    RopeConfig,
    RopeSimulator,
    SimulationConfig,
    World,
    build_model,
    control_points,
    draw_ropes,
    perturb_rope,
    random_trials,
    rope_of,
    usual_links,
)
from knotflow.simulation.rope import GRAVITY, adapt_model
from knotflow.simulation.simulator import OF_ROPE

CONF = Path(__file__).parents[2] / "conf" / "rope"
WORKFLOWS = Path(__file__).parents[2] / "workflows"


def test_nominal_rope_is_that_of_its_proportions():
    assert rope_of(2 * NOMINAL.radius, NOMINAL.bending_length) == RopeConfig()


@pytest.mark.parametrize("links", [None, 24])
def test_bending_length_and_mass_do_not_depend_on_links(links):
    rope = rope_of(0.02, 0.07, links)
    weight = rope.density * np.pi * rope.radius**2 * GRAVITY
    assert rope.joint_stiffness * rope.link_length / weight == pytest.approx(0.07**3)
    assert rope.bending_length == pytest.approx(0.07)
    assert weight == pytest.approx(NOMINAL.density * np.pi * NOMINAL.radius**2 * GRAVITY)


def test_links_are_few_kinds_and_no_shorter_than_the_rope_is_thick():
    thick = np.geomspace(1 / 500, 1 / 20, 200)
    links = [usual_links(one) for one in thick]
    assert set(links) == {16, 24, 32, 40, 48}
    assert links == sorted(links, reverse=True)
    assert all(1 / many >= 1.2 * one for many, one in zip(links, thick, strict=True))


def test_drawn_ropes_fill_their_range(rng):
    config = ProportionsConfig(1 / 100, 1 / 50, 0.02, 0.03)
    drawn = draw_ropes(300, rng, config)
    for values, low, high in (
        ([2 * rope.radius for rope in drawn], 1 / 100, 1 / 50),
        ([rope.bending_length for rope in drawn], 0.02, 0.03),
    ):
        assert low <= min(values) < 1.02 * low and high / 1.02 < max(values) <= high


@pytest.mark.parametrize("links", [16, 40])
def test_adapted_model_is_the_one_that_is_built(links, rng):
    before, after = (rope_of(0.01, 0.04, links), perturb_rope(rope_of(0.02, 0.1, links), 2, rng))
    after.joint_armature *= 3
    adapted = adapt_model(build_model(before, 0.02, 0.04), before, after)
    built = build_model(after, 0.02, 0.04)
    for name in OF_ROPE:
        np.testing.assert_allclose(
            getattr(adapted, name), getattr(built, name), rtol=1e-10, atol=1e-15, err_msg=name
        )


def test_a_rope_in_a_world_moves_as_one_of_its_own(simulator, rng):
    other = rope_of(0.012, 0.06, NOMINAL.links)
    points, splines = random_trials(other, 3, rng)
    alone = RopeSimulator(SimulationConfig(rope=other)).execute(points, splines)
    controls = control_points(points, splines, other.radius)
    among = simulator.execute(points, splines, [World(other)] * 3, controls)
    np.testing.assert_allclose(among.end_points, alone.end_points, atol=2e-3)


def assert_alike(given, named):
    for field in fields(RopeConfig):
        assert getattr(given, field.name) == pytest.approx(getattr(named, field.name), rel=1e-3)


@pytest.mark.parametrize("name", ["thin", "thick", "soft", "stiff"])
def test_ropes_of_the_configuration_have_the_proportions_they_name(name):
    text = (CONF / f"{name}.yaml").read_text()
    diameter, bending = map(float, re.search(r"rope_of\((.*?), (.*?)\)", text).groups())
    assert_alike(RopeConfig(**yaml.safe_load(text)), rope_of(diameter, bending))


@pytest.mark.parametrize(
    ("name", "size"), [("bowline", (0.008 / 1.5, 0.04)), ("goals_long_rope", (0.005, 0.02165))]
)
def test_ropes_of_workflows_have_the_proportions_they_name(name, size):
    stages = yaml.safe_load((WORKFLOWS / f"{name}.yaml").read_text())["stages"]
    ropes = [one["simulation"]["rope"] for one in stages.values() if "simulation" in one]
    assert len(ropes) > 1  # what searches and what simulates again
    for rope in ropes:
        assert_alike(RopeConfig(**rope), rope_of(*size))
