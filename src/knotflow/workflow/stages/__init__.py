"""The stages of knotflow: thin adapters from typed configuration and files to the packages.

Importing this package registers them all.
"""

from knotflow.workflow.stages import (
    benchmark,
    causal_infogan,
    causal_infogan_ends,
    causal_infogan_plans,
    demonstrations,
    demonstrator,
    evaluation,
    exemplars,
    imitation,
    overhand,
    plans,
    plans_pull,
    plans_shown,
    plans_tables,
    pools,
    proposals,
    reinforcement,
    roots,
    self_play,
    shipped,
    starts,
    success_rates,
)

__all__ = [
    "benchmark",
    "causal_infogan",
    "causal_infogan_ends",
    "causal_infogan_plans",
    "demonstrations",
    "demonstrator",
    "evaluation",
    "exemplars",
    "imitation",
    "overhand",
    "plans",
    "plans_pull",
    "plans_shown",
    "plans_tables",
    "pools",
    "proposals",
    "reinforcement",
    "roots",
    "self_play",
    "shipped",
    "starts",
    "success_rates",
]
