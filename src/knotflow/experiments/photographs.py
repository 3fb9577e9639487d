"""Ropes in real photographs, where these are at hand."""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from knotflow.perception import ImageError
from knotflow.perception.photo.io import see_photo
from knotflow.topology import TopologicalState
from knotflow.workflow import StageRun, stage

LABELS = "labels.json"
"""A list of photographs: `file`, `centre_line` (N, 2) and `width_px`, pixels, `num_crossings`, and
`state`, seen from above."""


@stage
def real_images(run: StageRun, *, images: str) -> None:
    """States and centre lines of the rope in each photograph of a folder with `LABELS`.

    Makes real_images.csv, a row a photograph. A state is correct from either end; the share is that
    of the labelled line within half a width of the estimate.

    Raises:
        ValueError: the folder is missing, or a photograph of it.
    """
    folder = Path(images)
    if not (folder / LABELS).is_file():
        raise ValueError(
            f"real_images.images={images}: there is no {LABELS}; the photographs do not come with "
            "the package, give a folder that has them"
        )
    rows = []
    labels = json.loads((folder / LABELS).read_text("utf-8"))
    if missing := [one["file"] for one in labels if not (folder / one["file"]).is_file()]:
        raise ValueError(f"real_images.images={images} lacks {', '.join(missing)}")
    for label in run.progress(labels, desc="photographs"):
        began = time.perf_counter()
        row = {"image": label["file"], "crossings": label["num_crossings"]}
        row |= {"crossings_correct": False, "state_correct": False, "doubtful": True}
        row |= {"share_within_half_width": 0.0}
        try:
            found, _ = see_photo(folder / label["file"])
        except ImageError:
            pass
        else:
            state = TopologicalState.parse(label["state"])
            off, _ = cKDTree(found.pixels).query(np.array(label["centre_line"]))
            row["crossings_correct"] = len(found.crossings) == label["num_crossings"]
            row["state_correct"] = found.state in (state, state.reversed())
            row["doubtful"] = bool(found.doubts)
            within = float((off < label["width_px"] / 2).mean())
            row["share_within_half_width"] = round(within, 4)
        rows.append(row | {"seconds": round(time.perf_counter() - began, 2)})
    run.save_table("real_images.csv", pd.DataFrame(rows))
