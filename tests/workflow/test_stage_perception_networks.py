"""A network learns from images alone; without weights nothing is made."""

import numpy as np
import pandas as pd
import pytest
import torch

from knotflow.perception import Network, NetworkError, SelfSupervisionConfig
from knotflow.perception.coarse_to_fine import CoarseToFine
from knotflow.perception.methods import SELF_SUPERVISED, SUPERVISED
from knotflow.perception.training_config import SHIPPED_NETWORK, CoarseToFineConfig
from knotflow.simulation import RopeConfig, random_curve
from knotflow.workflow import StageContext
from knotflow.workflow.stages import perception_networks
from knotflow.workflow.stages.perception_networks import (
    PerceptionNetworksConfig,
    adapt_networks,
    load_networks,
)
from knotflow.workflow.stages.ropes import FILE as ROPES


@pytest.fixture
def ropes(tmp_path):
    folder = tmp_path / "ropes"
    folder.mkdir()
    rng = np.random.default_rng(0)
    points = np.stack([random_curve(RopeConfig(), rng) for _ in range(2)])
    np.savez(folder / ROPES, points=points, crossings=[0, 0])
    return {"ropes": folder}


def config(file):
    return PerceptionNetworksConfig(
        network=str(file),
        network_contents="",
        images=2,
        learning=SelfSupervisionConfig(steps=2, batch=2),
        seed=1,
    )


def test_the_network_is_kept_as_it_was_and_as_it_learned(ropes, tmp_path):
    file, out = tmp_path / "given.safetensors", tmp_path / "out"
    Network(CoarseToFine(CoarseToFineConfig(32, (8, 16, 16), (5, 9, 41), 16, 1))).save(file)
    adapt_networks(config(file), ropes, StageContext(out))
    networks = load_networks(out)
    given = Network.load(file).model.state_dict()
    before, after = (networks[name].model.state_dict() for name in (SUPERVISED, SELF_SUPERVISED))
    assert all(torch.equal(one, given[name]) for name, one in before.items())
    assert not all(torch.equal(one, given[name]) for name, one in after.items())
    losses = pd.read_csv(out / "losses.csv")
    assert len(losses) == 2 and np.isfinite(losses["loss"]).all()


def test_while_no_weights_are_shipped_nothing_is_made(ropes, tmp_path, monkeypatch, capsys):
    nowhere = tmp_path / SHIPPED_NETWORK.name
    monkeypatch.setattr(perception_networks, "SHIPPED_NETWORK", nowhere)
    adapt_networks(config(nowhere), ropes, StageContext(tmp_path / "out"))
    assert load_networks(tmp_path / "out") == {}
    assert "no network is shipped yet" in capsys.readouterr().out


def test_weights_that_are_given_must_be_there(ropes, tmp_path):
    with pytest.raises(NetworkError, match=r"mine\.safetensors"):
        adapt_networks(config(tmp_path / "mine.safetensors"), ropes, StageContext(tmp_path / "out"))
