"""Which pixels show rope, gripper or table, from colour and height above the table.

Nothing is learned and no colour is known beforehand. Heights come first: what stands on the table
is rope, or gripper where it is high and wider than a rope. These pixels give a histogram of the
colours of each, and a pixel is what colour and height together make likelier. Where rope and table
look alike the colours say nothing and heights decide; where depth is coarse, colours do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.camera import Camera
from knotflow.perception.image import Label, RgbdImage

HIGH = 0.05
"""Height above the table, metres, from which something wider than a rope is the gripper."""
REACH = 0.06
"""Fingers are seen within this distance of the gripper's high and wide part, metres."""
SHORTEST = 0.05
"""Rope of which less than this length is seen is taken for noise, metres."""
BINS = 16
"""Bins of a colour histogram along each of red, green and blue."""
HEIGHT_LIMIT, COLOUR_LIMIT = 2.0, 6.0
"""Largest evidence of one pixel's height and of its colour, log of a likelihood ratio. Depth is
read a pixel off at edges, so a single height is worth little."""
ENOUGH = 1.0
"""Evidence needed to call a pixel rope: far more of the image is table."""
SURE = 1.3
"""Evidence of the smoothed height alone needed for the first histograms. A rope that lies between
two rows of pixels covers the middles of these two only, whose evidence is smoothed to 1.32."""
_SMOOTH = 0.6  # pixels, standard deviation


@dataclass(frozen=True, eq=False)
class Segmentation:
    """What each pixel shows.

    Only a pixel of the table says that there is no rope: behind the gripper, and where nothing is
    known, there may be.

    Attributes:
        labels: (H, W) uint8, see `Label`; pixels without depth are unknown.
        height: (H, W) float32, metres above the table; NaN where the depth is unknown.
    """

    labels: NDArray[np.uint8]
    height: NDArray[np.float32]

    @property
    def rope(self) -> NDArray[np.bool_]:
        """(H, W), where rope is seen."""
        return self.labels == Label.ROPE

    @property
    def gripper(self) -> NDArray[np.bool_]:
        """(H, W), where the gripper is seen."""
        return self.labels == Label.GRIPPER

    @property
    def table(self) -> NDArray[np.bool_]:
        """(H, W), where the bare table is seen."""
        return self.labels == Label.TABLE

    @property
    def unknown(self) -> NDArray[np.bool_]:
        """(H, W), where nothing is known."""
        return self.labels == Label.UNKNOWN


def segment(image: RgbdImage, camera: Camera, radius: float) -> Segmentation:
    """The image's pixels as rope, gripper, table or unknown; without a rope, no pixel is rope.

    Args:
        image: of this camera; most of it shows the table, and a rope is two pixels wide or more.
        camera: errors of its pose of a few millimetres and degrees are taken out.
        radius: the rope's, metres.

    Raises:
        ImageError: for an image of another size.
    """
    image.check(camera)
    height = _heights(image, camera)
    known = np.isfinite(height)
    pixel = float(np.nanmedian(image.depth)) / camera.fx  # metres
    solid, near = _gripper(height, radius / pixel, REACH / pixel)
    bins = _bins(image.rgb)

    by_height = _height_evidence(height, radius)
    share = _blurred(known.astype(np.float32)) + 1e-6
    standing = _smooth(by_height, known, share) > SURE
    for _ in range(2):
        by_colour = _colour_evidence(bins, standing & known & ~near, ~standing & known & ~near)
        standing = _smooth(by_height + by_colour, known, share) > ENOUGH
    labels = np.where(standing, Label.ROPE, Label.TABLE).astype(np.uint8)
    if solid.any():
        by_colour = _colour_evidence(bins, standing & known & ~near, solid)
        unlike_rope = _smooth(by_colour, known, share) < 0
        standing |= height > 3 * radius  # a gripper of the table's colour
        labels[near & standing & unlike_rope] = Label.GRIPPER
        labels[solid] = Label.GRIPPER
    labels[~known | (height < -HIGH)] = Label.UNKNOWN
    _doubt_specks(labels, radius / pixel, SHORTEST / pixel)
    return Segmentation(labels, height)


def table_error(image: RgbdImage, camera: Camera) -> tuple[float, float]:
    """How far the plane that fills most of an image is from the table at z = 0, where the camera's
    pose puts it: metres in height, at the middle of what is seen, and radians of tilt.

    Zero where too little depth is known.
    """
    image.check(camera)
    points, plane = _table(image, camera)
    if plane is None:
        return 0.0, 0.0
    middle = np.nanmedian(points[..., :2], axis=(0, 1))
    return float(plane[0] + plane[1:] @ middle), float(np.arctan(np.hypot(*plane[1:])))


def _heights(image: RgbdImage, camera: Camera) -> NDArray[np.float32]:
    """Heights (H, W) above the plane fitted to the table, metres; NaN where unknown."""
    points, plane = _table(image, camera)
    height = points[..., 2]
    if plane is not None:
        height = height - (plane[0] + points[..., :2] @ plane[1:])
    return height.astype(np.float32)


def _table(image: RgbdImage, camera: Camera) -> tuple[NDArray, NDArray | None]:
    """The points (H, W, 3) of an image, metres, and the plane z = a + b x + c y (3,) fitted to most
    of them; None where there are too few."""
    points = camera.points(image.depth)
    sample = points[::4, ::4][np.isfinite(image.depth[::4, ::4])]
    design, values = np.column_stack([np.ones(len(sample)), sample[:, :2]]), sample[:, 2]
    if len(values) < 3:
        return points, None
    plane = np.array([np.median(values), 0.0, 0.0])
    for tolerance in (0.04, 0.02, 0.01):
        table = np.abs(values - design @ plane) < tolerance
        if table.sum() < 3:
            break
        plane = np.linalg.lstsq(design[table], values[table], rcond=None)[0]
    return points, plane


def _height_evidence(height: NDArray[np.float32], radius: float) -> NDArray[np.float32]:
    """How much likelier a pixel's height (H, W) is on the rope than on the table.

    On the table heights are normal about 0, with the spread that the image itself shows, on the
    rope about its upper side or above.
    """
    on_table = np.abs(height) < 2 * radius
    table_std = float(np.std(height[on_table])) if on_table.any() else 0.0
    table_std = max(table_std, 0.05 * radius)
    rope_mean, rope_std = 1.5 * radius, np.hypot(table_std, 0.4 * radius)
    table = np.maximum(height, 0.0) / table_std
    rope = np.minimum(height - rope_mean, 0.0) / rope_std
    evidence = 0.5 * (table**2 - rope**2) + np.log(table_std / rope_std)
    return np.clip(np.nan_to_num(evidence), -HEIGHT_LIMIT, HEIGHT_LIMIT)


def _bins(rgb: NDArray[np.uint8]) -> NDArray[np.intp]:
    """The bin (H, W) of each pixel in a flat colour histogram."""
    red, green, blue = np.moveaxis((rgb // (256 // BINS)).astype(np.intp), -1, 0)
    return (red * BINS + green) * BINS + blue


def _colour_evidence(
    bins: NDArray[np.intp], these: NDArray[np.bool_], those: NDArray[np.bool_]
) -> NDArray[np.float32]:
    """How much likelier a pixel's colour (H, W) is among `these` pixels than among `those`."""
    from scipy import ndimage  # slow to import

    logs = []
    for pixels in (these, those):
        counts = np.bincount(bins[pixels], minlength=BINS**3).astype(np.float32)
        smooth = ndimage.gaussian_filter(counts.reshape(BINS, BINS, BINS), 0.7).ravel()
        # A share of evenly spread pixels keeps colours that were not met from deciding anything.
        logs.append(np.log(0.98 * smooth / max(counts.sum(), 1.0) + 0.02 / BINS**3))
    return np.clip(logs[0] - logs[1], -COLOUR_LIMIT, COLOUR_LIMIT)[bins]


def _gripper(
    height: NDArray[np.float32], rope: float, reach: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Where (H, W) something high is wider than a rope of radius `rope` pixels, and where it is at
    most `reach` pixels from there."""
    from scipy import ndimage

    high = (np.nan_to_num(height) > HIGH).astype(np.float32)
    high = ndimage.uniform_filter(high, 3) > 0.5  # five of nine: the median is high
    if not high.any():
        return high, high
    # Half as near to the camera, a rope is seen twice as wide.
    core = ndimage.distance_transform_edt(high) > 1.5 * rope + 1.5
    solid = high & _within(core, 2 * rope + 3)
    return solid, _within(solid, reach)


def _within(mask: NDArray[np.bool_], reach: float) -> NDArray[np.bool_]:
    """Where (H, W) a pixel of the mask (H, W) is less than `reach` pixels away."""
    from scipy import ndimage

    near = np.zeros_like(mask)
    if mask.any():
        around = tuple(
            slice(max(int(at.min() - reach), 0), int(at.max() + reach) + 2) for at in mask.nonzero()
        )
        near[around] = ndimage.distance_transform_edt(~mask[around]) < reach
    return near


def _smooth(
    evidence: NDArray[np.float32], known: NDArray[np.bool_], share: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Evidence (H, W) averaged over the known neighbours around, which are a `share` of all."""
    return _blurred(np.where(known, evidence, np.float32(0.0))) / share


def _blurred(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Averages (H, W) over neighbours."""
    from scipy import ndimage

    return np.asarray(ndimage.gaussian_filter(image, _SMOOTH))


def _doubt_specks(labels: NDArray[np.uint8], radius: float, shortest: float) -> None:
    """Makes rope unknown where it is a speck less long than wide, or too short altogether.

    Args:
        labels: (H, W), changed in place.
        radius: of the rope, pixels.
        shortest: rope that has to be seen, pixels.
    """
    from scipy import ndimage

    parts, _ = ndimage.label(labels == Label.ROPE, structure=np.ones((3, 3)))
    sizes = np.bincount(parts.ravel())
    sizes[0] = 0
    kept = sizes >= (2 * radius) ** 2
    if sizes[kept].sum() < 2 * radius * shortest:
        kept[:] = False
    labels[(labels == Label.ROPE) & ~kept[parts]] = Label.UNKNOWN
