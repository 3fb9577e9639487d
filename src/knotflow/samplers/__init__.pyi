from .demonstrations.heuristic import AimedSampler
from .icp import IcpConfig, IcpSampler
from .random import RandomSampler
from .sampler import Sampler, SamplerConfig, build_sampler, sampler

__all__ = [
    "AimedSampler", "IcpConfig", "IcpSampler", "RandomSampler", "Sampler", "SamplerConfig",
    "build_sampler", "sampler",
]  # fmt: skip
