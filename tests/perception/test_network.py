"""The network's proposals: they turn with the image, and outlive a file."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from knotflow.perception.camera.image import RgbdImage
from knotflow.perception.estimation.evidence import observe
from knotflow.perception.estimation.skeleton import TraceError
from knotflow.perception.networks.network import CoarseToFine, Network, NetworkError
from knotflow.perception.networks.patches import crop_rope
from knotflow.simulation import RopeConfig

from .shapes import CAMERA, ROPE, bare, image, loop, nodes_in, s_curve, target
from .test_training import TINY


def knowing(points: np.ndarray, off: float = 0.0, looks: bool = False) -> Network:
    """An untrained network that proposes a shape, `off` metres aside, whatever it sees; or, if it
    `looks`, one near it that depends on what it sees."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        network = Network(CoarseToFine(TINY))
    patch, _ = crop_rope(target(points), TINY.size)
    nodes = torch.as_tensor(nodes_in(patch, points), dtype=torch.float32)
    nodes[:, 1] += off / patch.half
    nodes[:, 2] -= 1
    last = network.model.coarse[-1]
    coarse = torch.cat([nodes[::10], torch.zeros(5, TINY.width)], dim=1)
    with torch.no_grad():
        last.weight.mul_(0.5 if looks else 0.0)
        last.bias.copy_(coarse.flatten())
    return network


def shape_error(points: np.ndarray, truth: np.ndarray) -> float:
    """Mean distance of vertices, from the nearer end, metres."""
    return min(np.linalg.norm(points[::way] - truth, axis=1).mean() for way in (1, -1))


@pytest.fixture
def network() -> Network:
    return knowing(s_curve(), looks=True)


@pytest.mark.parametrize(
    ("turn", "world"),
    [(np.s_[::-1, ::-1], [-1, -1, 1]), (np.s_[:, ::-1], [-1, 1, 1]), (np.s_[::-1], [1, -1, 1])],
    ids=["half a turn", "mirrored", "upside down"],
)
def test_guess_is_equivariant(network, turn, world):
    picture = image(loop(1) + [0.1, 0.05, 0])
    turned = RgbdImage(picture.rgb[turn].copy(), picture.depth[turn].copy())
    points, other = (network.guesses(observe(one, CAMERA, ROPE))[0] for one in (picture, turned))
    assert other == pytest.approx(points * world, abs=1e-3)


def test_guess_has_the_rope_length(network):
    rope = RopeConfig(links=30)
    points = network.guesses(replace(target(loop(1)), rope=rope))[0]
    assert points.shape == (31, 3)
    assert np.linalg.norm(np.diff(points, axis=0), axis=1) == pytest.approx(rope.link_length)


def test_best_mirror_image_comes_first():
    points = s_curve()
    guesses = knowing(points * [1, -1, 1]).guesses(target(points))
    assert len(guesses) == 4
    assert shape_error(guesses[0], points) < 0.02
    assert shape_error(guesses[0] * [1, -1, 1], points) > 0.05


@pytest.mark.parametrize("half", [False, True])
def test_save_load_round_trip(network, tmp_path, half):
    network.save(tmp_path / "network.safetensors", half)
    loaded = Network.load(tmp_path / "network.safetensors")
    asked = target(s_curve())
    for one, other in zip(network.guesses(asked), loaded.guesses(asked), strict=True):
        assert one == pytest.approx(other, abs=5e-3 if half else 1e-9)


def test_saved_bytes_depend_on_the_network_alone(network, tmp_path):
    files = [tmp_path / f"{number}.safetensors" for number in range(5)]
    for file in files:
        network.save(file)
    assert len({file.read_bytes() for file in files}) == 1


def test_the_network_is_small(tmp_path):
    Network(CoarseToFine()).save(tmp_path / "network.safetensors")
    assert (tmp_path / "network.safetensors").stat().st_size < 2e6


def test_invalid_network_files_raise(tmp_path):
    with pytest.raises(NetworkError, match="perception_training"):
        Network.load(tmp_path / "none.safetensors")
    from safetensors.torch import save_file

    save_file({"weights": torch.zeros(1)}, tmp_path / "other.safetensors", {"format": "songs"})
    with pytest.raises(NetworkError, match="songs"):
        Network.load(tmp_path / "other.safetensors")


def test_guesses_without_rope_raise(network):
    with pytest.raises(TraceError):
        network.guesses(bare())
