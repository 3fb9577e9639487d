"""Named knots: one plan (Fig. 1), the pentagram (Sec. VII-E, Fig. 9), and success rates."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress

import pandas as pd

from knotflow.report import markdown as md
from knotflow.report.rates import REINFORCEMENT
from knotflow.report.results import NotMeasured, Results
from knotflow.report.searches import (
    OUTCOME,
    STATE_NOTATION,
    checks,
    effort,
    median_size,
    read_searches,
    search_table,
    search_words,
    select,
    sizes,
    tied_by_splines,
    tied_columns,
)
from knotflow.report.section import Claim, Figures, Judgement, Parts, Verdict
from knotflow.statistics import bootstrap

PAPER_BRANCHES = 12
"""That the paper's one search for the pentagram evaluated."""
PENTAGRAM = ("pentagram", "method", "training_seed")
TRAINED = {REINFORCEMENT.name: "of the eight actions, after RL", "shipped": "shipped"}
GOAL = ("set", "goal")
GOAL_SEARCHES = dict.fromkeys(GOAL, str) | {"rope_seed": int} | OUTCOME
COMPLETE = "complete"
VARIANTS = {
    COMPLETE: "complete",
    "without_arranging": "without arranging",
    "without_next_value": "without next-state value",
    "paper_search": "the paper's search",
}
"""Methods of the ablation, by their tables; all others lack a part that the first has."""

PUBLISHED_GOALS = {
    "easy": ("three crossings, easy", "100 %"),
    "medium": ("three crossings, medium", "44 %; in 1 h 62 %"),
    "hard": ("three crossings, hard", "46 %"),
    "extended": ("three crossings, extended", "61 %"),
    "four": ("four crossings", "26 %"),
}
"""Sets of goals: label, and the success published of TWISTED-RL, in 30 min a goal."""


def overhand(results: Results, figures: Figures) -> Parts:
    """The plan's picture, its solution DAG, and what the search took."""
    searches = read_searches(results, "overhand")
    search = next(searches.itertuples())
    start = f"from the start `{search.start}` (seed {search.seed})"
    return {
        "search": f"The search tied the knot {start} by `{search.path}`, after "
        f"{search.simulated} splines, of which it kept {search.kept}, and "
        f"{md.duration(search.seconds)}."
        if search.solved
        else f"The search did not tie the knot {start}: {search.reason}.",
        "plan": figures.own(
            "overhand",
            "plan.png",
            "The plan. Each rope is shown with the spline that is executed next: a dot where it is "
            "grasped, the greatest height, an arrow where it is released. The head is blue, the "
            "tail orange.",
        ),
        "dag": figures.own(
            "overhand",
            "dag.png",
            "The solution DAG: every sequence of actions that leads to the tied state, the plan's "
            "in green.",
        ),
    }


def pentagram(results: Results, figures: Figures) -> Parts:
    """A line a kind of primitives, and the plan of fewest splines."""
    searches = read_searches(results, *PENTAGRAM)
    groups = (({"primitives": label}, select(searches, name)) for name, label in TRAINED.items())
    return {
        "searches": search_table(groups),
        "settings": search_words(results, "pentagram"),
        "checks": checks(results, "pentagram"),
        "plans": figures.own(
            "pentagram",
            "plan.png",
            "Fig. 9 reproduced: the plan of fewest splines by the first training.",
        ),
    }


def judge_pentagram(results: Results) -> Judgement:
    """A plan found with 12 branches, from an overhand whose head was pulled out."""
    searches = select(read_searches(results, *PENTAGRAM), REINFORCEMENT.name)
    if searches.empty:
        raise NotMeasured(f"needs {REINFORCEMENT.name} in {PENTAGRAM[0]}")
    tied = f"tied in {searches['solved'].sum()} of {len(searches)} searches"
    verdict = Verdict.PARTLY if sizes(searches).min() <= PAPER_BRANCHES else Verdict.FAILS
    if median_size(searches).estimate <= PAPER_BRANCHES:
        verdict = Verdict.HOLDS
    kept, simulated = effort(searches)
    return Judgement(f"{tied}<br>{kept}", verdict, detail=simulated[1:-1])


def knots(results: Results, _: Figures) -> Parts:
    """Which knots are tied, and with what effort."""
    searches = read_searches(results, "knots")
    rows = [
        {"knot": f"`{goal}`", "start": str(start)} | tied_columns(own)
        for (goal, start), own in searches.groupby(["goal", "start"], sort=False)
    ]
    return {
        "knots": md.table(rows),
        "settings": search_words(results, "knots"),
        "notation": STATE_NOTATION,
        "checks": checks(results, "knots"),
    }


def goals(results: Results, figures: Figures) -> Parts:
    """A line for each number of crossings, the share over time, and every goal not tied."""
    table = results.table("goals", "goals.csv", GOAL_SEARCHES, GOAL)
    sets = {str(name): own for name, own in table.groupby("set", sort=False)}
    failed = table[~table["solved"]]
    alike = len(failed) > 1 and len(failed[["simulated", "reason"]].drop_duplicates()) == 1
    missed = [
        {
            "crossings": one.set,
            "goal": f"`{one.goal}`",
            "rope": str(one.rope_seed),
            "kept": f"{one.kept:,}",
        }
        | ({} if alike else {"simulated": f"{one.simulated:,}", "why the search ended": one.reason})
        for one in failed.itertuples()
    ]
    why = f" In each search, {failed['reason'].iloc[0]}." if alike else ""
    groups = {f"{name} crossings": own for name, own in sets.items()}
    return {
        "figure": tied_by_splines(figures, "goals", groups, "number of crossings"),
        "sets": md.table([{"crossings": name} | tied_columns(own) for name, own in sets.items()]),
        "settings": search_words(results, "goals", "goals"),
        "checks": checks(results, "goals"),
        "missed": md.table(
            missed, f"Goals that were not tied, {len(missed)} in all. {STATE_NOTATION}{why}"
        ),
    }


def long_rope(results: Results, _: Figures) -> Parts:
    """A line for each number of crossings: the same goals in the nominal rope and a longer one."""
    experiment, rows = "goals_long_rope", []
    longer, nominal = (
        results.table(one, "goals.csv", GOAL_SEARCHES, GOAL) for one in (experiment, "goals")
    )
    for name, own in longer.groupby("set", sort=False):
        tables = {experiment: own, COMPLETE: nominal.merge(own[[*GOAL]])}
        if len(tables[COMPLETE]) < len(own):
            raise NotMeasured("needs the same goals in goals")
        rows.append(
            {"crossings": name, "tied, nominal rope": md.share(tables[COMPLETE]["solved"])}
            | {f"{column}, longer rope": cell for column, cell in tied_columns(own).items()}
            | {"difference, points": _difference(tables, experiment)}
        )
    return {
        "sets": md.table(rows),
        "settings": search_words(results, experiment, "goals"),
        "checks": checks(results, experiment),
    }


def bowline(results: Results, figures: Figures) -> Parts:
    """What a search takes, and the plan of fewest splines."""
    searches = read_searches(results, "bowline")
    caption = "The plan of fewest splines; its lengths are those of a rope of 1 m."
    return {
        "searches": md.table([tied_columns(searches)]),
        "settings": search_words(results, "bowline"),
        "checks": checks(results, "bowline"),
        "plan": figures.own("bowline", "plan.png", caption),
    }


def published_goals(results: Results, figures: Figures) -> Parts:
    """A line for each set of goals of TWISTED-RL, beside the success that is published for it."""
    searches = read_searches(results, "published_goals", "set", "goal")
    groups, rows = {}, []
    for name, own in searches.groupby("set", sort=False):
        label, theirs = PUBLISHED_GOALS[str(name)]
        groups[label] = own
        rows.append({"goals": label} | tied_columns(own) | {"TWISTED-RL": theirs})
    return {
        "figure": tied_by_splines(figures, "published_goals", groups, "goals"),
        "sets": md.table(rows),
        "settings": search_words(results, "published_goals"),
        "checks": checks(results, "published_goals"),
    }


def ablation(results: Results, figures: Figures) -> Parts:
    """A line a method, with the difference from the complete planner, paired by goal."""
    experiment = "goals_ablation"
    tables: dict[str, pd.DataFrame] = {}
    for name in VARIANTS:
        with suppress(NotMeasured):
            tables[name] = results.table(experiment, f"{name}.csv", GOAL_SEARCHES, GOAL)
    if not tables:
        raise NotMeasured(f"needs goals in {experiment}")
    sets = list(dict.fromkeys(name for table in tables.values() for name in table["set"]))
    rows = [
        {"planner": VARIANTS[name]}
        | {f"tied, {one} crossings": md.share(table["solved"][table["set"] == one]) for one in sets}
        | {"difference, points": _difference(tables, name)}
        for name, table in tables.items()
    ]
    groups = {VARIANTS[name]: table for name, table in tables.items()}
    return {
        "figure": tied_by_splines(figures, experiment, groups, "planner"),
        "variants": md.table(rows),
    }


def _difference(tables: Mapping[str, pd.DataFrame], name: str) -> str:
    """Of the share of goals tied from that of the complete planner, in points."""
    if name == COMPLETE or COMPLETE not in tables:
        return md.NOTHING
    tied, base = (tables[one].set_index([*GOAL])["solved"] for one in (name, COMPLETE))
    return md.estimate(bootstrap((100.0 * tied - 100.0 * base).sort_index()))


PENTAGRAM_CLAIM = Claim(
    "Pentagram from an overhand whose head was pulled out by hand",
    "12 branches",
    "from there the median search keeps at most 12; partly if the best one does",
    judge_pentagram,
)
