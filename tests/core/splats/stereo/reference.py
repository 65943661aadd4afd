"""Dense stereo once more, in float64 and straight from its formulas: the oracle of the native kernel."""

import numpy as np

from cvdgs.core.splats.stereo import StereoPlan, StereoView

RADIUS = 2


def windows(values: np.ndarray) -> np.ndarray:
    """Sums over windows that the border cuts off."""
    height, width = values.shape
    padded = np.pad(values, RADIUS)
    side = range(2 * RADIUS + 1)
    return sum(padded[dy : dy + height, dx : dx + width] for dy in side for dx in side)


def pixel_grid(view: StereoView) -> tuple[np.ndarray, np.ndarray]:
    height, width = view.image.shape[:2]
    y, x = np.mgrid[:height, :width] + 0.5
    return x, y


def sampled(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Bilinear values at (..., 2) pixels, whose centres are at +0.5; the border is continued."""
    height, width = image.shape[:2]
    x = np.clip(pixels[..., 0] - 0.5, 0, width - 1)
    y = np.clip(pixels[..., 1] - 0.5, 0, height - 1)
    left, top = np.minimum(x.astype(int), width - 2), np.minimum(y.astype(int), height - 2)
    fx, fy = (x - left)[..., None], (y - top)[..., None]
    upper = image[top, left] * (1 - fx) + image[top, left + 1] * fx
    lower = image[top + 1, left] * (1 - fx) + image[top + 1, left + 1] * fx
    return upper * (1 - fy) + lower * fy


def pair_cost(view: StereoView, other: StereoView, depth: float, plan: StereoPlan) -> np.ndarray:
    """(H, W) cost of a neighbour at one depth; inf where it has nothing to compare."""
    x, y = pixel_grid(view)
    pixels, _, inside = other.project(view.unproject(x, y, np.full(x.shape, depth)))
    mine, theirs = (
        view.image.astype(float),
        sampled(other.image.astype(float), np.where(inside[..., None], pixels, 0.0)),
    )
    mask = (inside & (mine[..., 3] >= 0.5) & (theirs[..., 3] >= 0.5)).astype(float)
    luma = np.array([0.299, 0.587, 0.114])
    a, b = mask * (mine[..., :3] @ luma), mask * (theirs[..., :3] @ luma)
    difference = mask * np.abs(mine[..., :3] - theirs[..., :3]).mean(axis=-1)
    counts = windows(mask)
    n = np.maximum(counts, 1.0)
    mean_a, mean_b = windows(a) / n, windows(b) / n
    var_a = np.maximum(windows(a * a) / n - mean_a**2, 0.0) + plan.noise
    var_b = np.maximum(windows(b * b) / n - mean_b**2, 0.0) + plan.noise
    correlation = (windows(a * b) / n - mean_a * mean_b) / np.sqrt(var_a * var_b)
    cost = np.clip(1.0 - correlation, 0.0, 1.0)
    cost = cost + plan.color_weight * np.minimum(windows(difference) / n, plan.most_difference)
    return np.where((mask > 0.0) & (counts >= 6.0), cost, np.inf)


def matching_cost(view: StereoView, others: list[StereoView], depths: np.ndarray, plan: StereoPlan) -> np.ndarray:
    """(H, W, D) mean of the better half of the neighbours, 1 where none has anything to compare."""
    found = np.sort([[pair_cost(view, other, depth, plan) for depth in depths] for other in others], axis=0)
    count = np.isfinite(found).sum(axis=0)
    half = (count + 1) // 2
    sums = np.cumsum(np.where(np.isfinite(found), found, 0.0), axis=0)
    mean = np.take_along_axis(sums, np.maximum(half, 1)[None] - 1, axis=0)[0] / np.maximum(half, 1)
    return np.moveaxis(np.where(half > 0, mean, 1.0), 0, -1)


def path_costs(cost: np.ndarray, plan: StereoPlan) -> np.ndarray:
    """(H, W, D) costs of the paths that run along the first axis."""
    result = [cost[0]]
    for line in cost[1:]:
        before = result[-1]
        least = before.min(axis=-1, keepdims=True)
        padded = np.pad(before, ((0, 0), (1, 1)), constant_values=np.inf)
        step = np.minimum(padded[:, :-2], padded[:, 2:]) + plan.small_step
        result.append(line + np.minimum(np.minimum(before, step), least + plan.large_step) - least)
    return np.stack(result)


def smoothed(cost: np.ndarray, plan: StereoPlan) -> np.ndarray:
    """(H, W, D) sum of the costs of paths from four sides."""
    turned = cost.swapaxes(0, 1)
    return (
        path_costs(cost, plan)
        + path_costs(cost[::-1], plan)[::-1]
        + path_costs(turned, plan).swapaxes(0, 1)
        + path_costs(turned[::-1], plan)[::-1].swapaxes(0, 1)
    )


def inverse_depths(
    view: StereoView, others: list[StereoView], near: float, far: float, levels: int, plan: StereoPlan
) -> np.ndarray:
    """(H, W) inverse depth at the least smoothed cost, refined by a parabola; 0 where not covered or nothing tells."""
    grid = np.linspace(1.0 / far, 1.0 / near, levels)
    cost = smoothed(matching_cost(view, others, 1.0 / grid, plan), plan)
    best = cost.argmin(axis=-1)
    inner = np.clip(best, 1, levels - 2)
    below, at, above = (np.take_along_axis(cost, (inner + i)[..., None], -1)[..., 0] for i in (-1, 0, 1))
    bend = below + above - 2.0 * at
    offset = np.where((best == inner) & (bend > 1e-6), 0.5 * (below - above) / np.maximum(bend, 1e-6), 0.0)
    found = grid[0] + (best + offset) * (grid[1] - grid[0])
    told = cost.mean(axis=-1) - cost.min(axis=-1) >= plan.evidence
    return np.where((view.image[..., 3] >= 0.5) & told, found, 0.0)
