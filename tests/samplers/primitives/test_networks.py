from __future__ import annotations

import numpy as np
import pytest
import torch

from knotflow.samplers.primitives import Primitive, PrimitiveConfig, cross_entropy, encode
from knotflow.samplers.primitives.encoding import CONTROL_FEATURES, STREAM_POINTS
from knotflow.topology import parse_action


@pytest.fixture
def seen(ropes):
    actions = [parse_action("C(0,1,1)"), parse_action("C(0,2,1)")]
    return encode(np.stack([ropes["loop"]] * 2), actions)


def test_the_actor_gives_a_gaussian_no_narrower_than_its_floor(library, seen):
    actor = library.primitives[3].actor
    mean, factor = actor(seen.states)
    assert mean.shape == (2, 6) and factor.shape == (2, 6, 6)
    assert torch.equal(factor, factor.tril())
    assert (factor.diagonal(dim1=1, dim2=2) >= actor.smallest_spread).all()


def test_a_score_depends_on_its_own_rope_and_spline_only(library, seen):
    critic = library.primitives[3].critic
    splines = torch.randn(7, 6)
    owner = torch.tensor([0, 1, 1, 0, 1, 0, 0])
    together = critic(seen.states, splines, owner)
    alone = [critic(seen.states[o : o + 1], splines[i : i + 1], owner[:1]) for i, o in
             enumerate(owner.tolist())]  # fmt: skip
    torch.testing.assert_close(together, torch.cat(alone), atol=1e-5, rtol=1e-4)
    assert together.std() > 0


def test_streams_do_not_share_weights_and_all_of_them_matter(library, seen):
    trunk = library.primitives[3].critic.trunk
    streams = seen.states["streams"].clone().requires_grad_()
    trunk(streams)[0].sum().backward()
    assert (streams.grad.abs().amax(dim=(0, 2)) > 0).all()
    pointers = [parameter.data_ptr() for parameter in trunk.parameters()]
    assert len(set(pointers)) == len(pointers)


def test_what_lies_where_a_spline_passes_counts_more_than_what_is_far(library, seen):
    torch.manual_seed(1)
    passage = library.primitives[3].critic.passage
    states = seen.states[:1]
    streams = states["streams"].clone()
    points = streams[0, -STREAM_POINTS[-1] :, :2]
    near = points[5]
    far = (points - near).norm(dim=1).argmax()
    controls = torch.zeros(1, 1, CONTROL_FEATURES)
    for columns in ((7, 8), (1, 2), (4, 5)):  # a spline that stays at one place
        controls[0, 0, list(columns)] = near
    shape = (1, STREAM_POINTS[-1], passage.of_points.out_features)
    of_points = torch.randn(shape).requires_grad_()
    passage(of_points, streams, controls).sum().backward()
    felt = of_points.grad[0, :, -4:].norm(dim=1)
    assert felt[5] > 3 * felt[far] > 0


def test_the_search_climbs_a_known_hill_and_searches_are_distinct():
    target = torch.tensor([0.5, -0.3, 0.2, 0.0, 0.1, -0.4])
    noise = torch.randn(10, 3, 64, 6, generator=torch.Generator().manual_seed(0))
    found, best = cross_entropy(
        lambda splines: -(splines - target).square().sum(-1),
        torch.zeros(3, 6),
        torch.eye(6).expand(3, 6, 6),
        noise,
        elites=6,
    )
    torch.testing.assert_close(found, target.expand(3, 6), atol=0.1, rtol=0)
    assert (best > -0.05).all()
    assert len(found.unique(dim=0)) == 3


@pytest.mark.parametrize("variant", ["actor_critic", "actor_only", "critic_only"])
def test_every_variant_proposes_distinct_splines(seen, variant):
    torch.manual_seed(0)
    found, _ = Primitive(PrimitiveConfig(variant)).search(seen, 5, np.random.default_rng(0))
    assert found.shape == (2, 5, 6)
    assert len(found.reshape(-1, 6).unique(dim=0)) == 10


def test_an_unknown_variant_is_refused():
    with pytest.raises(ValueError, match="actor_critic, actor_only, critic_only"):
        PrimitiveConfig("critic")
