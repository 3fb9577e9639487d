import json

import pandas as pd
import pytest
from PIL import Image
from tests.perception.photographs import centre_line, photograph

from knotflow.experiments.photographs import LABELS, real_images
from knotflow.workflow import StageRun


@pytest.mark.slow
def test_a_row_a_photograph(tmp_path):
    line = centre_line("arc", (150, 200))
    Image.fromarray(photograph(line, [], (150, 200))).save(tmp_path / "arc.png")
    label = {"file": "arc.png", "centre_line": line.tolist(), "width_px": 9}
    label |= {"num_crossings": 0, "state": "trivial"}
    (tmp_path / LABELS).write_text(json.dumps([label]))
    real_images(StageRun(tmp_path), images=str(tmp_path))
    (row,) = pd.read_csv(tmp_path / "real_images.csv").to_dict("records")
    assert row["crossings_correct"] and row["state_correct"] and not row["doubtful"]
    assert row["share_within_half_width"] > 0.95


def test_a_missing_photograph_is_named(tmp_path):
    (tmp_path / LABELS).write_text('[{"file": "arc.png"}]')
    with pytest.raises(ValueError, match=r"lacks arc\.png"):
        real_images(StageRun(tmp_path), images=str(tmp_path))


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(ValueError, match="nowhere: there is no"):
        real_images(StageRun(tmp_path), images="nowhere")
