"""What the experiments cost, and what they find by budget=afternoon."""

from __future__ import annotations

import re
from pathlib import Path

import pandas as pd

from knotflow.report import markdown as md
from knotflow.report.results import Results
from knotflow.report.section import Verdict
from knotflow.report.sections import CLAIMS, PAPER, SECTIONS
from knotflow.report.spans import fill

TEMPLATE = Path(__file__).with_name("report.md")
QUESTION = re.compile(r"^\|([^|]*)\|([^|]*)\|([^|]*<!-- / -->) \|$", re.MULTILINE)
"""A line of the template's table of what is beyond the paper: question, case, what was measured."""
BUDGETS = ("paper's counts", "in an afternoon")


def timing(results: Results) -> str:
    """The time of each experiment, every stage counted once, and of each kind of experiment.

    A column beside them has that of `results/afternoon`, where there is one.
    """
    spent = _times(results)
    if spent.empty:
        return "No run has recorded its stages yet."
    shorter = results.afternoon
    times, both = {"time": spent}, ""
    if shorter:
        less = times[BUDGETS[1]] = _times(shorter)
        both = f" By `budget=afternoon` {len(less)} of {len(spent)} took {_summed(less)}."
    rows = [
        {"experiment": f"`{name}`", "stages": str(row.stages)}
        | {
            column: md.duration(own.loc[name, "seconds"]) if name in own.index else md.NOTHING
            for column, own in times.items()
        }
        for name, row in spent.iterrows()
    ]
    return md.join(
        f"All experiments took {_summed(spent)}. Times are wall-clock; a stage that several "
        "experiments share is counted once, with the first." + both,
        md.table(rows),
    )


def in_an_afternoon(results: Results) -> str:
    """Claims and main figures by budget=afternoon beside those of the paper's counts."""
    if not (shorter := results.afternoon):
        return "Not run."
    claims = []
    for section, claim in CLAIMS:
        full, less = (claim.judgement(one) for one in (results, shorter))
        link = f"[{claim.statement}](#{md.slug(section.text.title)})"
        if less.verdict is not Verdict.NOT_RUN:
            found = f"**{less.verdict}**<br>{less.ours}"
            claims.append({"claim": link} | dict(zip(BUDGETS, (full.verdict, found), strict=True)))
    figures, asked = [], ""
    for question, case, measured in QUESTION.findall(TEMPLATE.read_text("utf-8")):
        asked = question.strip() or asked
        by = [fill(measured, one, marks=False).strip() for one in (results, shorter)]
        if by[1] != Verdict.NOT_RUN:
            head = {"question": asked, "case": case.strip()}
            figures.append(head | dict(zip(BUDGETS, by, strict=True)))
    return md.join(md.table(claims), md.table(figures))


def _times(results: Results) -> pd.DataFrame:
    """Of each experiment the kind, its stages that none before has, and their seconds."""
    names = [name for name in SECTIONS if name in results.experiments]
    names += [name for name in results.experiments if name not in SECTIONS]
    paper = [section.experiment for section in PAPER]
    kinds = {
        name: "the paper's" if name in paper
        else "trainings of what ships" if results.experiments[name].run.get("ships") else "others"
        for name in names
    }  # fmt: skip
    every = pd.DataFrame(
        [
            (name, made.get("key") or made.get("signature") or f"{name}/{node}", made["seconds"])
            for name in names
            for node, made in results.experiments[name].stages.items()
            if made.get("seconds") is not None
        ],
        columns=["experiment", "identity", "seconds"],
    )
    # Where a stage took next to nothing, it was found done.
    longest = every.groupby("identity")["seconds"].transform("max")
    timed = every[every["seconds"] >= longest / 10].drop_duplicates("identity")
    spent = timed.groupby("experiment", sort=False)["seconds"].agg(stages="size", seconds="sum")
    return spent.assign(kind=[kinds[name] for name in spent.index])


def _summed(spent: pd.DataFrame) -> str:
    """The time of all experiments, and of each kind."""
    kinds = spent.groupby("kind", sort=False)["seconds"].sum()
    order = sorted(kinds.index, key=["the paper's", "trainings of what ships", "others"].index)
    parts = md.listed([f"{kind} {md.duration(kinds[kind])}" for kind in order])
    return f"{md.duration(spent['seconds'].sum())} in {spent['stages'].sum()} stages: {parts}"
