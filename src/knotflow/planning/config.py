"""What a search takes from the configuration."""

from __future__ import annotations

from dataclasses import dataclass

from knotflow.simulation import check_level

RULES = ("posterior", "paper")


@dataclass
class PlannerConfig:
    """How the tree grows, and when to give up."""

    rule: str = "posterior"
    """Where the tree grows next: posterior, where the fewest further branches are expected
    (`planning.posterior`), or paper, at random as in Sec. V-B d (`planning.growth`)."""
    arranging: int = 3
    """At most so many splines in a row that keep the state and make room, before one that acts; 0
    is the paper. The paper's rule has none."""
    onward: bool = True
    """Whether splines are sampled for what they leave as well (Sec. V-B c), where the sampler can
    and another action follows."""
    guess_fraction: float = 0.5
    """Share of the splines that are guesses: aimed ones where the sampler's critic gives an action
    less than `guess_below_value`, since there a policy's are all alike and all wrong, and where it
    succeeded from the same shape before, so that another shape comes of it; moves that may make
    room where the rope is arranged. Of many that are cheaply predicted the best are tried
    (`demonstrations.prediction`). By the paper's rule none is a guess."""
    guess_below_value: float = 0.3
    """See `guess_fraction`."""
    undoing: bool = False
    """Whether crossings may be taken back (`planning.search_graph`) wherever it helps: from every
    rope then leads a way to every goal. If not set, they may only where the rope has crossings at
    the start, which may be none of the goal's or too tight to go on from, and by the paper's rule
    never. For a sampler that does not know `Undo`, drags are aimed."""
    bias: float = 10.0
    """The paper's rule: how many times likelier a node is chosen than one that is one edge farther
    from the goal; 1 is no bias."""
    batch: int = 1
    """Splines simulated at once; 1 is the paper's search."""
    max_branches: int = 2000
    """Give up after this many simulated splines."""
    max_seconds: float = 600.0
    """Give up after this time, seconds of wall clock; a batch that has begun is finished."""
    value_bias: float = 0.0
    """The paper's rule: exponent of the value of a branch, the probability of success that the
    sampler's critic gives it, on its chance to be grown; 0 is what the paper has. Without a critic
    every value is 1."""
    failure_discount: float = 1.0
    """The paper's rule: factor on a node's weight for every branch that failed from it; 1 is what
    the paper has. Below 1 the search leaves nodes from which nothing succeeds, such as loops that
    are too tight."""

    steady: bool = False
    """Whether a plan counts only if all of its splines lead to the same states at half the time
    step, and these last (`planning.soundness`). Of a plan that does not, the search forgets what
    begins with the first such spline, and goes on."""
    margin: float = 0.0
    """What a branch leaves between two passages, or between one and the rope's end, is at least
    this long, metres along the rope, or as long as the shortest before it. A strand that only just
    crosses does not on another rope, so plans that a robot executes have some; 0 is the paper."""
    ensemble: int = 0
    """Perturbed ropes that execute every branch that succeeds, so that plans are robust; 0 is the
    paper, which knows the planner's rope alone (`planning.ensemble`)."""
    ensemble_level: int = 2
    """How far they are from the planner's, see `simulation.perturbation`."""
    survival: float = 0.5
    """Share of the ensemble that has to execute a plan for the search to end with it. Until then it
    seeks better ones; where the budget ends, the best is the plan."""

    def __post_init__(self) -> None:
        """Refuse values that make no search."""
        check_level(self.ensemble_level)
        if not self.margin >= 0.0:
            raise ValueError(f"planner.margin must be 0 or more, got {self.margin}")
        if self.ensemble < 0:
            raise ValueError(f"planner.ensemble must be 0 or more, got {self.ensemble}")
        if not 0.0 < self.survival <= 1.0:
            raise ValueError(f"planner.survival must lie in (0, 1], got {self.survival}")
        if self.rule not in RULES:
            raise ValueError(f"unknown planner.rule {self.rule!r}; it is one of {', '.join(RULES)}")
        if self.arranging < 0:
            raise ValueError(f"planner.arranging must be 0 or more, got {self.arranging}")
        if not self.bias >= 1.0:
            raise ValueError(f"planner.bias must be 1 or more, got {self.bias}")
        if not self.value_bias >= 0.0:
            raise ValueError(f"planner.value_bias must be 0 or more, got {self.value_bias}")
        for name in ("batch", "max_branches"):
            if getattr(self, name) < 1:
                raise ValueError(f"planner.{name} must be 1 or more, got {getattr(self, name)}")
        if not self.max_seconds > 0.0:
            raise ValueError(f"planner.max_seconds must be above 0, got {self.max_seconds}")
        if not 0.0 < self.failure_discount <= 1.0:
            raise ValueError(
                f"planner.failure_discount must lie in (0, 1], got {self.failure_discount}"
            )


FAST_SEARCH = PlannerConfig(batch=4, steady=True, max_branches=20_000, max_seconds=60.0)
"""In batches, so that all cores are used; the default of `plan_rope`."""
