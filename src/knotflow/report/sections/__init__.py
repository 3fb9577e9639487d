"""The report's sections, one module for each, in the order of the paper.

To add one: write `sections/<experiment>.py` with a `SECTION` and `templates/<experiment>.md.j2`
with its words, and put it into SECTIONS in place of its `plain` entry.
"""

from __future__ import annotations

from knotflow.report.sections import (
    ablation_actor_critic,
    benchmark,
    causal_infogan,
    joint_finetuning,
    knots,
    overhand,
    pentagram,
    single_stage,
    tree_size,
)
from knotflow.report.sections.plain import plain
from knotflow.report.sections.section import Pictures, Section

SECTIONS: tuple[Section, ...] = (
    overhand.SECTION,
    single_stage.SECTION,
    tree_size.SECTION,
    ablation_actor_critic.SECTION,
    joint_finetuning.SECTION,
    causal_infogan.SECTION,
    plain(
        "closed_loop",
        "Execution in closed loop",
        "Sec. VI and VII-D",
        "Plans executed with tracking and model predictive control, here in simulation.",
    ),
    pentagram.SECTION,
    knots.SECTION,
    benchmark.SECTION,
)

__all__ = ["SECTIONS", "Pictures", "Section", "plain"]
