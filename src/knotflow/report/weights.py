"""Where the weights come from that an experiment began with: a training in results/, if any."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

from knotflow.report.results import ExperimentResults, Results


@dataclass(frozen=True)
class Kept:
    """Weights in results/: what they are of, the experiment and its stage that train them."""

    what: str
    experiment: str
    stage: str
    files: str
    """A pattern of paths in the experiment's folder."""


PRIMITIVES = tuple(
    Kept("primitives", experiment, "self_play", "primitives/*")
    for experiment in ("library_training", "joint_finetuning")
)
DYNAMICS = (Kept("dynamics", "dynamics_training", "dynamics_training", "dynamics.safetensors"),)
NETWORK = (Kept("networks", "strand_training", "strand_training", "network.safetensors"),)
#: Where weights may come from, by the name that a configuration has for their files' digests.
KEPT = {"contents": PRIMITIVES, "primitives_contents": PRIMITIVES, "weights_contents": DYNAMICS}
KEPT |= {"network_contents": NETWORK}


def origins(found: ExperimentResults, results: Results) -> list[str]:
    """A phrase for each weights that the experiment's configuration has digests of."""
    stages = (found.config.get("stages") or {}).values()
    configured = [item for stage in stages for item in (stage.get("config") or {}).items()]
    phrases = [
        _origin(KEPT[key], digests, results)
        for key, digests in configured
        if digests and key in KEPT
    ]
    return list(dict.fromkeys(phrases))


def _origin(trainings: Sequence[Kept], digests: str, results: Results) -> str:
    found = [one for one in trainings if _digests(one, results) == digests]
    if not found:
        folders = " or ".join(f"`results/{one.experiment}`" for one in trainings)
        return f"{trainings[0].what} from elsewhere (not those in {folders})"
    kept = found[0]
    commits = [
        f"commit `{stage.commit[:10]}`"
        for stage in results.experiments[kept.experiment].stages
        if stage.stage == kept.stage and stage.commit
    ]
    made = commits[0] if commits else "commit unknown"
    return f"{kept.what} from `{kept.stage}` of `results/{kept.experiment}`, {made}"


def _digests(kept: Kept, results: Results) -> str:
    """As `knotflow.config.contents` writes them."""
    files = sorted((results.root / kept.experiment).glob(kept.files))
    return "-".join(hashlib.sha256(one.read_bytes()).hexdigest()[:16] for one in files)
