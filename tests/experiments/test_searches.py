"""Tables of searches side by side."""

import pandas as pd
import pytest

from knotflow.experiments.searches import branches, search_row, success
from knotflow.workflow import StageRun


@pytest.fixture
def searched(plan, tmp_path):
    """The folder of a `searches` stage with so many searches from an arc."""

    def make(name, count=2):
        folder = tmp_path / name
        (folder / "plans").mkdir(parents=True)
        rows = []
        for seed in range(count):
            (folder / "plans" / f"00-{seed:03d}.json").write_text(plan.to_json(False))
            rows.append({"plan": f"00-{seed:03d}"} | search_row(plan, "overhand", "arc", seed))
        pd.DataFrame(rows).to_csv(folder / "searches.csv", index=False)
        return folder

    return make


def read(folder, name):
    return pd.read_csv(folder / name, dtype=str, keep_default_na=False)


def test_what_needs_no_training_is_counted_once_and_has_no_training_seed(searched, tmp_path, plan):
    icp, first, second = (searched(name) for name in ("icp", "first", "second"))
    names = {"icp.10": icp, "icp.11": icp, "imitation.10": first, "imitation.11": second}
    branches(StageRun(tmp_path), searches=names, columns=["method", "training_seed"])
    table = read(tmp_path, "branches.csv")
    assert [*table.columns[:6]] == [
        *("method", "start", "training_seed", "seed", "kept", "simulated"),
    ]  # fmt: skip
    counts = table.groupby(["method", "training_seed"]).size().to_dict()
    assert counts == {("icp", ""): 2, ("imitation", "10"): 2, ("imitation", "11"): 2}
    tried = read(tmp_path, "tried.csv").astype({"simulated": int, "successes": int})
    spent = tried.groupby("method")["simulated"].sum().to_dict()
    assert spent == {"icp": 2 * plan.branches, "imitation": 4 * plan.branches}
    assert (tried["successes"] <= tried["simulated"]).all()
    assert not tried.duplicated(["method", "start", "state", "action"]).any()


def test_searches_of_one_kind_need_no_columns(searched, tmp_path):
    branches(StageRun(tmp_path), searches={"searches": searched("one")}, columns=[])
    table = read(tmp_path, "branches.csv")
    assert [*table.columns[:4]] == ["start", "seed", "kept", "simulated"]
    assert (table["kept"].astype(int) <= table["simulated"].astype(int)).all()


def test_knots_have_their_rate_and_medians(searched, tmp_path, plan):
    success(StageRun(tmp_path), searches=searched("one", 3))
    (row,) = read(tmp_path, "knots.csv").to_dict("records")
    assert (row["goal"], row["searches"], row["tied"], row["success_rate"]) == (
        *("overhand", "3", "3", "1"),
    )  # fmt: skip
    assert float(row["kept_median"]) == plan.kept
    assert float(row["simulated_median"]) == plan.branches
