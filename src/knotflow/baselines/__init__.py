"""Baselines of Sec. VII, each a sampler."""

from knotflow.baselines.aimed import AimedConfig, AimedSampler
from knotflow.baselines.icp import IcpConfig, IcpSampler
from knotflow.baselines.random import RandomConfig, RandomSampler

__all__ = [
    "AimedConfig",
    "AimedSampler",
    "IcpConfig",
    "IcpSampler",
    "RandomConfig",
    "RandomSampler",
]
