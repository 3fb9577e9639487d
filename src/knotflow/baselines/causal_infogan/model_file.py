"""A trained model on disk: weights, and what is needed to build the networks again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import torch

from knotflow.baselines.causal_infogan.config import CausalInfoGanConfig
from knotflow.baselines.causal_infogan.networks import CausalInfoGan, Scale


def save_model(path: Path, model: CausalInfoGan, actions: Sequence[str]) -> None:
    """Write a model that was trained on rollouts of the given actions, such as "C(0,1,1)"."""
    content = {
        "config": asdict(model.config),
        "vertices": model.vertices,
        "actions": list(actions),
        "weights": model.state_dict(),
    }
    torch.save(content, path)


def load_model(path: Path) -> tuple[CausalInfoGan, list[str]]:
    """What `save_model` wrote: the model, in evaluation mode, and its actions."""
    content = torch.load(path, weights_only=True)
    # The real scale is among the weights; each buffer needs a memory of its own.
    scale = Scale(torch.ones(3), torch.ones(3), torch.ones(3), torch.ones(()))
    model = CausalInfoGan(CausalInfoGanConfig(**content["config"]), scale, content["vertices"])
    model.load_state_dict(content["weights"])
    return model.eval(), content["actions"]
