"""What a section of the report is made of: claims with their verdicts, and figures."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cache, wraps
from pathlib import Path
from typing import NamedTuple, ParamSpec

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from knotflow.report import markdown as md
from knotflow.report.results import NotMeasured, Results
from knotflow.statistics import Interval
from knotflow.viz.style import INK, WIDTH, png, styled

COLOURS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#8a8f98")
"""The Okabe-Ito palette, and a grey."""


class Verdict(StrEnum):
    """What our numbers say about a claim of the paper."""

    HOLDS = "holds"
    PARTLY = "holds partly"
    FAILS = "does not hold"
    NOT_RUN = "not run"

    @classmethod
    def of_two(cls, first: bool, second: bool) -> Verdict:
        """The verdict on a claim of two parts."""
        if first and second:
            return cls.HOLDS
        return cls.PARTLY if first or second else cls.FAILS


@dataclass(frozen=True)
class Judgement:
    """Our number in words, and the verdict."""

    ours: str
    verdict: Verdict
    size: str = ""  # where the direction holds and the size does not: how it differs
    detail: str = ""  # further numbers, for the claim's own section


@dataclass(frozen=True)
class Claim:
    """One claim of the paper, and when it holds."""

    statement: str
    paper: str
    criterion: str
    judge: Callable[[Results], Judgement]
    """Raises NotMeasured where the tables lack what it needs."""
    reason: Callable[[Results], str] = lambda _: ""
    """What the tables show of why the claim does not wholly hold; '' where they show nothing."""

    def judgement(self, results: Results) -> Judgement:
        """Our side of the claim, NOT_RUN with what is missing where it cannot be judged."""
        try:
            return self.judge(results)
        except NotMeasured as missing:
            return Judgement(str(missing), Verdict.NOT_RUN)


class Figures:
    """The figures of the report, numbered as they are made; `link` leads from it to the results."""

    def __init__(self, results: Results, link: str = "../results") -> None:
        self.results, self.link = results, link
        self.made: dict[str, bytes] = {}
        self._count = 0

    def draw(
        self,
        name: str,
        caption: str,
        height: float,
        plot: Callable[[Figure], object],
        layout: str | None = "constrained",
    ) -> str:
        """Let `plot` draw a figure `height` inches tall, keep it, and give its Markdown."""
        if name in self.made:
            raise ValueError(f"two figures are called {name!r}; names have to differ")
        with styled():
            figure = Figure(figsize=(WIDTH, height), layout=layout)  # type: ignore[arg-type]
            plot(figure)
            self.made[name] = png(figure)
        return self._show(f"figures/{name}.png", caption)

    def own(self, experiment: str, path: str, caption: str) -> str:
        """The Markdown of a picture that an experiment drew itself; '' where there is none."""
        if not (self.results.root / experiment / path).is_file():
            return ""
        return self._show(f"{self.link}/{experiment}/{path}", caption)

    def _show(self, path: str, caption: str) -> str:
        self._count += 1
        alt = re.split(r"(?<!Fig)\. ", caption.replace("`", ""))[0].rstrip(".")
        return f"![{alt}]({path})\n\n*Figure {self._count}. {caption}*"


def per_cent(axis: Axis) -> None:
    """Write shares of 1 along an axis in per cent."""
    axis.set_major_formatter(PercentFormatter(1, decimals=0, symbol=" %"))


def tied_bars(
    figure: Figure,
    groups: Sequence[str],
    series: Mapping[str, tuple[str, Mapping[int, Interval]]],
) -> None:
    """Shares tied, a group of bars for each name in `groups`; `series` has, by what it is called,
    the colour of its bars and their rates by group."""
    axes = figure.add_subplot()
    step = min(0.8 / len(series), 0.25)
    for place, (label, (colour, rates)) in enumerate(series.items()):
        x = np.array([*rates]) + (place - (len(series) - 1) / 2) * step
        shares = 100 * np.array([(rate.estimate, rate.low, rate.high) for rate in rates.values()])
        axes.bar(x, shares[:, 0], 0.9 * step, color=colour, label=label)
        axes.plot([x, x], shares[:, 1:].T, color=INK, linewidth=1.0)
    axes.set_xticks(range(len(groups)), groups)
    axes.set_ylim(0, 100)
    axes.set_ylabel("tied, %")
    bare_axis(axes, "y")
    figure.legend(loc="outside upper left", ncols=4, frameon=False, fontsize=8.5)


def bare_axis(axes: Axes, grid: str) -> None:
    """No frame and no tick marks; thin grid lines along one axis ('x' or 'y') or 'both'."""
    axes.tick_params(length=0)
    axes.grid(axis=grid)  # type: ignore[arg-type]
    for spine in axes.spines.values():
        spine.set_visible(False)


Parts = Mapping[str, str]
"""Tables, figures and numbers of a section by name, in their order."""
Given = ParamSpec("Given")


def optional(part: Callable[Given, str]) -> Callable[Given, str]:
    """A part that is '' where the tables lack what it needs."""

    @wraps(part)
    def made(*args: Given.args, **kwargs: Given.kwargs) -> str:
        try:
            return part(*args, **kwargs)
        except NotMeasured:
            return ""

    return made


class Text(NamedTuple):
    """The words of a section."""

    title: str
    paper: str  # where in the paper
    about: str
    results: str  # stands there once the experiment was run; parts without a slot in it follow


@cache
def texts() -> dict[str, Text]:
    """The text of each section in sections.md, by experiment."""
    pattern = r"^### ([^\n]+)\n`(\w+)`, ([^\n]+)\n(.*?)(?:^---\n(.*?))?(?=^### |\Z)"
    whole = Path(__file__).with_name("sections.md").read_text("utf-8")
    return {
        experiment: Text(title, paper, about.strip(), text.strip())
        for title, experiment, paper, about, text in re.findall(pattern, whole, re.M | re.S)
    }


@dataclass(frozen=True)
class Section:
    """One experiment's part of the report."""

    experiment: str
    parts: Callable[[Results, Figures], Parts]
    """Raises NotMeasured where it was not run."""
    claims: tuple[Claim, ...] = ()

    @property
    def text(self) -> Text:
        """Its words; of an experiment of one's own, its name."""
        title = self.experiment.replace("_", " ").capitalize()
        return texts().get(self.experiment, Text(title, "beyond the paper", "", ""))

    def body(self, results: Results, figures: Figures) -> str | None:
        """The text of its results with all parts; None where it was not run."""
        text = self.text.results
        try:
            parts = self.parts(results, figures)
        except NotMeasured:
            return None
        rest = [part for name, part in parts.items() if f"{{{name}}}" not in text]
        return md.join(*text.format(**parts).split("\n\n"), *rest)
