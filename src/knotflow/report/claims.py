"""The paper's claims, each with the paper's number beside ours and a verdict.

To add one: write its function `Results -> Outcome` in judges.py, and put a `Claim` into CLAIMS.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from knotflow.report import judges
from knotflow.report.causal_infogan.judge import far_projections
from knotflow.report.planning.judge import pentagram
from knotflow.report.results import Results
from knotflow.report.verdict import NotMeasured, Outcome, Verdict


@dataclass(frozen=True)
class Claim:
    """One claim; `judge` is None while the experiment's table has no settled columns."""

    statement: str
    where: str
    paper: str
    criterion: str
    experiment: str
    judge: Callable[[Results], Outcome] | None

    def outcome(self, results: Results) -> Outcome:
        """Our side of the claim, NOT_RUN with what is missing where it cannot be judged."""
        if self.judge is None:
            return Outcome("", Verdict.NOT_RUN)
        try:
            return self.judge(results)
        except NotMeasured as missing:
            return Outcome(str(missing), Verdict.NOT_RUN)


CLAIMS = (
    Claim(
        statement="Imitation against random sampling, success rate",
        where="Sec. VII-A3, Fig. 6",
        paper="up to 100×",
        criterion="better on every action, and on one of them surely above 10× and compatible "
        "with 100×; partly if surely better on more than half",
        experiment="single_stage",
        judge=judges.imitation_over_random,
    ),
    Claim(
        statement="Imitation against ICP interpolation",
        where="Sec. VII-A3, Fig. 6",
        paper="higher on most actions, above all R1(0,1,1) and R2(0,0,1,1)",
        criterion="higher on more than half, and on both of these; partly if one of the two",
        experiment="single_stage",
        judge=judges.imitation_over_icp,
    ),
    Claim(
        statement="Imitation + RL against imitation only",
        where="Sec. VII-A3, Fig. 6",
        paper="1.14× to 2.33×",
        criterion="every action is compatible with 1.14× or more and more than half surely "
        "better; partly if better on more than half",
        experiment="single_stage",
        judge=judges.reinforcement_over_imitation,
    ),
    Claim(
        statement="Branches to the overhand, ICP",
        where="Sec. VII-A4",
        paper="10 seeds: 3 to 190 (straight), up to 1,428 (arc)",
        criterion="from both starts the largest tree has at least 10 times the branches of the "
        "smallest; partly from one",
        experiment="tree_size",
        judge=judges.icp_tree_size,
    ),
    Claim(
        statement="Branches to the overhand, imitation only",
        where="Sec. VII-A4",
        paper="10 seeds: up to 43 (straight), 9 (arc)",
        criterion="no tree is larger than these; partly from one of the starts",
        experiment="tree_size",
        judge=judges.imitation_tree_size,
    ),
    Claim(
        statement="Branches to the overhand, imitation + RL",
        where="Sec. VII-A4",
        paper="below 5 in all 10 seeds, 3 (the limit) in more than half",
        criterion="both are so from both starts; partly if one of the two",
        experiment="tree_size",
        judge=judges.reinforcement_tree_size,
    ),
    Claim(
        statement="Actor and critic together are best",
        where="Sec. VII-B1, Fig. 7",
        paper="on 7 of 8 actions; the gap is largest on C(2,0,1) and C(2,4,1)",
        criterion="best on at least 7, and the two largest gaps to the critic alone are on "
        "these; partly if one of the two",
        experiment="ablation_actor_critic",
        judge=judges.actor_and_critic,
    ),
    Claim(
        statement="Branches from random starts, independently / jointly finetuned",
        where="Sec. VII-B2",
        paper="4.3 ± 2.6 / 3.4 ± 0.6 over 50 starts",
        criterion="the mean surely falls and so does the spread; partly if the mean falls",
        experiment="joint_finetuning",
        judge=judges.joint_finetuning,
    ),
    Claim(
        statement="Pentagram from an overhand whose head was pulled out by hand",
        where="Sec. VII-E, Fig. 9",
        paper="12 branches",
        criterion="from there the median search ties it with at most 12 branches; partly if the "
        "best one does",
        experiment="pentagram",
        judge=pentagram,
    ),
    Claim(
        statement="Causal InfoGAN",
        where="Sec. VII-C, Fig. 8",
        paper="given and projected end shapes are far apart, sometimes of another topology",
        criterion="models of C(0,1,1) that did not collapse project unseen ends surely more than "
        "a rope's diameter away, and at least one to another state; partly if one of the two",
        experiment="causal_infogan",
        judge=far_projections,
    ),
)
