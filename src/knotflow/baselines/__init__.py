"""Baselines of Sec. VII, each a sampler."""

from knotflow.baselines.icp import IcpConfig, IcpSampler
from knotflow.baselines.random import RandomConfig, RandomSampler

__all__ = ["IcpConfig", "IcpSampler", "RandomConfig", "RandomSampler"]
