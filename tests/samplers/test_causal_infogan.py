"""Causal InfoGAN: its ropes keep their length, its plans are sound."""

import numpy as np
import pytest
import torch

from knotflow.samplers.causal_infogan.data import CausalInfoGanConfig
from knotflow.samplers.causal_infogan.networks import Checkup, load_model, save_model
from knotflow.samplers.causal_infogan.planning import Planner
from knotflow.simulation import RopeConfig, arc
from knotflow.threads import one_thread
from knotflow.training.causal_infogan import CausalInfoGanTrainer

ROPE = RopeConfig(links=20)
SMALL = CausalInfoGanConfig(
    width=16,
    batch=16,
    prior_samples=64,
    restarts=2,
    projection_steps=60,
    candidates=4,
    steps=60,
    check_every=60,
)


@pytest.fixture(scope="module", autouse=True)
def single_thread():
    """Networks this small are slower on more."""
    with one_thread():
        yield


@pytest.fixture(scope="module")
def shapes():
    """(24, 4, V, 3): arcs that close slowly; 24 rollouts from four kinds of start."""
    bends = np.repeat(np.linspace(0.5, 3.0, 4), 6) + np.linspace(0, 0.1, 24)
    return np.array([[arc(ROPE, bend + 0.2 * step) for step in range(4)] for bend in bends])


@pytest.fixture(scope="module")
def trained(shapes):
    trainer = CausalInfoGanTrainer(shapes, np.arange(24) // 6, SMALL, seed=1)
    list(trainer)
    return trainer


@pytest.mark.slow
@torch.no_grad()
def test_generated_ropes_have_links_of_the_right_length(trained):
    model = trained.model
    draws = model.draw(50, torch.Generator().manual_seed(3))[:3]
    for made in model.generator(*draws):
        assert made.shape == (50, 21, 3)
        lengths = torch.diff(made, dim=1).norm(dim=-1)
        assert torch.allclose(lengths, torch.tensor(ROPE.link_length), rtol=1e-3)


class Made:
    """A model that makes what it is told to and reads codes back perfectly, or not at all."""

    training = False

    def __init__(self, shapes, reads=True):
        self.shapes, self.reads = shapes, reads
        self.code = torch.linspace(-1, 1, len(shapes))[:, None]

    def train(self, mode=True):
        return self

    eval = train

    def draw(self, count, rng):
        return torch.zeros(count, 1), self.code, self.code, torch.ones(count, 1)

    def generator(self, noise, code, next_code):
        return self.shapes, self.shapes

    def posterior(self, points):
        mean = self.code if self.reads else torch.zeros_like(self.code)
        return mean, torch.ones_like(mean)


def test_a_generator_that_makes_the_data_is_sound(shapes):
    data = torch.tensor(shapes).float()
    checkup = Checkup(data, torch.arange(24) // 6)
    rollout = torch.arange(1000) % 24
    health = checkup(Made(data[rollout, 0]))
    assert health.collapsed == []
    assert health.spread == pytest.approx(1, abs=0.15)
    assert health.starts_covered == pytest.approx(1, abs=0.05)
    assert health.code_used == pytest.approx(1, abs=1e-5)


def test_each_way_to_collapse_is_told(shapes):
    data = torch.tensor(shapes).float()
    checkup = Checkup(data, torch.arange(24) // 6)
    everywhere = data[torch.arange(1000) % 24, 0]
    assert checkup(Made(everywhere, reads=False)).collapsed == ["code_used"]
    same = data[:1, 0].expand(1000, -1, -1)
    assert checkup(Made(same)).collapsed == ["spread", "starts_covered"]
    gone = torch.full_like(everywhere, torch.nan)
    assert "spread" in checkup(Made(gone)).collapsed


@pytest.mark.slow
def test_a_model_comes_back_from_its_file(trained, tmp_path):
    save_model(tmp_path / "model.pt", trained.model, ["C(0,1,1)"])
    model, actions = load_model(tmp_path / "model.pt")
    assert actions == ["C(0,1,1)"] and model.config == SMALL
    draws = model.draw(5, torch.Generator().manual_seed(0))[:3]
    trained.model.eval()
    with torch.no_grad():
        for one, other in zip(
            model.generator(*draws), trained.model.generator(*draws), strict=True
        ):
            assert torch.equal(one, other)


@pytest.mark.slow
def test_a_plan_joins_the_projections_in_the_world_frame(trained, shapes):
    moved = shapes[:3] + [0.3, -0.2, 0]
    plans = Planner(trained.model, seed=0).plan(moved[:, 0], moved[:, -1], steps=5)
    assert plans.way_points.shape == (3, 6, 21, 3)
    assert plans.projected_start.shape == plans.projected_end.shape == (3, 21, 3)
    here = Planner(trained.model, seed=0).plan(shapes[:3, 0], shapes[:3, -1], steps=5)
    assert np.allclose(plans.way_points - [0.3, -0.2, 0], here.way_points, atol=1e-4)


@pytest.mark.slow
def test_a_generated_shape_is_projected_onto_itself(trained):
    model = trained.model.eval()
    with torch.no_grad():
        draws = model.draw(4, torch.Generator().manual_seed(9))[:3]
        first, _second = (one.double().numpy() for one in model.generator(*draws))
    planner = Planner(model, seed=0)
    targets = torch.as_tensor(first).float()
    searched, _ = planner.project(targets, second=False)
    with torch.no_grad():
        drawn = model.draw(64, torch.Generator().manual_seed(1))[:3]
        best = torch.cdist(targets.flatten(1), model.generator(*drawn)[0].flatten(1)).amin(1)
    assert (searched - targets).flatten(1).norm(dim=1).mean() < 0.7 * best.mean()
