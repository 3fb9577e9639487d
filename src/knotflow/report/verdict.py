"""What can be said of a claim, and how it is said."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Verdict(StrEnum):
    """What our numbers say about a claim."""

    HOLDS = "holds"
    PARTLY = "partly"
    FAILS = "does not hold"
    NOT_RUN = "not run yet"


@dataclass(frozen=True)
class Outcome:
    """Our number in words, and the verdict."""

    ours: str
    verdict: Verdict


class NotMeasured(Exception):
    """The tables do not have what a claim needs; the message says what is missing."""
