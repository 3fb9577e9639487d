"""What a claim of the paper is, and what our numbers can say of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

from knotflow.report.results import Results


class Verdict(StrEnum):
    """What our numbers say about a claim."""

    HOLDS = "holds"
    PARTLY = "partly"
    FAILS = "does not hold"
    NOT_RUN = "not run yet"


@dataclass(frozen=True)
class Judgement:
    """Our number in words, and the verdict."""

    ours: str
    verdict: Verdict
    size: str = ""
    """Where the direction holds and the size does not: how it differs."""


class NotMeasured(Exception):
    """The tables do not have what a claim needs; the message says what is missing."""


@dataclass(frozen=True)
class Claim:
    """One claim with the paper's number and when it holds.

    `judge` computes our side from the tables alone; it raises NotMeasured where they lack what it
    needs. `reason` says what the tables show of why a claim does not wholly hold, empty where they
    lack that.
    """

    statement: str
    where: str
    paper: str
    criterion: str
    judge: Callable[[Results], Judgement]
    reason: Callable[[Results], str] | None = None

    def judgement(self, results: Results) -> Judgement:
        """Our side of the claim, NOT_RUN with what is missing where it cannot be judged."""
        try:
            return self.judge(results)
        except NotMeasured as missing:
            return Judgement(str(missing), Verdict.NOT_RUN)


def of_two(first: bool, second: bool) -> Verdict:
    """The verdict on a claim of two parts."""
    if first and second:
        return Verdict.HOLDS
    return Verdict.PARTLY if first or second else Verdict.FAILS
