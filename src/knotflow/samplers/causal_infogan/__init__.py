"""The third baseline: Causal InfoGAN (Kurutach et al. 2018) on rope shapes (Sec. VII-C, Fig. 8).

A generative-adversarial network makes pairs of consecutive rope shapes from codes that follow a
Gaussian transition. A plan is a straight line in the code space between the projections of a given
start and a given end shape, decoded into rope shapes. It is no sampler: it wants the end shape,
and returns shapes but no robot motion.

What needs torch is imported from where it is: `health.Checkup`,
`networks.save_model` and `load_model`, `planning.Planner`.
"""

from knotflow.samplers.causal_infogan.config import CausalInfoGanBudget, CausalInfoGanConfig
from knotflow.samplers.causal_infogan.frame import DemonstratedRollouts, StartFrame, frames_at
from knotflow.samplers.causal_infogan.measures import PlanMeasures, measure

__all__ = [
    "CausalInfoGanBudget",
    "CausalInfoGanConfig",
    "StartFrame",
    "PlanMeasures",
    "DemonstratedRollouts",
    "frames_at",
    "measure",
]
