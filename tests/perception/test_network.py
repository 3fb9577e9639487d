"""The strand network and its file."""

import pytest
import torch

from knotflow.perception.networks.network import NetworkError, StrandNetwork, StrandNetworkConfig
from knotflow.perception.networks.windows import HEADINGS, SIDE

TINY = StrandNetworkConfig(channels=(4, 8, 8), width=16)


@pytest.fixture
def network() -> StrandNetwork:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        return StrandNetwork(TINY)


def test_network_output_is_normalised(network):
    found = network(torch.rand(3, 5, SIDE, SIDE), torch.ones(3))
    assert found.heading.shape == (3, HEADINGS)
    assert found.heading.exp().sum(1).tolist() == pytest.approx([1, 1, 1], abs=1e-5)
    assert found.height.shape == found.end.shape == (3,)


@pytest.mark.parametrize("half", [False, True])
def test_save_load_round_trip(network, tmp_path, half):
    network.save(tmp_path / "network.safetensors", half)
    loaded = StrandNetwork.load(tmp_path / "network.safetensors")
    assert loaded.config == TINY
    for name, one in network.state_dict().items():
        other = loaded.state_dict()[name]
        assert torch.allclose(one.float(), other.float(), atol=1e-3 if half else 0), name


def test_saved_bytes_depend_on_the_network_alone(network, tmp_path):
    files = [tmp_path / f"{number}.safetensors" for number in range(5)]
    for file in files:
        network.save(file)
    assert len({file.read_bytes() for file in files}) == 1


def test_the_network_is_small(tmp_path):
    StrandNetwork().save(tmp_path / "network.safetensors")
    assert (tmp_path / "network.safetensors").stat().st_size < 1e6


def test_invalid_network_files_raise(network, tmp_path):
    with pytest.raises(NetworkError, match="strand_training"):
        StrandNetwork.load(tmp_path / "none.safetensors")
    from safetensors.torch import load_file, save_file

    save_file({"weights": torch.zeros(1)}, tmp_path / "other.safetensors", {"format": "songs"})
    with pytest.raises(NetworkError, match="songs"):
        StrandNetwork.load(tmp_path / "other.safetensors")
    network.save(tmp_path / "network.safetensors")
    weights = load_file(tmp_path / "network.safetensors")
    StrandNetwork().save(tmp_path / "network.safetensors")
    from safetensors import safe_open

    with safe_open(tmp_path / "network.safetensors", "pt") as file:
        save_file(weights, tmp_path / "mixed.safetensors", file.metadata())
    with pytest.raises(NetworkError, match="do not fit"):
        StrandNetwork.load(tmp_path / "mixed.safetensors")
