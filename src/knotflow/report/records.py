"""What the tables hold: success rates, tree searches, throughput; checked as they are read."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

from knotflow.report.rows import ResultsError, Row, require
from knotflow.report.statistics import Interval, wilson

# Rates and limits are often written with three decimals.
RATE_TOLERANCE = 1e-3
# splines_per_second may be a mean over repeats instead of rollouts / seconds.
THROUGHPUT_TOLERANCE = 0.05
_ACTION = re.compile(r"(R1|R2|C)\(-?\d+(,-?\d+)+\)")


@dataclass(frozen=True)
class Rate:
    """How often one method reached one action's goal state."""

    method: str
    action: str
    trials: int
    successes: int

    @cached_property
    def interval(self) -> Interval:
        """The success rate with its 95 % Wilson interval."""
        return wilson(self.successes, self.trials)


class Rates:
    """The rates of one table, by method and action."""

    def __init__(self, rates: list[Rate]) -> None:
        self._rates = {(rate.method, rate.action): rate for rate in rates}

    def __iter__(self) -> Iterator[Rate]:
        return iter(self._rates.values())

    def get(self, method: str, action: str) -> Rate | None:
        """The rate of one method on one action, None where it was not measured."""
        return self._rates.get((method, action))

    @property
    def methods(self) -> list[str]:
        """The methods measured, in the table's order."""
        return list(dict.fromkeys(rate.method for rate in self))

    @property
    def actions(self) -> list[str]:
        """The actions measured, in the table's order."""
        return list(dict.fromkeys(rate.action for rate in self))

    def shared_actions(self, *methods: str) -> list[str]:
        """The actions on which every one of `methods` was measured."""
        return [a for a in self.actions if all((m, a) in self._rates for m in methods)]


@dataclass(frozen=True)
class StartRate:
    """One method's successes from one unseen start."""

    method: str
    action: str
    start: str
    trials: int
    successes: int


@dataclass(frozen=True)
class Search:
    """One tree search; `arm` is the method or primitives, `start` '' where there is one kind."""

    arm: str
    start: str
    seed: int
    branches: int
    solved: bool
    seconds: float


class Searches:
    """The tree searches of one table."""

    def __init__(self, searches: list[Search]) -> None:
        self._searches = searches

    def __iter__(self) -> Iterator[Search]:
        return iter(self._searches)

    def of(self, arm: str, start: str = "") -> list[Search]:
        """The searches of one arm from one kind of start, in the table's order."""
        return [s for s in self if s.arm == arm and s.start == start]

    @property
    def arms(self) -> list[str]:
        """The arms measured, in the table's order."""
        return list(dict.fromkeys(search.arm for search in self))

    @property
    def starts(self) -> list[str]:
        """The kinds of start, in the table's order."""
        return list(dict.fromkeys(search.start for search in self))


@dataclass(frozen=True)
class Throughput:
    """How fast the simulator executed splines in one case."""

    case: str
    links: int
    threads: int
    rollouts: int
    seconds: float
    splines_per_second: float
    peak_memory_mb: float


def read_rates(rows: list[Row]) -> Rates:
    """success_rates.csv: each rate agrees with its counts, each interval with Wilson's."""
    columns = ("method", "action", "trials", "successes", "success_rate", "ci_low", "ci_high")
    require(rows, columns)
    rates: dict[tuple[str, str], Rate] = {}
    for row in rows:
        trials, successes = _counts(row)
        rate = Rate(row.text("method"), _action(row), trials, successes)
        _once(row, "action", (rate.method, rate.action), rates)
        rates[rate.method, rate.action] = rate
        interval = rate.interval
        for column, right, meaning in (
            ("success_rate", interval.estimate, "the share"),
            ("ci_low", interval.low, "the lower 95 % Wilson limit"),
            ("ci_high", interval.high, "the upper 95 % Wilson limit"),
        ):
            written = row.number_in(column, 0, 1)
            if right is None or abs(written - right) > RATE_TOLERANCE:
                raise row.error(
                    column, f"{written:g} disagrees with {successes}/{trials}: {meaning} is {right}"
                )
    return Rates(list(rates.values()))


def read_start_rates(rows: list[Row], rates: Rates) -> list[StartRate]:
    """per_start.csv: what success_rates.csv says, start by start; the sums have to agree."""
    require(rows, ("method", "action", "start", "trials", "successes"))
    found: dict[tuple[str, str, str], StartRate] = {}
    for row in rows:
        trials, successes = _counts(row)
        start = StartRate(row.text("method"), _action(row), row.text("start"), trials, successes)
        key = (start.method, start.action, start.start)
        _once(row, "start", key, found)
        found[key] = start
    for rate in rates:
        own = [s for s in found.values() if (s.method, s.action) == (rate.method, rate.action)]
        total = (sum(s.successes for s in own), sum(s.trials for s in own))
        if own and total != (rate.successes, rate.trials):
            raise ResultsError(
                f"{rows[0].path}, columns 'successes' and 'trials': the rows of {rate.method} on "
                f"{rate.action} sum to {total[0]}/{total[1]}, success_rates.csv says "
                f"{rate.successes}/{rate.trials}"
            )
    return list(found.values())


def read_searches(rows: list[Row], arm_column: str, *, with_start: bool) -> Searches:
    """branches.csv of tree_size (arm_column='method') and joint_finetuning ('primitives')."""
    keys = (arm_column, "start", "seed") if with_start else (arm_column, "seed")
    require(rows, (*keys, "branches", "solved", "seconds"))
    found: dict[tuple[str, str, int], Search] = {}
    for row in rows:
        search = Search(
            arm=row.text(arm_column),
            start=row.text("start") if with_start else "",
            seed=row.count("seed"),
            branches=row.count("branches"),
            solved=row.flag("solved"),
            seconds=row.number_in("seconds", 0),
        )
        key = (search.arm, search.start, search.seed)
        _once(row, "seed", key, found)
        found[key] = search
    return Searches(list(found.values()))


def read_throughput(rows: list[Row]) -> list[Throughput]:
    """throughput.csv of the benchmark."""
    require(
        rows,
        (
            *("case", "links", "threads", "rollouts"),
            *("seconds", "splines_per_second", "peak_memory_mb"),
        ),
    )
    found = []
    for row in rows:
        case = Throughput(
            case=row.text("case"),
            links=row.count("links", at_least=1),
            threads=row.count("threads", at_least=1),
            rollouts=row.count("rollouts", at_least=1),
            seconds=row.number_in("seconds", 0),
            splines_per_second=row.number_in("splines_per_second", 0),
            peak_memory_mb=row.number_in("peak_memory_mb", 0),
        )
        executed = case.splines_per_second * case.seconds
        if abs(executed - case.rollouts) > THROUGHPUT_TOLERANCE * case.rollouts:
            raise row.error(
                "splines_per_second",
                f"{case.splines_per_second:g} for {case.seconds:g} s makes {executed:.0f} "
                f"rollouts, the row says {case.rollouts}",
            )
        found.append(case)
    return found


def _counts(row: Row) -> tuple[int, int]:
    trials, successes = row.count("trials", at_least=1), row.count("successes")
    if successes > trials:
        raise row.error("successes", f"{successes} of only {trials} trials")
    return trials, successes


def _action(row: Row) -> str:
    action = row.text("action")
    if not _ACTION.fullmatch(action):
        raise row.error("action", f"{action!r} is no topological action such as 'C(2,0,1)'")
    return action


def _once(row: Row, column: str, key: tuple[object, ...], found: dict) -> None:
    if key in found:
        raise row.error(column, f"{', '.join(map(str, key))} stands in an earlier row already")
