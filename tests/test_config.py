"""Seeds of the budgets: what is judged is never what was learned from."""

import dataclasses
from collections import defaultdict

from knotflow.config import Config, PlansBudget


def seeds(value, key=""):
    """Every seed below a configuration, as (dotted key, seed)."""
    for field in dataclasses.fields(value) if dataclasses.is_dataclass(value) else ():
        inner = getattr(value, field.name)
        if field.name.endswith("seed"):
            yield f"{key}{field.name}", inner
        yield from seeds(inner, f"{key}{field.name}.")


def test_no_two_budgets_share_a_seed_but_searches_for_knots_that_nothing_learns_from():
    keys = defaultdict(set)
    for key, seed in seeds(Config()):
        keys[seed].add(key)
    assert keys.pop(PlansBudget.seed) == {
        *("tree_size.seed", "knots.seed", "pentagram.pulled.seed", "pentagram.untangled.seed")
    }
    shared = {seed: sorted(some) for seed, some in keys.items() if len(some) > 1}
    assert not shared
    assert {"evaluation.starts_seed", "perception.seed", "closed_loop.seed"} < set().union(
        *keys.values()
    )
