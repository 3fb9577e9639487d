"""Plans in the report: their sections, pictures, and the pentagram's verdict."""

import pytest

from knotflow.report.claims import NotMeasured, Verdict
from knotflow.report.page import compose
from knotflow.report.pentagram import SECTION, pulled_out
from knotflow.report.results import Results, ResultsError
from knotflow.report.style import new_figure, render, styled

SEARCH = ("start", "seed", "branches", "solved", "seconds", "goal", "nodes", "path", "knot_type")
SEARCH += ("confirmed", "reason")
KNOTS = ("goal", "start", "searches", "tied", "success_rate", "ci_low", "ci_high")
KNOTS += ("branches_median", "seconds_median", "confirmed")
TIED = "R1(0,1,1) C(0,1,1)"


def search(goal, start, seed, branches, solved=True, confirmed="yes"):
    found = (
        (TIED, "+3_1", confirmed, "the goal was reached") if solved else ("", "", "", "60 s passed")
    )
    return (start, seed, branches, solved, 0.1 * branches, goal, 4, *found)


def draw(folder, stem):
    with styled():
        picture = render(new_figure(1.0), "any", "any")
    (folder / stem).parent.mkdir(parents=True, exist_ok=True)
    (folder / f"{stem}.png").write_bytes(picture.png)
    (folder / f"{stem}.svg").write_bytes(picture.svg)


def report(write):
    return compose(Results(write.root), "../results")


def pentagrams(write, pulled, straight=(), unsolved=()):
    rows = [
        search("pentagram", start, seed, branches, (start, seed) not in unsolved)
        for start, counts in (("pulled_overhand", pulled), ("straight", straight))
        for seed, branches in enumerate(counts)
    ]
    write.table("pentagram", "branches.csv", SEARCH, rows)


def test_a_plan_is_shown_with_its_pictures(write):
    write.table("overhand", "branches.csv", SEARCH, [search("overhand", "random", 0, 5)])
    folder = write.root / "overhand"
    for stem in ("plan", "dag"):
        draw(folder, stem)
    (folder / "waypoints.csv").write_text("time_s,x_m,y_m,z_m,closed,step,action,phase\n")
    found = report(write)
    assert f"Tied by `{TIED}`, in a tree of 5 branches" in found.markdown
    assert "to be the knot `+3_1`" in found.markdown
    names = [picture.name for picture in found.pictures]
    assert {"overhand_plan", "overhand_dag"} <= set(names)
    assert '<img src="figures/overhand_plan.svg"' in found.html


def test_a_plan_that_failed_says_why_and_needs_no_pictures(write):
    write.table("overhand", "branches.csv", SEARCH, [search("overhand", "arc", 2, 9, solved=False)])
    found = report(write)
    assert "Not tied from the `arc` rope (seed 2)" in found.markdown
    assert "60 s passed" in found.markdown
    assert not found.pictures


def test_plans_for_other_knots_are_not_experiments_of_their_own(write):
    write.table("plan-pentagram-random-0", "branches.csv", SEARCH, [search("x", "random", 0, 5)])
    write.run("plan-pentagram-random-0", {})
    path = write.root / "plan-pentagram-random-0" / "run.json"
    path.write_text(path.read_text().replace("{", '{"workflow": "overhand", ', 1))
    assert "pentagram-random" not in report(write).markdown


def test_the_pentagram_has_a_line_a_start_and_its_plans(write):
    pentagrams(write, (2, 5, 13), (30, 90), unsolved={("straight", 1)})
    for folder in ("pulled", "untangled"):
        draw(write.root / "pentagram", f"{folder}/plan")
    found = report(write)
    assert "| overhand, its head pulled out | 3 | 2 |" in found.markdown
    assert "| straight rope, no hand in it | 2 | 30 |" in found.markdown
    assert "confirms the knot type of 4 of 4 tied ropes" in found.markdown
    assert "(figures/pentagram_pulled.png)" in found.markdown
    assert "(figures/pentagram_untangled.png)" in found.markdown


@pytest.mark.parametrize(
    ("pulled", "unsolved", "verdict"),
    [
        ((2, 12, 40), (), Verdict.HOLDS),
        ((2, 13, 40), (), Verdict.PARTLY),
        ((13, 14, 40), (), Verdict.FAILS),
        ((2, 3, 4), {("pulled_overhand", 0), ("pulled_overhand", 1)}, Verdict.PARTLY),
        ((2,), {("pulled_overhand", 0)}, Verdict.FAILS),
    ],
)
def test_the_pentagrams_verdict(write, pulled, unsolved, verdict):
    pentagrams(write, pulled, unsolved=unsolved)
    (claim,) = SECTION.claims
    outcome = claim.judgement(Results(write.root))
    assert outcome.verdict is verdict
    assert f"of {len(pulled)} searches" in outcome.ours


@pytest.mark.parametrize(("tied", "said"), [(7, True), (0, False)])
def test_the_pentagrams_reason_is_the_search_that_arranges(write, tied, said):
    rows = [search("pentagram", "pulled_overhand", seed, 500, False) for seed in range(10)]
    rows += [
        search("pentagram", "pulled_overhand_arranging", seed, 90, seed < tied)
        for seed in range(10)
    ]
    write.table("pentagram", "branches.csv", SEARCH, rows)
    assert ("ties it in 7 of 10 searches" in report(write).markdown) is said


def test_the_pentagram_from_a_straight_rope_alone_judges_nothing(write):
    pentagrams(write, (), (30, 90))
    with pytest.raises(NotMeasured, match="pulled_overhand"):
        pulled_out(Results(write.root))


def test_knots_have_their_rates(write):
    rows = [
        ("4o1+2o5+6o3+", "random", 20, 19, 0.95, 0.76, 0.99, 12, 1.5, 19),
        ("figure_eight", "random", 20, 0, 0, 0, 0.16, "", "", 0),
    ]
    write.table("knots", "knots.csv", KNOTS, rows)
    searches = [search("figure_eight", "random", 0, 900, solved=False)]
    write.table("knots", "branches.csv", SEARCH, searches)
    text = report(write).markdown
    assert "19 of 20 | 12 | 1.5 s | 19 of 19 |" in text
    assert "0 of 20 | – | – | 0 of 0 |" in text
    assert "No rope was tied." in text


@pytest.mark.parametrize(("counts", "column"), [((20, 21, 0), "tied"), ((20, 5, 6), "confirmed")])
def test_knots_that_cannot_be_are_refused(write, counts, column):
    searched, tied, confirmed = counts
    row = ("overhand", "random", searched, tied, 0.5, 0, 1, 3, 1.0, confirmed)
    write.table("knots", "knots.csv", KNOTS, [row])
    write.table("knots", "branches.csv", SEARCH, [search("overhand", "random", 0, 3)])
    with pytest.raises(ResultsError, match=f"column '{column}'"):
        report(write)


def test_unchecked_ropes_are_counted_as_such(write):
    rows = [search("pentagram", "pulled_overhand", i, 5, confirmed="not checked") for i in (0, 1)]
    write.table("pentagram", "branches.csv", SEARCH, rows)
    text = report(write).markdown
    assert "confirms the knot type of 0 of 2 tied ropes; 2 were not checked" in text
