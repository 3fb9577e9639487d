"""The report as a whole: report.md and its figures."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

from knotflow.report import (
    ablation_actor_critic,
    actions,
    causal_infogan,
    execution,
    goals,
    joint_finetuning,
    knots,
    perception,
    ropes,
    single_stage,
    timing,
    tracking,
    training,
    tree_size,
)
from knotflow.report import markdown as md
from knotflow.report.results import Results, read_table
from knotflow.report.section import Figures, Section, Verdict
from knotflow.statistics import RESAMPLES

TEMPLATE = Path(__file__).with_name("report.md")
ROWS_SHOWN = 20
"""Of the tables of an experiment without a body of its own."""


def plain(experiment: str) -> Callable[[Results, Figures], str | None]:
    """The body of a section that shows every table of an experiment."""

    def body(results: Results, _: Figures) -> str | None:
        found = results.measured(experiment)
        parts = []
        for path in found.tables if found else ():
            table = read_table(path)
            rows = table.head(ROWS_SHOWN).to_dict("records")
            more = f", the first {len(rows)} of {len(table)} rows" if len(table) > len(rows) else ""
            parts.append(md.table(rows, f"**{path.name}**{more}:"))
        return md.join(*parts) or None

    return body


PAPER: tuple[Section, ...] = (
    knots.OVERHAND,
    ropes.DEMONSTRATIONS,
    single_stage.SECTION,
    tree_size.SECTION,
    ablation_actor_critic.SECTION,
    joint_finetuning.SECTION,
    causal_infogan.SECTION,
    knots.PENTAGRAM,
)
"""In the order of the paper. To add one: write a module with a `Section`, and put it here, or below
if the paper lacks it."""
FURTHER: tuple[Section, ...] = (
    training.LIBRARY,
    knots.KNOTS,
    goals.GOALS,
    goals.ABLATION,
    actions.SECTION,
    perception.SECTION,
    training.PERCEPTION,
    training.STRANDS,
    tracking.TRACKING,
    tracking.DYNAMICS,
    training.DYNAMICS,
    execution.SECTION,
    execution.PARTS,
    execution.ARM,
    Section(
        "benchmark",
        "Simulator throughput",
        "beyond the paper",
        "Splines executed per second, from start to finish, and the memory it takes.",
        plain("benchmark"),
    ),
)
SECTIONS = PAPER + FURTHER
CLAIMS = [(section, claim) for section in SECTIONS for claim in section.claims]
PLURAL = dict(zip(Verdict, ("hold", "hold partly", "do not hold", "were not run"), strict=True))

NOT_RUN = """
> **Nothing has been run yet.** This runs a chain on small counts in about two minutes, and then
> this report again:
>
> ```
> python -m knotflow +experiment=single_stage budget=smoke
> python -m knotflow.report
> ```
"""


def make(results_folder: Path, out: Path) -> list[Path]:
    """Write report.md and figures/ into `out`, from `results_folder` alone.

    The same results give the same bytes. Nothing is written before everything could be made.

    Returns:
        The written files, report.md first.

    Raises:
        ResultsError: a table is not what the report expects; an earlier report stays as it was.
    """
    results = Results(results_folder)
    figures = Figures(results, Path(os.path.relpath(results_folder, out)).as_posix())
    written = {out / "report.md": compose(results, figures).encode()}
    folder = out / "figures"
    written |= {folder / f"{name}.png": png for name, png in figures.made.items()}
    folder.mkdir(parents=True, exist_ok=True)
    for old in set(folder.iterdir()) - written.keys():
        old.unlink()
    for path, content in written.items():
        path.write_bytes(content)
    return list(written)


def compose(results: Results, figures: Figures) -> str:
    """The whole report as Markdown; its figures are kept in `figures`."""
    further = [*FURTHER, *_others(results)]
    sections = [*PAPER, *further]
    found = {section.title: results.measured(section.experiment) for section in sections}
    smaller = [title for title, one in found.items() if one and one.budget != "paper"]
    rope = results.setting("single_stage", "rope") or {"length": 1.0, "radius": 0.008, "links": 40}
    bias = results.setting("tree_size", "bias")
    crossings = results.setting("joint_finetuning", "most_crossings", "self_play")
    arranging = results.setting("single_stage", "arranging", "reinforcement_arranged")
    text = TEMPLATE.read_text("utf-8").format(
        link=figures.link,
        notices=md.join(
            "" if any(found.values()) else NOT_RUN,
            f"> **Not the paper's counts.** {md.listed(smaller)} ran with a smaller budget: the "
            "numbers show that the chain works from end to end and decide no claim."
            if smaller
            else "",
        ),
        claims=_claims(results),
        overview=_overview(results, sections),
        paper=md.join(*(_section(section, results, figures) for section in PAPER)),
        further=md.join(*(_section(section, results, figures) for section in further)),
        timing=timing.timing(results, figures),
        rope=f"{rope['length']:g} m long, {1000 * rope['radius']:g} mm in radius, "
        f"{rope['links']} links",
        bias=f"{bias:g} times likelier" if bias else "likelier",
        crossings=f" that lead to at most {crossings} crossings" if crossings else "",
        arranging=f"up to {arranging}" if arranging else "some",
        resamples=f"{RESAMPLES:,}",
    )
    text = re.sub(r"\n{3,}", "\n\n", text)
    return re.sub(r"(?<=\d) (?=[%×])", "\u00a0", text)  # no line ends between number and unit


def _claims(results: Results) -> str:
    """How many claims hold, the table of them, why others do not, and the criteria."""
    rows, reasons = [], []
    tally: Counter[Verdict] = Counter()
    direction_only = 0
    for section, claim in CLAIMS:
        outcome = claim.judgement(results)
        found = results.measured(section.experiment)
        tally[outcome.verdict] += 1
        verdict = f"**{outcome.verdict}**"
        if outcome.verdict is not Verdict.NOT_RUN and found:
            verdict += "" if found.budget == "paper" else f" ({found.budget} run)"
            verdict += "<br>stale" if found.stale else ""
        if outcome.size:
            verdict += f"<br>the direction holds, the size does not: {outcome.size}"
            direction_only += 1
        rows.append(
            {
                "claim": claim.statement,
                "where": section.paper,
                "paper": claim.paper,
                "ours, 95 % intervals": outcome.ours,
                "verdict": verdict,
            }
        )
        unclear = outcome.verdict in (Verdict.PARTLY, Verdict.FAILS) or outcome.size
        if unclear and (reason := claim.reason(results)):
            reasons.append(f"- [{claim.statement}](#{md.slug(section.title)}): {reason}.")
    counts = md.listed([f"{tally[one]} {PLURAL[one]}" for one in Verdict if tally[one]])
    size = f" For {direction_only} the direction holds and the size does not."
    return md.join(
        f"Of {len(CLAIMS)} claims, {counts}.{size if direction_only else ''}",
        md.table(rows),
        "Where a claim does not wholly hold, our tables show why:" if reasons else "",
        "\n".join(reasons),
        "Criteria (*significantly* means that the whole 95 % interval lies on that side):",
        "\n".join(f"- {claim.statement}: holds if {claim.criterion}." for _, claim in CLAIMS),
    )


def _overview(results: Results, sections: Sequence[Section]) -> str:
    """A line for each experiment: its name, where in the paper, and what made it."""
    rows = []
    for section in sections:
        found = results.measured(section.experiment)
        stale = found and found.stale
        rows.append(
            {
                "section": f"[{section.title}](#{md.slug(section.title)})",
                "experiment": f"`{section.experiment}`",
                "paper": section.paper,
                "state": f"stale: {stale}" if stale else "current" if found else Verdict.NOT_RUN,
                "budget": found.budget if found else md.NOTHING,
                "commits": found.commits if found else md.NOTHING,
            }
        )
    return md.table(rows)


def _section(section: Section, results: Results, figures: Figures) -> str:
    body = section.body(results, figures)
    title = f"### {section.title}"
    if body is None:
        return md.join(
            title,
            section.about,
            f"**Not run** ({section.paper}; its experiment is `{section.experiment}`).",
        )
    found = results.experiments[section.experiment]
    recordings = [
        f"[`{path.relative_to(found.folder).as_posix()}`]"
        f"({figures.link}/{path.relative_to(results.root).as_posix()})"
        for path in sorted(found.folder.rglob("*.mcap"))
    ]
    return md.join(
        title,
        section.about,
        f"{section.paper} · `+experiment={section.experiment}` · budget `{found.budget}` · "
        f"[tables and configuration]({figures.link}/{section.experiment})"
        + (" · stale" if found.stale else ""),
        ""
        if found.budget == "paper"
        else f"> **{found.budget.capitalize()} run.** These are not the paper's counts.",
        body,
        f"Recordings, for `knotflow view`: {', '.join(recordings)}." if recordings else "",
    )


def _others(results: Results) -> list[Section]:
    """Experiments of one's own: measured, and neither of the paper's nor another run of one that
    has a section, such as a plan for another knot."""
    known = {section.experiment for section in SECTIONS}
    return [
        Section(name, name.replace("_", " ").capitalize(), "beyond the paper", "", plain(name))
        for name, found in results.experiments.items()
        if found.tables
        and name not in known
        and (found.run.get("workflow") or found.config.get("workflow")) not in known
    ]
