"""The tables that speak of all experiments: claims, what was run, commands, and time."""

from __future__ import annotations

from collections import Counter
from typing import Any

from knotflow.report import figures, tables
from knotflow.report.claims import CLAIMS
from knotflow.report.results import Experiment, Results, Stage
from knotflow.report.sections import Pictures, Section
from knotflow.report.verdict import Verdict

#: Stages in the figure; the table beside it has all.
STAGES_DRAWN = 15

TALLY = (
    (Verdict.HOLDS, "holds", "hold"),
    (Verdict.PARTLY, "holds partly", "hold partly"),
    (Verdict.FAILS, "does not hold", "do not hold"),
    (Verdict.NOT_RUN, "was not run yet", "were not run yet"),
)


def claims(results: Results) -> dict[str, str]:
    """The table of claims, and how many of them hold."""
    lines = []
    tally: Counter[Verdict] = Counter()
    for claim in CLAIMS:
        outcome = claim.outcome(results)
        found = results.experiments.get(claim.experiment)
        tally[outcome.verdict] += 1
        verdict = f"**{outcome.verdict}**"
        if outcome.verdict is not Verdict.NOT_RUN and found and found.budget != "paper":
            verdict += f" ({found.budget or 'unknown'} run)"
        ours = outcome.ours or tables.NOTHING
        where = claim.where.replace(", ", ",<br>").replace(" ", "\u00a0").replace("-", "\u2011")
        lines.append([claim.statement, where, claim.paper, ours, verdict])
    header = ["claim", "where", "paper", "ours, 95 % intervals", "verdict"]
    told = [
        f"{tally[verdict]} {one if tally[verdict] == 1 else many}"
        for verdict, one, many in TALLY
        if tally[verdict]
    ]
    return {
        "claims": tables.markdown_table(header, lines),
        "tally": f"Of {len(CLAIMS)} claims: {tables.listed(told)}.",
    }


def commit(found: Experiment) -> str:
    """The commit as a reader needs it: short, and marked where there was more than it."""
    known = f"`{found.commit[:10]}`" if found.commit else "unknown"
    return f"{known} with uncommitted changes" if found.dirty else known


def experiments(results: Results, sections: list[Section], anchors: dict[str, str]) -> str:
    """A line for each experiment: where in the paper, run or not, with what."""
    lines = []
    for section in sections:
        found = results.experiments.get(section.experiment)
        name = f"[{section.title}](#{anchors[section.title]})"
        if found is None or not found.measured:
            state = [str(Verdict.NOT_RUN), tables.NOTHING, tables.NOTHING]
        else:
            state = ["run", f"`{found.budget}`", commit(found)]
        lines.append([name, section.paper, *state])
    return tables.markdown_table(["experiment", "paper", "state", "budget", "commit"], lines)


def commands(results: Results, sections: list[Section]) -> str:
    """The command of each experiment that was run, and of this report."""
    lines = [
        [section.title, f"`{section.command}`"]
        for section in sections
        if (found := results.experiments.get(section.experiment)) and found.measured
    ]
    lines.append(["This report", "`python -m knotflow.report`"])
    return tables.markdown_table(["what", "command"], lines)


def timing(results: Results, pictures: Pictures) -> dict[str, Any]:
    """Every stage once, with its time; the longest as a figure."""
    seen: dict[str, tuple[str, Stage]] = {}
    for name, found in results.experiments.items():
        for stage in found.stages:
            key = stage.signature or f"{name}/{stage.node}"
            # The experiment that made it knows the time best; the others found it there.
            if key not in seen or (seen[key][1].shared and not stage.shared):
                seen[key] = (name, stage)
    lines = [
        [name, f"`{stage.node}`", stage.caption or tables.NOTHING, tables.duration(stage.seconds)]
        for name, stage in seen.values()
    ]
    timed = [stage for _, stage in seen.values() if stage.seconds is not None]
    longest = sorted(timed, key=lambda stage: -(stage.seconds or 0.0))[:STAGES_DRAWN]
    figure = pictures.add(figures.stage_seconds(longest, "stages")) if len(longest) > 1 else ""
    header = ["experiment", "stage", "what it makes", "time"]
    return {
        "figure": figure,
        "shown": len(longest),
        "total": tables.duration(sum(stage.seconds or 0.0 for stage in timed)),
        "count": len(seen),
        "table": tables.markdown_table(header, lines, "lllr") if lines else "",
    }
