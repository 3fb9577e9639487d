"""By what estimates are compared: which ropes, which images, and how far an estimate is off."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.camera import Camera
from knotflow.perception.estimation import RopeEstimate
from knotflow.perception.image import Label, RgbdImage
from knotflow.perception.noise import add_noise
from knotflow.perception.registration import nearest_on_chain
from knotflow.perception.segmentation import segment
from knotflow.perception.simulated import SimulatedCamera
from knotflow.simulation import RopeConfig, check_points, resample, state_or_none


def choose_ropes(
    path: Path, crossings: Sequence[int], count: int, rope: RopeConfig, seed: int
) -> dict[tuple[int, int], NDArray]:
    """Shapes (V, 3), metres, by number of crossings and a count; all of each is in view.

    Args:
        path: shapes and their numbers of crossings, as the stage `ropes` has them.
        crossings: the numbers wanted.
        count: ropes of each number; where there are fewer, all of these are taken.
        rope: what they are shapes of.
        seed: of the choice.

    Raises:
        ValueError: no rope of a number of crossings.
    """
    with np.load(path) as file:
        points, of_each = file["points"].astype(np.float64), file["crossings"]
    rng = np.random.default_rng([seed, 0])
    camera = Camera.overhead()
    chosen: dict[tuple[int, int], NDArray] = {}
    for number in crossings:
        rows = [row for row in np.flatnonzero(of_each == number) if _in_view(points[row], camera)]
        if not rows:
            raise ValueError(
                f"{path} has no rope of {number} crossings in the camera's view: raise "
                "perception.shards"
            )
        if len(rows) < count:
            print(f"only {len(rows)} ropes of {number} crossings are in view", flush=True)
        for place, row in enumerate(rng.permutation(rows)[:count]):
            chosen[number, place] = check_points(resample(points[row], rope), rope)
    return chosen


def _in_view(points: NDArray, camera: Camera) -> bool:
    """Whether the whole rope is seen, with some pixels to spare."""
    column, row, _ = camera.project(points).T
    return bool(
        min(column.min(), row.min()) > 4
        and column.max() < camera.width - 5
        and row.max() < camera.height - 5
    )


def noisy_image(
    eye: SimulatedCamera, truth: NDArray, rng: np.random.Generator
) -> tuple[RgbdImage, float]:
    """An image with noise, and the intersection over union of its rope, as it is segmented, with
    the pixels that show rope."""
    view = eye.view(truth)
    image = add_noise(view.image, eye.camera, eye.noise, rng)
    found, there = segment(image, eye.camera, eye.rope.radius).rope, view.labels == Label.ROPE
    return image, float((found & there).sum() / (found | there).sum())


def measures(found: RopeEstimate | None, truth: NDArray) -> dict[str, Any]:
    """How far an estimate is from the true rope (V, 3); empty where no rope was found."""
    if found is None:
        empty = dict.fromkeys(("mean_error_mm", "p95_error_mm", "off_curve_error_mm"), np.nan)
        return empty | dict.fromkeys(("state_correct", "head_correct"), 0) | {"doubtful": 1}
    error = 1e3 * np.linalg.norm(found.points - truth, axis=1)
    turned = 1e3 * np.linalg.norm(found.points[::-1] - truth, axis=1)
    off = np.linalg.norm(nearest_on_chain(found.points, truth)[2], axis=1)
    return {
        "mean_error_mm": round(float(error.mean()), 3),
        "p95_error_mm": round(float(np.quantile(error, 0.95)), 3),
        "off_curve_error_mm": round(float(1e3 * off.mean()), 3),
        "state_correct": int(found.state == state_or_none(truth)),
        "head_correct": int(error.mean() < turned.mean()),
        "doubtful": int(found.doubtful),
    }
