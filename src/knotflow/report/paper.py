"""What the paper fixes for every table and figure: actions, primitives, methods, their order."""

from __future__ import annotations

from dataclasses import dataclass

#: The fewest branches that can tie an overhand: its path has three actions (Sec. VII-A4).
OVERHAND_LIMIT = 3


@dataclass(frozen=True)
class PrimitiveSet:
    """One of the four motion primitives (Sec. V-A) and those of the eight actions it serves."""

    name: str
    actions: tuple[str, ...]


PRIMITIVES = (
    PrimitiveSet("1: R1", ("R1(0,1,1)",)),
    PrimitiveSet("2: R2", ("R2(0,0,1,1)",)),
    PrimitiveSet("3: Cross, an end goes over", ("C(0,1,1)", "C(0,2,1)", "C(4,2,1)")),
    PrimitiveSet("4: other Cross actions", ("C(1,2,1)", "C(2,0,1)", "C(2,4,1)")),
)

#: The eight topological actions in the order of Fig. 6.
ACTIONS = tuple(action for primitive in PRIMITIVES for action in primitive.actions)


@dataclass(frozen=True)
class Method:
    """One compared thing: a method, or a way of training. `colour` is of the Okabe-Ito palette."""

    name: str
    label: str
    colour: str


RANDOM = Method("random", "random", "#8a8f98")
ICP = Method("icp", "ICP", "#e69f00")
IMITATION = Method("imitation", "imitation", "#56b4e9")
REINFORCEMENT = Method("reinforcement", "imitation + RL", "#0072b2")

ARRANGED = Method("reinforcement_arranged", "self-play + arranging", "#009e73")
BY_POSTERIOR = (
    Method("independent_posterior", "independently, posterior rule", "#e69f00"),
    Method("joint_posterior", "jointly, posterior rule", "#009e73"),
)

SINGLE_STAGE = (RANDOM, ICP, IMITATION, REINFORCEMENT)
TREE_SIZE = (ICP, IMITATION, REINFORCEMENT)
ABLATION = (
    Method("actor_only", "actor only", "#e69f00"),
    Method("critic_only", "critic only", "#009e73"),
    Method("actor_critic", "actor and critic", "#0072b2"),
)
JOINT = (
    Method("independent", "trained independently", "#56b4e9"),
    Method("joint", "finetuned jointly", "#0072b2"),
)
STARTS = ("straight", "arc")

#: Further methods of ours, shown where they were measured.
FURTHER = {method.name: method for method in (ARRANGED, *BY_POSTERIOR)}
# For whatever else is measured beyond the paper's methods (a sampler of one's own, say).
_EXTRA_COLOURS = ("#cc79a7", "#d55e00", "#009e73", "#f0e442")


def with_extras(methods: tuple[Method, ...], found: list[str]) -> tuple[Method, ...]:
    """The paper's methods in its order, then those of `found` that it does not have."""
    known = {method.name for method in methods}
    extras = [name for name in dict.fromkeys(found) if name not in known]
    return methods + tuple(
        FURTHER.get(name)
        or Method(name, name.replace("_", " "), _EXTRA_COLOURS[i % len(_EXTRA_COLOURS)])
        for i, name in enumerate(extras)
    )


def in_order(actions: list[str]) -> list[str]:
    """`actions` without repeats, the eight of Fig. 6 first and in its order."""
    found = list(dict.fromkeys(actions))
    return [a for a in ACTIONS if a in found] + [a for a in found if a not in ACTIONS]
