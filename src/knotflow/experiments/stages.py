"""Importing this module registers every stage."""

from knotflow.experiments import (
    actions,
    arm,
    benchmark,
    causal_infogan,
    closed_loop,
    demonstrations,
    dynamics,
    overhand,
    perception,
    searches,
    single_stage,
    tracking,
    training,
)

__all__ = [
    "actions",
    "arm",
    "benchmark",
    "causal_infogan",
    "closed_loop",
    "demonstrations",
    "dynamics",
    "overhand",
    "perception",
    "searches",
    "single_stage",
    "tracking",
    "training",
]
