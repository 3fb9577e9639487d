"""Where weights come from: of a training in results/, or from elsewhere."""

import pytest
import yaml

from knotflow.config import contents
from knotflow.report.page import compose
from knotflow.report.results import Results
from knotflow.report.weights import origins

COMMIT = "0123456789abcdef"


@pytest.fixture
def trained(write):
    """A self-play with two files of weights, and learned dynamics of which no commit is known."""
    write.run("joint_finetuning", {"self_play": {"stage": "self_play", "commit": COMMIT}})
    write.run("dynamics_training", {})
    folder = write.root / "joint_finetuning" / "primitives"
    folder.mkdir()
    for number in (2, 1):
        (folder / f"primitive-{number}.safetensors").write_text(f"weights {number}")
    dynamics = write.root / "dynamics_training" / "dynamics.safetensors"
    dynamics.write_text("weights")
    return contents(str(folder)), contents(str(dynamics))


def told(write, **stages):
    write.table("soft_rope", "any.csv", ("x",), [(1,)])
    config = {"stages": {name: {"config": values} for name, values in stages.items()}}
    (write.root / "soft_rope" / "config.yaml").write_text(yaml.safe_dump(config))
    results = Results(write.root)
    return origins(results.experiments["soft_rope"], results)


def test_weights_of_a_training_are_named_with_its_commit(write, trained):
    primitives, dynamics = trained
    library, run = {"contents": primitives}, {"weights_contents": dynamics, "seed": 3}
    assert told(write, library=library, run=run, again=library) == [
        "primitives from `self_play` of `results/joint_finetuning`, commit `0123456789`",
        "dynamics from `dynamics_training` of `results/dynamics_training`, commit unknown",
    ]


@pytest.mark.parametrize("key", ["contents", "primitives_contents"])
def test_other_weights_are_from_elsewhere(write, trained, key):
    primitives, _ = trained
    one, _ = primitives.split("-")
    for digests in (one, primitives[::-1], "no/such/file"):
        (phrase,) = told(write, library={key: digests})
        assert phrase.startswith("primitives from elsewhere")


def test_weights_that_were_never_kept_are_from_elsewhere_and_none_are_no_line(write):
    assert told(write, run={"weights_contents": "a1"})[0].startswith("dynamics from elsewhere")
    assert told(write, run={"weights_contents": "", "seed": 1}, other={}) == []


def test_the_line_stands_below_the_command(write, trained):
    told(write, library={"contents": trained[0]})
    text = compose(Results(write.root), "results").markdown
    assert "+experiment=soft_rope`<br>\nWeights: primitives from `self_play`" in text
