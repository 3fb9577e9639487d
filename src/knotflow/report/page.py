"""The report as a whole: report.md and its figures."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from knotflow.report import markdown as md
from knotflow.report.budgets import TEMPLATE, in_an_afternoon, timing
from knotflow.report.results import Results
from knotflow.report.section import Claim, Figures, Judgement, Section, Verdict
from knotflow.report.sections import CLAIMS, FURTHER, PAPER, SECTIONS, plain
from knotflow.report.spans import fill, pages
from knotflow.statistics import RESAMPLES

COUNTED = {
    Verdict.HOLDS: ("holds", "hold"),
    Verdict.PARTLY: ("holds partly", "hold partly"),
    Verdict.FAILS: ("does not hold", "do not hold"),
    Verdict.NOT_RUN: ("was not run", "were not run"),
}
"""What one claim does, and what several do."""
FIGURE = re.compile(r"!\[[^\]]*\]\((\S+)\)\n\n\*.+\*\n")
"""A picture in the template, with its caption."""
OWN = re.compile(r"\(figures/([^/)]+\.png)\)")
"""A figure of a report; those of an earlier one are removed."""
DOCS = re.compile(r"\[([^\]]+)\]\(\.\./docs/[^)]+\)")
"""A link of the template to the documentation, which is beside the committed report only."""

NOT_RUN = (
    "> **Nothing has been run yet.** `python -m knotflow +experiment=single_stage budget=smoke` is "
    "a chain on small counts, of about two minutes; then make this report again."
)


def make(results_folder: Path, out: Path | None = None) -> list[Path]:
    """Write report.md and figures/ into `out`, reports/X for results/X by default, from
    `results_folder` alone.

    Numbers of README.md and docs/ beside a folder `results` with runs are written anew as well. The
    same results give the same bytes. Nothing is written before everything could be made.

    Returns:
        The files written into `out`, report.md first.

    Raises:
        ResultsError: a table is not what the report expects; an earlier report stays as it was.
    """
    results, out = Results(results_folder), out or beside(results_folder)
    figures = Figures(results, Path(os.path.relpath(results_folder, out)).as_posix())
    text = compose(results, figures)
    text = text if (out.parent / "docs").is_dir() else DOCS.sub(r"\1", text)
    written = {out / "report.md": text.encode()}
    folder = out / "figures"
    written |= {folder / f"{name}.png": png for name, png in figures.made.items()}
    published = results_folder.resolve().name == "results"
    published &= any(one.run for one in results.experiments.values())
    around = pages(results) if published else {}
    folder.mkdir(parents=True, exist_ok=True)
    earlier = (out / "report.md").read_text("utf-8") if (out / "report.md").is_file() else ""
    for name in set(OWN.findall(earlier)):
        (folder / name).unlink(missing_ok=True)
    for path, content in (written | around).items():
        path.write_bytes(content)
    return list(written)


def beside(results_folder: Path) -> Path:
    """Where the report of a results folder is by default: reports/X of results/X, or in it."""
    parts = [*results_folder.parts]
    if "results" not in parts:
        return results_folder / "reports"
    parts[len(parts) - 1 - parts[::-1].index("results")] = "reports"
    return Path(*parts)


def compose(results: Results, figures: Figures) -> str:
    """The whole report as Markdown; its figures are kept in `figures`."""
    further = [*FURTHER, *_others(results)]
    sections = [*PAPER, *further]
    found = {section.text.title: results.measured(section.experiment) for section in sections}
    smaller = [title for title, one in found.items() if one and one.budget != "paper"]
    rope = results.setting("single_stage", "rope")
    crossings = results.setting("library_training", "most_crossings")
    arranging = results.setting("single_stage", "arranging", "reinforcement_arranged")
    paper = md.join(*(_section(section, results, figures) for section in PAPER))
    beyond = md.join(*(_section(section, results, figures) for section in further))
    tally, claims = _claims(results)

    def shown(match: re.Match[str]) -> str:
        """The picture if it was made."""
        made = match[1].removeprefix("figures/").removesuffix(".png") in figures.made
        own = (results.root / match[1].removeprefix("{link}/")).is_file()
        return match[0] if made or own else ""

    template = FIGURE.sub(shown, TEMPLATE.read_text("utf-8"))
    text = _without_unmeasured(template, results).format(
        link=figures.link,
        open=_open(results, sections),
        notices=md.join(
            "" if any(one.tables for one in results.experiments.values()) else NOT_RUN,
            f"> **Not the paper's counts.** {md.listed(smaller)} ran with a smaller budget: the "
            "numbers show that the chain works from end to end and decide no claim."
            if smaller
            else "",
        ),
        tally=tally,
        claims=claims,
        overview=_overview(results, sections),
        paper=paper,
        further=beyond,
        timing=timing(results),
        afternoon=in_an_afternoon(results),
        rope=f"{rope['length']:g} m long, {1000 * rope['radius']:g} mm in radius, "
        f"{rope['links']} links"
        if rope
        else md.NOTHING,
        crossings=f" that lead to at most {crossings} crossings" if crossings else "",
        arranging=f"up to {arranging}" if arranging else "some",
        resamples=f"{RESAMPLES:,}",
    )
    text = re.sub(r"\n{3,}", "\n\n", fill(text, results, marks=False))
    # No line ends between number and unit, or within limits.
    return re.sub(r"\d [%×]|\([−\d.,]+ to [−\d.,]+\)", lambda m: m[0].replace(" ", "\u00a0"), text)


def _without_unmeasured(text: str, results: Results) -> str:
    """`text` without the list items that rest on a table which is not there."""
    return "".join(
        line
        for line in text.splitlines(keepends=True)
        if not line.startswith("- ") or Verdict.NOT_RUN not in fill(line, results, marks=False)
    )


def _claims(results: Results) -> tuple[str, str]:
    """How many claims hold, and the table of them."""
    rows = []
    tally: Counter[Verdict] = Counter()
    direction_only = 0
    for section, claim in CLAIMS:
        outcome = claim.judgement(results)
        tally[outcome.verdict] += 1
        direction_only += bool(outcome.size)
        rows.append(
            {
                "claim": f"[{claim.statement}](#{md.slug(section.text.title)})<br>"
                f"{section.text.paper}",
                "paper": claim.paper,
                "ours": md.NOTHING if outcome.verdict is Verdict.NOT_RUN else outcome.ours,
                "verdict": _verdict(section, outcome, results),
            }
        )
    counts = md.listed(
        [f"{count} {COUNTED[one][count > 1]}" for one in Verdict if (count := tally[one])]
    )
    size = f" For {direction_only} the direction holds and the size does not."
    return f"Of {len(CLAIMS)} claims, {counts}.{size if direction_only else ''}", md.table(rows)


def _verdict(section: Section, outcome: Judgement, results: Results) -> str:
    found = results.measured(section.experiment)
    verdict = f"**{outcome.verdict}**"
    if outcome.verdict is not Verdict.NOT_RUN and found:
        verdict += "" if found.budget == "paper" else f" ({found.budget} run)"
        verdict += "<br>stale" if found.stale else ""
    if outcome.size:
        verdict += f"<br>the direction holds, the size does not: {outcome.size}"
    return verdict


def _judged(claim: Claim, results: Results) -> str:
    """A claim in its section: both numbers, the verdict, when it holds, and why it does not."""
    outcome = claim.judgement(results)
    if outcome.verdict is Verdict.NOT_RUN:
        return f"- **{claim.statement}: not run** ({outcome.ours}). Paper: {claim.paper}."
    ours = "; ".join(filter(None, (*outcome.ours.split("<br>"), outcome.detail)))
    reason = "" if outcome.verdict is Verdict.HOLDS and not outcome.size else claim.reason(results)
    lines = [f"Paper: {claim.paper}.", f"Ours: {ours}.", f"Holds if {claim.criterion}."]
    lines += [f"Why not: {reason}."] if reason else []
    return f"- **{claim.statement}: {outcome.verdict}.**<br>" + "<br>".join(lines)


def _open(results: Results, sections: Sequence[Section]) -> str:
    """What was not run, what is stale, and why claims do not wholly hold."""
    lines = []
    for section, claim in CLAIMS:
        outcome = claim.judgement(results)
        if outcome.verdict in (Verdict.PARTLY, Verdict.FAILS) and (reason := claim.reason(results)):
            link = f"[{claim.statement}](#{md.slug(section.text.title)})"
            short = re.split(r"[;.] ", reason)[0]  # its section has all of it
            lines.append(f"- {link} {outcome.verdict}: {short}.")
    found = {section.text.title: results.measured(section.experiment) for section in sections}
    missing = [f"[{name}](#{md.slug(name)})" for name, made in found.items() if not made]
    lines += [f"- Not run: {md.listed(missing)}."] if missing else []
    stale = sum(bool(made and made.stale) for made in found.values())
    whole = f"{stale} of {len(found)} [experiments](#state-of-the-experiments)"
    lines += [f"- Stale, made by older code: {whole}."] if stale else []
    return "\n".join(lines)


def _overview(results: Results, sections: Sequence[Section]) -> str:
    """A line for each experiment: its name, where in the paper, and what made it."""
    rows = []
    for section in sections:
        found = results.measured(section.experiment)
        stale = found and found.stale
        rows.append(
            {
                "section": f"[{section.text.title}](#{md.slug(section.text.title)})",
                "experiment": f"`{section.experiment}`",
                "paper": section.text.paper,
                "state": f"stale: {stale}" if stale else "current" if found else Verdict.NOT_RUN,
                "budget": found.budget if found else md.NOTHING,
                "commits": found.commits if found else md.NOTHING,
            }
        )
    return md.table(rows)


def _section(section: Section, results: Results, figures: Figures) -> str:
    body = section.body(results, figures)
    title = f"### {section.text.title}"
    claims = "\n".join(_judged(claim, results) for claim in section.claims)
    if body is None:
        return md.join(
            title,
            section.text.about,
            f"**Not run** ({section.text.paper}; its experiment is `{section.experiment}`).",
            claims,
        )
    found = results.experiments[section.experiment]
    recordings = [
        f"[`{path.relative_to(found.folder).as_posix()}`]"
        f"({figures.link}/{path.relative_to(results.root).as_posix()})"
        for path in sorted(found.folder.rglob("*.mcap"))
    ]
    return md.join(
        title,
        section.text.about,
        f"{section.text.paper} · `+experiment={section.experiment}` · budget `{found.budget}` · "
        f"[tables and configuration]({figures.link}/{section.experiment})"
        + (" · stale" if found.stale else ""),
        ""
        if found.budget == "paper"
        else f"> **{found.budget.capitalize()} run.** These are not the paper's counts.",
        claims,
        body,
        f"Recordings, for `knotflow view`: {', '.join(recordings)}." if recordings else "",
    )


def _others(results: Results) -> list[Section]:
    """Experiments of one's own: measured, and neither of the paper's nor another run of one that
    has a section, such as a plan for another knot."""
    return [
        Section(name, partial(plain, name))
        for name, found in results.experiments.items()
        if found.tables
        and name not in SECTIONS
        and (found.run.get("workflow") or found.config.get("workflow")) not in SECTIONS
    ]
