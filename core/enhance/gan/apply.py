"""Applies a generator to images of any size: odd sides, single pixels, and tiles without seams for large ones."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from ...color.simulation import Observer
from .conditioning import observer_features
from .networks import Generator, Statistics

TILE_SIZE = 2048
"""Sides of the squares that the network sees at once, in pixels; 1.8 GB of memory with the shipped network."""

STATISTICS_SIZE = 512
"""Longest sides of the images from which a scene's statistics are taken, in pixels."""


def enhance(
    generator: Generator,
    image: Tensor,
    proposal: Tensor,
    observer: Observer,
    palette: Tensor,
    statistics: Statistics | None = None,
    strength: float = 1.0,
    tile_size: int = TILE_SIZE,
) -> Tensor:
    """(3, H, W) enhanced sRGB in [0, 1]: image + strength (clip(image + change) - image).

    Args:
        image: (3, H, W) float32 sRGB in [0, 1], on the generator's device.
        proposal: (3, H, W) the teacher's recolouring of it.
        observer, palette: see `conditioning`.
        statistics: of the scene, for a generator with normalisation; None to take the image's own.
        tile_size: larger images are worked on in squares of this size. They overlap by the generator's reach, so that
            no pixel's result depends on where the seams lie.
    """
    config = generator.config
    if config.normalisation != "none" and statistics is None and max(image.shape[-2:]) > STATISTICS_SIZE:
        statistics = average_statistics([record_statistics(generator, image, proposal, observer, palette)])
    core = tile_size - 2 * config.reach
    if core < config.stride:
        raise ValueError(f"tiles of {tile_size} pixels are too small for a reach of {config.reach}")
    core -= core % config.stride
    height, width = image.shape[-2:]
    result = torch.empty_like(image)
    whole = max(height, width) <= tile_size
    step, margin = (tile_size, 0) if whole else (core, config.reach)
    with torch.inference_mode():
        for top in range(0, height, step):
            for left in range(0, width, step):
                y0, x0 = max(top - margin, 0), max(left - margin, 0)
                bottom, right = min(top + step, height), min(left + step, width)
                part, proposed = (full[:, y0 : bottom + margin, x0 : right + margin] for full in (image, proposal))
                changed = part + _change(generator, part, proposed, observer, palette, statistics)
                part = torch.lerp(part, changed.clamp_(0.0, 1.0), strength)
                result[:, top:bottom, left:right] = part[:, top - y0 : bottom - y0, left - x0 : right - x0]
    return result


def record_statistics(
    generator: Generator, image: Tensor, proposal: Tensor, observer: Observer, palette: Tensor
) -> Statistics:
    """The statistics of every normalised layer for one image, (3, H, W), reduced to `STATISTICS_SIZE` if larger."""
    longest = max(image.shape[-2:])
    if longest > STATISTICS_SIZE:
        size = [max(round(side * STATISTICS_SIZE / longest), 1) for side in image.shape[-2:]]
        both = functional.interpolate(torch.stack([image, proposal]), size, mode="bilinear", antialias=True)
        image, proposal = both.clamp(0.0, 1.0)
    record: Statistics = {}
    with torch.inference_mode():
        _change(generator, image, proposal, observer, palette, None, record)
    return record


def average_statistics(records: list[Statistics]) -> Statistics:
    """Mean and variance over all images of a scene together, every image counting alike."""
    result: Statistics = {}
    for layer in records[0]:
        means, variances = (torch.cat([record[layer][i] for record in records]) for i in range(2))
        mean = means.mean(0, keepdim=True)
        result[layer] = (mean, (variances + (means - mean) ** 2).mean(0, keepdim=True))
    return result


def _change(
    generator: Generator,
    image: Tensor,
    proposal: Tensor,
    observer: Observer,
    palette: Tensor,
    statistics: Statistics | None,
    record: Statistics | None = None,
) -> Tensor:
    """(3, H, W) what to add to an image of any size, whose border is continued to whole strides."""
    height, width = image.shape[-2:]
    stride = generator.config.stride
    padding = (0, -width % stride, 0, -height % stride)
    images = torch.stack([image, proposal])
    seen = observer.simulate(images)
    images, seen = (functional.pad(batch, padding, mode="replicate") for batch in (images, seen))
    change = generator(
        images[:1],
        seen[:1],
        images[1:],
        seen[1:],
        observer_features(observer).to(image.device)[None],
        torch.tensor([float(observer.severity)], device=image.device),
        palette.to(image.device)[None],
        statistics,
        record,
    )
    return change[0, :, :height, :width]
