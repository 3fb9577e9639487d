"""The report as a whole: words and tables to Markdown, Markdown to one HTML page."""

from __future__ import annotations

import os
import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from knotflow.report import (
    ablation_actor_critic,
    actions,
    arm,
    benchmark,
    causal_infogan,
    closed_loop,
    demonstrator,
    dynamics,
    goals,
    goals_ablation,
    joint_finetuning,
    knots,
    overhand,
    pentagram,
    perception,
    roots,
    self_play,
    single_stage,
    tables,
    tracking,
    trainings,
    tree_size,
)
from knotflow.report.claims import Verdict
from knotflow.report.html import slug, to_html
from knotflow.report.results import ExperimentResults, Results
from knotflow.report.section import Pictures, Section, plain
from knotflow.report.statistics import RESAMPLES
from knotflow.report.style import Picture
from knotflow.report.timing import timing
from knotflow.report.weights import origins

#: In the order of the paper. To add one: write `<experiment>.py` with a `SECTION` and
#: `templates/<experiment>.md.j2` with its words, and put it here, or below if the paper lacks it.
PAPER: tuple[Section, ...] = (
    overhand.SECTION,
    demonstrator.SECTION,
    single_stage.SECTION,
    tree_size.SECTION,
    ablation_actor_critic.SECTION,
    joint_finetuning.SECTION,
    causal_infogan.SECTION,
    pentagram.SECTION,
)
#: What the paper has no figures of; of Sec. VI it describes the method.
FURTHER: tuple[Section, ...] = (
    self_play.SECTION,
    knots.SECTION,
    goals.SECTION,
    goals_ablation.SECTION,
    goals_ablation.HINDSIGHT,
    actions.SECTION,
    perception.SECTION,
    trainings.PERCEPTION,
    trainings.STRANDS,
    tracking.SECTION,
    dynamics.SECTION,
    trainings.DYNAMICS,
    closed_loop.SECTION,
    closed_loop.ABLATION,
    arm.SECTION,
    benchmark.SECTION,
    roots.SECTION,
)
SECTIONS = PAPER + FURTHER
CLAIMS = [(section.experiment, claim) for section in SECTIONS for claim in section.claims]

TALLY = (
    (Verdict.HOLDS, "holds", "hold"),
    (Verdict.PARTLY, "holds partly", "hold partly"),
    (Verdict.FAILS, "does not hold", "do not hold"),
    (Verdict.NOT_RUN, "was not run yet", "were not run yet"),
)
BEFORE = "What has been run"
"""The heading before which the contents stand: the first page is for the claims."""
TITLE = "Planning knots: paper and measurement"
RECORDINGS_SHOWN = 12
EARLIER = "by an earlier version"
"""Said of results whose packages behave otherwise by now."""


@dataclass(frozen=True)
class Report:
    """The finished report, not written yet."""

    markdown: str
    html: str
    pictures: list[Picture]


def make(results_folder: Path, out: Path) -> list[Path]:
    """Write report.md, index.html and figures/ into `out`, from `results_folder` alone.

    The same results give the same bytes. Nothing is written before everything could be made.

    Returns:
        The written files.

    Raises:
        ResultsError: a table is not what its contract says; an earlier report stays as it was.
    """
    link = Path(os.path.relpath(results_folder, out)).as_posix()
    report = compose(Results(results_folder), link)
    figures = out / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    written = {
        out / "report.md": report.markdown.encode(),
        out / "index.html": report.html.encode(),
    }
    for picture in report.pictures:
        written[figures / f"{picture.name}.png"] = picture.png
        written[figures / f"{picture.name}.svg"] = picture.svg
    for stale in {*figures.glob("*.png"), *figures.glob("*.svg")} - written.keys():
        stale.unlink()
    for path, content in written.items():
        path.write_bytes(content)
    return list(written)


def compose(results: Results, link: str) -> Report:
    """The whole report; `link` leads from it to the results folder."""
    templates = Environment(
        loader=PackageLoader("knotflow.report"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        autoescape=False,  # Markdown comes out; what goes in are our own tables
    )
    pictures = Pictures()
    further = [*FURTHER, *_others(results)]
    sections = [*PAPER, *further]
    in_paper, beyond = (
        [_section(templates, section, results, pictures, link) for section in part]
        for part in (PAPER, further)
    )
    smaller = [
        section.title
        for section in sections
        if (found := results.experiments.get(section.experiment))
        and found.measured
        and not found.paper
    ]
    body = templates.get_template("body.md.j2").render(
        lead=templates.get_template("lead.md.j2").render(link=link),
        any=any(found.measured for found in results.experiments.values()),
        not_paper=tables.listed(smaller),
        **_claims(results),
        criteria=[claim for _, claim in CLAIMS],
        experiments=_experiments(results, sections),
        first_page=templates.get_template("first_page.md.j2").render(made=pictures.shown),
        sections=in_paper,
        further=beyond,
        systems=templates.get_template("systems.md.j2").render(),
        timing=templates.get_template("timing.md.j2").render(**timing(results, pictures)),
        commands=_commands(results, sections),
        differences=templates.get_template("differences.md.j2").render(
            ropes=_ropes(results), setting=results.setting
        ),
        methods=templates.get_template("methods.md.j2").render(resamples=RESAMPLES),
    )
    body = re.sub(r"\n{3,}", "\n\n", body).strip()
    body = re.sub(r"(?<=\d) (?=[%×])", "\u00a0", body)  # no line ends between number and unit
    headings = re.findall(r"^(##?) (.+)$", body, flags=re.MULTILINE)
    listed = f"## Contents\n\n{_contents(headings)}\n\n## {BEFORE}"
    markdown = templates.get_template("report.md.j2").render(
        title=TITLE, body=body.replace(f"## {BEFORE}", listed, 1)
    )
    run = {name for name, found in results.experiments.items() if found.measured}
    pending = {section.title for section in sections if section.experiment not in run}
    html = templates.get_template("page.html.j2").render(
        title=TITLE,
        style=templates.get_template("style.css").render(),
        contents=[
            {
                "title": title,
                "slug": slug(title),
                "part": level == "#",
                "pending": title in pending,
            }
            for level, title in headings
        ],
        body=to_html(body),
    )
    return Report(markdown.rstrip() + "\n", html.rstrip() + "\n", pictures.made)


def _contents(headings: list[tuple[str, str]]) -> str:
    """Links to the headings, those within a part indented."""
    lines, inside = [], False
    for level, title in headings:
        inside |= level == "#"
        indented = "  " if inside and level == "##" else ""
        lines.append(f"{indented}- [{title}](#{slug(title)})")
    return "\n".join(lines)


def _section(
    templates: Environment, section: Section, results: Results, pictures: Pictures, link: str
) -> str:
    values = section.values(results, pictures)
    found = results.experiments.get(section.experiment)
    return templates.get_template("section.md.j2").render(
        section=section,
        body=None if values is None else templates.get_template(section.words).render(**values),
        experiment=found,
        weights=origins(found, results) if found else [],
        recordings=_recordings(found, results, link) if found else [],
        link=link,
    )


def _claims(results: Results) -> dict[str, str]:
    """The table of claims, how many of them hold, and why others do not."""
    lines, reasons = [], []
    tally: Counter[Verdict] = Counter()
    direction_only = 0
    titles = {section.experiment: section.title for section in SECTIONS}
    for experiment, claim in CLAIMS:
        outcome = claim.judgement(results)
        found = results.experiments.get(experiment)
        tally[outcome.verdict] += 1
        verdict = f"**{outcome.verdict}**"
        if outcome.verdict is not Verdict.NOT_RUN and found and not found.paper:
            verdict += f" ({found.budget or 'unknown'} run)"
        if outcome.verdict is not Verdict.NOT_RUN and found and found.outdated:
            verdict += f"<br>{EARLIER}"
        if outcome.size:
            verdict += f"<br>the direction holds, the size does not: {outcome.size}"
            direction_only += 1
        ours = outcome.ours or tables.NOTHING
        where = claim.where.replace(", ", ",<br>").replace(" ", "\u00a0").replace("-", "\u2011")
        lines.append([claim.statement, where, claim.paper, ours, verdict])
        short = outcome.verdict in (Verdict.PARTLY, Verdict.FAILS)
        if (short or outcome.size) and claim.reason and (reason := claim.reason(results)):
            linked = f"[{claim.statement}](#{slug(titles[experiment])})"
            reasons.append(f"- {linked}: {reason}")
    header = ["claim", "where", "paper", "ours, 95 % intervals", "verdict"]
    phrases = [
        f"{tally[verdict]} {one if tally[verdict] == 1 else many}"
        for verdict, one, many in TALLY
        if tally[verdict]
    ]
    note = (
        f" Of {direction_only} the direction holds and the size does not." if direction_only else ""
    )
    return {
        "claims": tables.markdown_table(header, lines),
        "reasons": "\n".join(reasons),
        "tally": f"Of {len(CLAIMS)} claims: {tables.listed(phrases)}.{note}",
    }


def _experiments(results: Results, sections: list[Section]) -> str:
    """A line for each experiment: where in the paper, run or not, with what."""
    lines = []
    for section in sections:
        found = results.experiments.get(section.experiment)
        if found is None or not found.measured:
            state = [str(Verdict.NOT_RUN), tables.NOTHING, tables.NOTHING]
        else:
            made = f"{found.commits}<br>{EARLIER}" if found.outdated else found.commits
            state = ["run", f"`{found.budget or 'unknown'}`", made]
        lines.append([f"[{section.title}](#{slug(section.title)})", section.paper, *state])
    return tables.markdown_table(["experiment", "paper", "state", "budget", "made with"], lines)


def _commands(results: Results, sections: list[Section]) -> str:
    """The command of each experiment that was run, and of this report."""
    lines = [
        [section.title, f"`{section.command}`"]
        for section in sections
        if (found := results.experiments.get(section.experiment)) and found.measured
    ]
    lines.append(["This report", "`python -m knotflow.report`"])
    return tables.markdown_table(["what", "command"], lines)


def _recordings(found: ExperimentResults, results: Results, link: str) -> list[tuple[str, str]]:
    inside = [path.relative_to(results.root).as_posix() for path in found.recordings]
    return [(f"{link}/{path}", f"results/{path}") for path in inside[:RECORDINGS_SHOWN]]


def _others(results: Results) -> list[Section]:
    """Experiments of one's own: measured, and no section of the paper's.

    Nor another run of one that has a section, such as a plan for another knot.
    """
    known = {section.experiment for section in SECTIONS}
    return [
        plain(name, name.replace("_", " ").capitalize(), "Not in the paper", "")
        for name, found in results.experiments.items()
        if name not in known and found.measured and found.run.get("workflow") not in known
    ]


def _ropes(results: Results) -> str:
    ropes = [rope for found in results.experiments.values() for rope in found.ropes]
    phrases = [
        f"{rope['length']:g} m long, {1000 * rope['radius']:g} mm radius, {rope['links']} links"
        for rope in ropes
    ]
    return "; ".join(dict.fromkeys(phrases)) or "1 m long, 8 mm radius, 40 links by default"
