from .demonstrations.heuristic import AimedConfig, AimedSampler
from .icp import IcpConfig, IcpSampler
from .random import RandomConfig, RandomSampler
from .sampler import Sampler, SamplerConfig, build_sampler, sampler

__all__ = [
    "AimedConfig",
    "AimedSampler",
    "IcpConfig",
    "IcpSampler",
    "RandomConfig",
    "RandomSampler",
    "Sampler",
    "SamplerConfig",
    "build_sampler",
    "sampler",
]
