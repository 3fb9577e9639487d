"""The share of each pixel that is rope, finer than pixels: from colours between rope and table."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.image import Label, RgbdImage
from knotflow.perception.segmentation import Segmentation

_CONTRAST = 5.0  # standard deviations of the table's colour, by which the rope's must differ
_ALIEN = 0.5  # of the contrast: a colour so far off the line between both is neither's


def coverage(image: RgbdImage, segmentation: Segmentation) -> NDArray[np.float64]:
    """Share (H, W) of each pixel that the rope covers, 0..1.

    A rope a few pixels wide covers many of them in part, and their colour lies between the table's
    and the rope's: that separates two strands with a gap of less than a pixel. Colour is known
    where depth is not, too. Where rope and table look alike, and where neither has such a colour,
    such as on a coloured head, it is the segmentation's yes or no.
    """
    from scipy.ndimage import binary_dilation, uniform_filter

    mask = segmentation.rope
    table = segmentation.labels == Label.TABLE
    unknown = segmentation.labels == Label.UNKNOWN
    # Lost pixels within the rope are rope, if they look like nothing at all.
    share = uniform_filter(mask.astype(float), 3) / np.maximum(
        uniform_filter(1.0 - unknown, 3), 0.1
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
    near = binary_dilation(mask, iterations=1)
    colours = image.rgb[near] - background  # (N, 3)
    along = colours @ line / contrast**2
    off = np.linalg.norm(colours - along[:, None] * line, axis=1)
    # Beyond the table, seen from the rope, colours are the table's own or neither's.
    spread = float(np.median(np.linalg.norm(bare - background, axis=1)))
    beyond = (along < 0) & (np.linalg.norm(colours, axis=1) > _CONTRAST * spread)
    mixed = (off < _ALIEN * contrast) & ~beyond
    whole[near] = np.where(mixed, along.clip(0, 1), whole[near])
    return whole
