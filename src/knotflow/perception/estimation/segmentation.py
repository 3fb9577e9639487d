"""Which pixels show rope, gripper or table, from height above the table and colour histograms of
what stands on it; no colour is known beforehand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from knotflow.perception.camera.image import Label, RgbdImage
from knotflow.perception.camera.pinhole import Camera
from knotflow.perception.camera.table import table_near_zero

_HIGH = 0.05  # metres above the table, from where something wider than a rope is the gripper
_REACH = 0.06  # metres from the gripper's high and wide part, within which fingers are seen
_SHORTEST = 0.05  # metres: less rope than this is noise
_BINS = 16  # of a colour histogram along each of red, green and blue
# Evidence is the logarithm of a likelihood ratio of rope against table.
_HEIGHT_LIMIT, _COLOUR_LIMIT = 2.0, 6.0  # largest evidence of one pixel's height and of its colour
_ENOUGH = 1.0  # from which a pixel is rope: far more of the image is table
_SURE = 1.3  # of the smoothed height alone; a rope between two rows of pixels has 1.32
_SMOOTH = 0.6  # pixels, standard deviation
_CONTRAST = 5.0  # standard deviations of the table's colour, by which the rope's must differ
_ALIEN = 0.5  # of the contrast: a colour so far off the line between both is neither's


@dataclass(frozen=True, eq=False)
class Segmentation:
    """What each pixel shows: `labels` (H, W) uint8, see `Label`, unknown without depth; and
    `height` (H, W) float32, metres above the table, NaN without depth."""

    labels: NDArray[np.uint8]
    height: NDArray[np.float32]

    @property
    def rope(self) -> NDArray[np.bool_]:
        """(H, W)."""
        return self.labels == Label.ROPE

    @property
    def known(self) -> NDArray[np.bool_]:
        """(H, W), rope or table."""
        return self.rope | (self.labels == Label.TABLE)


def segment(image: RgbdImage, camera: Camera, radius: float) -> Segmentation:
    """The pixels of an image, most of which shows the table; a rope of a `radius`, metres, is two
    pixels wide or more. Errors of the pose of some millimetres and degrees are taken out.

    Raises:
        ImageError: for an image of another size.
    """
    image.check(camera)
    points, plane = table_near_zero(image.depth, camera)
    height = points[..., 2]
    if plane is not None:
        height = height - (plane[0] + points[..., :2] @ plane[1:])
    height = height.astype(np.float32)
    known = np.isfinite(height)
    pixel = float(np.nanmedian(image.depth)) / camera.fx  # metres
    solid, near = _gripper(height, radius / pixel, _REACH / pixel)
    red, green, blue = np.moveaxis((image.rgb // (256 // _BINS)).astype(np.intp), -1, 0)
    bins = (red * _BINS + green) * _BINS + blue
    by_height = _height_evidence(height, radius)
    weight = _blurred(known.astype(np.float32)) + 1e-6

    def smooth(evidence: NDArray[np.float32]) -> NDArray[np.float32]:
        """Averages (H, W) over known neighbours."""
        return _blurred(np.where(known, evidence, np.float32(0.0))) / weight

    standing = smooth(by_height) > _SURE
    for _ in range(2):
        by_colour = _colour_evidence(bins, standing & known & ~near, ~standing & known & ~near)
        standing = smooth(by_height + by_colour) > _ENOUGH
    labels = np.where(standing, Label.ROPE, Label.TABLE).astype(np.uint8)
    if solid.any():
        by_colour = _colour_evidence(bins, standing & known & ~near, solid)
        unlike_rope = smooth(by_colour) < 0
        standing |= height > 3 * radius  # a gripper of the table's colour
        labels[near & standing & unlike_rope] = Label.GRIPPER
        labels[solid] = Label.GRIPPER
    labels[~known | (height < -_HIGH)] = Label.UNKNOWN
    _remove_specks(labels, radius / pixel, _SHORTEST / pixel)
    return Segmentation(labels, height)


def _height_evidence(height: NDArray[np.float32], radius: float) -> NDArray[np.float32]:
    """Log likelihood ratio (H, W) of rope against table: on the table heights are normal about 0,
    with the image's own deviation, on the rope about its upper side or above."""
    on_table = np.abs(height) < 2 * radius
    table_std = float(np.std(height[on_table])) if on_table.any() else 0.0
    table_std = max(table_std, 0.05 * radius)
    rope_mean, rope_std = 1.5 * radius, np.hypot(table_std, 0.4 * radius)
    table = np.maximum(height, 0.0) / table_std
    rope = np.minimum(height - rope_mean, 0.0) / rope_std
    evidence = 0.5 * (table**2 - rope**2) + np.log(table_std / rope_std)
    return np.clip(np.nan_to_num(evidence), -_HEIGHT_LIMIT, _HEIGHT_LIMIT)


def _colour_evidence(
    bins: NDArray[np.intp], these: NDArray[np.bool_], those: NDArray[np.bool_]
) -> NDArray[np.float32]:
    """Log likelihood ratio of a pixel's colour (H, W) among `these` pixels against `those`."""
    logs = []
    for pixels in (these, those):
        counts = np.bincount(bins[pixels], minlength=_BINS**3).astype(np.float32)
        smooth = ndimage.gaussian_filter(counts.reshape(_BINS, _BINS, _BINS), 0.7).ravel()
        # An even share keeps colours that were not met from deciding.
        logs.append(np.log(0.98 * smooth / max(counts.sum(), 1.0) + 0.02 / _BINS**3))
    return np.clip(logs[0] - logs[1], -_COLOUR_LIMIT, _COLOUR_LIMIT)[bins]


def _gripper(
    height: NDArray[np.float32], rope: float, reach: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Where (H, W) something high is wider than a rope of radius `rope` pixels, and where it is at
    most `reach` pixels from there."""
    high = (np.nan_to_num(height) > _HIGH).astype(np.float32)
    high = ndimage.uniform_filter(high, 3) > 0.5  # five of nine: the median is high
    if not high.any():
        return high, high
    # Half as near to the camera, a rope is seen twice as wide.
    core = ndimage.distance_transform_edt(high) > 1.5 * rope + 1.5
    solid = high & _within(core, 2 * rope + 3)
    return solid, _within(solid, reach)


def _within(mask: NDArray[np.bool_], reach: float) -> NDArray[np.bool_]:
    """Where (H, W) a pixel of the mask (H, W) is less than `reach` pixels away."""
    near = np.zeros_like(mask)
    if mask.any():
        around = tuple(
            slice(max(int(at.min() - reach), 0), int(at.max() + reach) + 2) for at in mask.nonzero()
        )
        near[around] = ndimage.distance_transform_edt(~mask[around]) < reach
    return near


def _blurred(image: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.asarray(ndimage.gaussian_filter(image, _SMOOTH))


def _remove_specks(labels: NDArray[np.uint8], radius: float, shortest: float) -> None:
    """Label rope (H, W) unknown in place where it is a speck less long than wide, or all of it if
    it is shorter than `shortest`, pixels, as the `radius`."""
    parts, _ = ndimage.label(labels == Label.ROPE, structure=np.ones((3, 3)))
    sizes = np.bincount(parts.ravel())
    sizes[0] = 0
    kept = sizes >= (2 * radius) ** 2
    if sizes[kept].sum() < 2 * radius * shortest:
        kept[:] = False
    labels[(labels == Label.ROPE) & ~kept[parts]] = Label.UNKNOWN


def pixel_coverage(image: RgbdImage, segmentation: Segmentation) -> NDArray[np.float64]:
    """Share (H, W) of each pixel that the rope covers, 0..1, by where its colour lies between the
    table's and the rope's; the segmentation decides where both look alike, and where a colour is
    neither's (a marked head)."""
    mask, labels = segmentation.rope, segmentation.labels
    table, unknown = labels == Label.TABLE, labels == Label.UNKNOWN
    # Pixels without depth within the rope are rope, unless their colour says otherwise.
    share = ndimage.uniform_filter(mask.astype(float), 3) / np.maximum(
        ndimage.uniform_filter(1.0 - unknown, 3), 0.1
    )
    whole = np.where(unknown, share > 0.5, mask).astype(float)
    if not mask.any() or not table.any():
        return whole
    thinned = image.rgb[::2, ::2][table[::2, ::2]]  # a quarter gives the table's colour as well
    bare = (thinned if len(thinned) else image.rgb[table]).astype(float)
    background, rope = np.median(bare, axis=0), np.median(image.rgb[mask], axis=0)
    line = rope - background
    contrast = float(np.linalg.norm(line))
    grain = float(np.median(np.abs((bare - background) @ line))) / max(contrast, 1e-9)
    if contrast < _CONTRAST * 1.5 * grain or contrast < 20:
        return whole
    near = ndimage.binary_dilation(mask, iterations=1)
    colours = image.rgb[near] - background  # (N, 3)
    along = colours @ line / contrast**2
    off = np.linalg.norm(colours - along[:, None] * line, axis=1)
    # Beyond the table, seen from the rope, colours are the table's own or neither's.
    spread = float(np.median(np.linalg.norm(bare - background, axis=1)))
    beyond = (along < 0) & (np.linalg.norm(colours, axis=1) > _CONTRAST * spread)
    mixed = (off < _ALIEN * contrast) & ~beyond
    whole[near] = np.where(mixed, along.clip(0, 1), whole[near])
    return whole
