"""The sections of the report, one an experiment."""

from __future__ import annotations

from functools import partial

from knotflow.report import (
    actions,
    branches,
    causal_infogan,
    demonstration_quality,
    execution,
    knots,
    perception,
    robustness,
    ropes,
    single_stage,
    training,
)
from knotflow.report import markdown as md
from knotflow.report.results import NotMeasured, Results, read_table
from knotflow.report.section import Figures, Parts, Section

ROWS_SHOWN = 20
"""Of the tables of an experiment without a body of its own."""


def plain(experiment: str, results: Results, _: Figures) -> Parts:
    """Every table of an experiment."""
    found = results.measured(experiment)
    if not found:
        raise NotMeasured(f"needs tables in {experiment}")
    tables = []
    for path in found.tables:
        table = read_table(path, may_be_empty=True)
        rows = table.head(ROWS_SHOWN).to_dict("records")
        more = f", the first {len(rows)} of {len(table)} rows" if len(table) > len(rows) else ""
        tables.append(md.table(rows, f"**{path.name}**{more}:"))
    return {"tables": md.join(*tables)}


PAPER = (
    Section("overhand", knots.overhand),
    Section("demonstrator", ropes.demonstrations),
    Section("single_stage", single_stage.single_stage, single_stage.SINGLE_STAGE_CLAIMS),
    Section("tree_size", branches.tree_size, branches.SIZE_CLAIMS),
    Section("ablation_actor_critic", single_stage.ablation, single_stage.ABLATION_CLAIMS),
    Section("joint_finetuning", branches.joint_finetuning, branches.JOINT_CLAIMS),
    Section("causal_infogan", causal_infogan.causal_infogan, causal_infogan.CLAIMS),
    Section("pentagram", knots.pentagram, (knots.PENTAGRAM_CLAIM,)),
)
"""In the order of the paper. To add one: write its parts, and its words in sections.md."""
FURTHER = (
    Section("demonstration_quality", demonstration_quality.demonstration_quality),
    Section("learning_options", single_stage.options),
    Section("library_training", training.library),
    Section("knots", knots.knots),
    Section("bowline", knots.bowline),
    Section("goals", knots.goals),
    Section("goals_long_rope", knots.long_rope),
    Section("published_goals", knots.published_goals),
    Section("goals_ablation", knots.ablation),
    Section("actions", actions.actions),
    Section("robustness", robustness.robustness),
    Section("ropes", robustness.lab_ropes),
    Section("perception", perception.perception),
    Section("real_images", perception.real_images),
    Section("strand_training", partial(training.network, "strand_training")),
    Section("tracking", perception.tracking),
    Section("dynamics", perception.dynamics),
    Section("dynamics_training", partial(training.network, "dynamics_training")),
    Section("closed_loop", execution.closed_loop),
    Section("closed_loop_ablation", execution.ablation),
    Section("arm", execution.arm),
    Section("benchmark", partial(plain, "benchmark")),
)
SECTIONS = {section.experiment: section for section in PAPER + FURTHER}
CLAIMS = [(section, claim) for section in SECTIONS.values() for claim in section.claims]
