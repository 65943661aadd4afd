"""Finds printed AprilTags in a photograph: squares that say which they are, with corners to a fraction of a pixel.

Family tag36h11 (Olson, "AprilTag: A robust and flexible visual fiducial system", ICRA 2011): a black frame one cell
wide around 6 x 6 black and white cells, on white. numpy and scipy alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import ConvexHull, QhullError

# The family's first numbers: cells row by row from the upper left, 1 for white, the first one the highest bit.
CODES = (
    0xD5D628584,
    0xD97F18B49,
    0xDD280910E,
    0xE479E9C98,
    0xEBCBCA822,
    0xF31DAB3AC,
    0x056A5D085,
    0x10652E1D4,
    0x22B1DFEAD,
    0x265AD0472,
    0x34FE91B86,
    0x3FF962CD5,
    0x43A25329A,
    0x474B4385F,
    0x4E9D243E9,
    0x5246149AE,
    0x5997F5538,
    0x683BB6C4C,
    0x6BE4A7211,
    0x7E3158EEA,
    0x81DA494AF,
    0x858339A74,
    0x8CD51A5FE,
    0x9F21CC2D7,
    0xA2CABC89C,
    0xADC58D9EB,
    0xB16E7DFB0,
    0xB8C05EB3A,
    0xD25EF139D,
    0xD607E1962,
)
CELLS = 6  # along a side, without the frame
FRAMED = CELLS + 2
_MOST_WRONG = 2  # cells; two tags of the family differ in 11, however they are turned
_LEAST_SIDE = 16.0  # pixels: two for a cell
_NEIGHBOURHOOD = 1 / 12  # of the longer side: what a frame is darker than
_DARKER = 8.0  # grey levels
_LEAST_CONTRAST = 20.0  # grey levels between the frame and the paper around it
_SQUARENESS = (0.85, 1.2)  # area of the dark patch in that of the four-sided figure through its corners
_ENDS = 0.12  # of a side at each end, that the corners round off
_TRIM = 2.0  # deviations, beyond which a place on a side is not on it


@dataclass(frozen=True)
class Tag:
    """One printed tag in a photograph.

    Attributes:
        number: in the family.
        corners: (4, 2) of the outside of its frame, x and y in pixels from the photograph's corner; clockwise as
            printed, from the upper left.
    """

    number: int
    corners: NDArray[np.float64]


def find_tags(image: NDArray[np.uint8]) -> list[Tag]:
    """The tags in an (H, W, 3) photograph, each number as often as it is seen."""
    grey = image.astype(np.float32) @ np.array([0.299, 0.587, 0.114], np.float32)
    size = max(3, int(max(grey.shape) * _NEIGHBOURHOOD))
    dark = grey < ndimage.uniform_filter(grey, size) - _DARKER
    found = []
    for outline in _dark_squares(dark):
        corners = _refined(grey, outline)
        tag = None if corners is None else _read(grey, corners)
        if tag is not None:
            found.append(tag)
    return found


def _dark_squares(dark: NDArray[np.bool_]) -> Iterator[NDArray[np.float64]]:
    """(4, 2) rough corners of every dark patch that has four sides, in pixels, clockwise."""
    labels, _ = ndimage.label(dark)
    for number, where in enumerate(ndimage.find_objects(labels), 1):
        height, width = (part.stop - part.start for part in where)
        if min(height, width) < _LEAST_SIDE or max(height, width) > 0.9 * max(dark.shape):
            continue
        patch = ndimage.binary_fill_holes(labels[where] == number)
        corners = _four_corners(patch)
        if corners is not None:
            yield corners + np.array([where[1].start, where[0].start])


def _four_corners(patch: NDArray[np.bool_]) -> NDArray[np.float64] | None:
    """The corners of a filled patch, from its upper left; None where it has not four sides."""
    rows, columns = np.nonzero(patch & ~ndimage.binary_erosion(patch))
    edge = np.stack([columns, rows], axis=1) + 0.5
    try:
        hull = edge[ConvexHull(edge).vertices]
    except (QhullError, ValueError):
        return None
    between = np.linalg.norm(hull[:, None] - hull[None], axis=2)
    first, third = np.unravel_index(np.argmax(between), between.shape)
    across = hull[third] - hull[first]
    sides = (hull - hull[first]) @ np.array([-across[1], across[0]])
    second, fourth = int(np.argmin(sides)), int(np.argmax(sides))  # y points down
    corners = hull[[first, second, third, fourth]]
    area = _area(corners)
    if area < _LEAST_SIDE**2 / 2.0 or not _SQUARENESS[0] <= patch.sum() / area <= _SQUARENESS[1]:
        return None
    return corners


def _area(corners: NDArray[np.float64]) -> float:
    x, y = corners.T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def _refined(grey: NDArray[np.float32], corners: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Where the lines through the sides meet; the sides are where grey changes most."""
    lines = [_side(grey, corners[side], corners[(side + 1) % 4]) for side in range(4)]
    refined = []
    for side in range(4):
        before, line = lines[side - 1], lines[side]
        if before is None or line is None:
            return None
        normals = np.stack([before[:2], line[:2]])
        if abs(np.linalg.det(normals)) < 0.1:
            return None
        refined.append(np.linalg.solve(normals, [before[2], line[2]]))
    result = np.array(refined)
    reach = 0.15 * np.sqrt(_area(corners)) + 2.0
    return result if np.abs(result - corners).max() < reach else None


def _side(grey: NDArray[np.float32], start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray | None:
    """(a, b, c) with a x + b y = c and a² + b² = 1 of the edge near a line; None where there is none."""
    length = float(np.linalg.norm(end - start))
    if length < _LEAST_SIDE / 2.0:
        return None
    along = (end - start) / length
    normal = np.array([-along[1], along[0]])
    count = int(np.clip(length, 12, 200))
    places = start + np.linspace(_ENDS, 1.0 - _ENDS, count)[:, None] * (end - start)
    reach = float(np.clip(0.6 * length / FRAMED, 2.0, 8.0))
    offsets = np.arange(-reach, reach + 0.25, 0.25)
    samples = _sample(grey, places[:, None] + offsets[None, :, None] * normal)
    slopes = np.abs(np.gradient(ndimage.gaussian_filter1d(samples, 2.0, axis=1), axis=1))
    weights = slopes**2 * (slopes > 0.5 * slopes.max(axis=1, keepdims=True))
    total = weights.sum(axis=1)
    good = total > 0.0
    if np.count_nonzero(good) < count // 2:
        return None
    points = places[good] + ((weights @ offsets)[good] / total[good])[:, None] * normal
    for _ in range(3):
        middle = points.mean(axis=0)
        _, _, axes = np.linalg.svd(points - middle, full_matrices=False)
        across = axes[1]
        away = (points - middle) @ across
        kept = np.abs(away) <= max(_TRIM * float(away.std()), 0.05)
        if np.count_nonzero(kept) < 6:
            return None
        points = points[kept]
    return np.array([*across, across @ points.mean(axis=0)])


def _sample(grey: NDArray[np.float32], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Grey at (..., 2) places in pixels, whose centres are at +0.5."""
    coordinates = np.moveaxis(places[..., ::-1] - 0.5, -1, 0)
    return np.asarray(ndimage.map_coordinates(grey, coordinates, order=1, mode="nearest"), np.float64)


def _read(grey: NDArray[np.float32], corners: NDArray[np.float64]) -> Tag | None:
    """What the cells within the corners say; None where that is no tag's number."""
    cells = _cells(grey, corners, 0.5 + np.arange(-1, FRAMED + 1))
    ring = np.ones((FRAMED + 2, FRAMED + 2), bool)
    ring[1:-1, 1:-1] = False
    inner = cells[1:-1, 1:-1]
    frame = np.ones((FRAMED, FRAMED), bool)
    frame[1:-1, 1:-1] = False
    black, white = float(np.median(inner[frame])), float(np.median(cells[ring]))
    if white - black < _LEAST_CONTRAST:
        return None
    threshold = 0.5 * (black + white)
    if np.count_nonzero(inner[frame] > threshold) > _MOST_WRONG:
        return None
    bits = inner[1:-1, 1:-1] > threshold
    for quarters in range(4):
        wrong = np.count_nonzero(np.rot90(bits, quarters).ravel() != _PATTERNS, axis=1)
        if wrong.min() <= _MOST_WRONG:
            # `rot90` takes what is at the upper right to the upper left.
            return Tag(int(wrong.argmin()), np.roll(corners, -quarters, axis=0))
    return None


def pattern(number: int) -> NDArray[np.bool_]:
    """(8, 8) cells of a tag with its frame; True is white."""
    cells = np.zeros((FRAMED, FRAMED), bool)
    cells[1:-1, 1:-1] = _PATTERNS[number].reshape(CELLS, CELLS)
    return cells


_PATTERNS = np.array([[code >> (CELLS**2 - 1 - bit) & 1 for bit in range(CELLS**2)] for code in CODES], bool)


def _cells(grey: NDArray[np.float32], corners: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean grey of the cells whose middles are at `places` along both sides, in cells from the upper left corner."""
    warp = square_to(corners)
    small = np.array([-0.2, 0.0, 0.2])
    steps = (places[:, None] + small).ravel() / FRAMED
    x, y = np.meshgrid(steps, steps)
    points = np.stack([x, y, np.ones_like(x)], axis=-1) @ warp.T
    values = _sample(grey, points[..., :2] / points[..., 2:])
    count = len(places)
    return values.reshape(count, 3, count, 3).mean(axis=(1, 3))


def square_to(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """The (3, 3) homography from the unit square, clockwise from (0, 0) with y down, to (4, 2) corners."""
    rows = []
    for (u, v), (x, y) in zip(((0, 0), (1, 0), (1, 1), (0, 1)), corners, strict=True):
        rows += [[u, v, 1, 0, 0, 0, -u * x, -v * x, -x], [0, 0, 0, u, v, 1, -u * y, -v * y, -y]]
    return np.linalg.svd(np.array(rows, np.float64))[2][-1].reshape(3, 3)
