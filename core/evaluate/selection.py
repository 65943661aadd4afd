"""The frame filter of Hu and Xiao (2026): which frames are hard, and whether enhancement leaves easy ones alone.

A frame is hard where its CCPR is below 0.8, and a maximal run of more than 60 hard frames is a sequence to enhance.
Enhancement must not harm what needs none: easy frames are compared with their originals.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..capture.colmap import IMAGE_FOLDERS
from ..capture.files import list_images
from ..capture.images import downscale, fit_size, read_pixels
from ..color.metrics import ccpr, psnr, ssim
from ..color.simulation import simulate
from ..color.spaces import image_to_tensor
from ..enhance import Enhancer
from ..errors import InputError
from ..events import Reporter
from ..images import to_bytes
from ..settings import Layer
from .enhancers.scores import ENHANCED_FOR
from .tables import number, write_csv

STAGE = "selection"
HARD, BETWEEN, EASY = "hard", "between", "easy"


@dataclass(frozen=True)
class SelectionRule:
    """What is hard, what is easy, and what is a sequence.

    Attributes:
        hard_below: CCPR under which a frame is hard.
        longer_than: consecutive hard frames beyond which a run is a sequence.
        easy_above: CCPR over which a frame is easy.
    """

    hard_below: float = 0.8
    longer_than: int = 60
    easy_above: float = 0.97


@dataclass(frozen=True)
class Selection:
    """What the rule makes of a list of frames.

    Attributes:
        kinds: "hard", "between" or "easy" for each frame; "between" too where there is no contrast to keep (NaN).
        sequences: the maximal runs of hard frames that are long enough, as indices, in order.
    """

    kinds: tuple[str, ...]
    sequences: tuple[range, ...]


def select_frames(ccprs: Sequence[float], rule: SelectionRule = SelectionRule()) -> Selection:
    """Apply the rule to the CCPR of each frame, in the order of recording."""
    kinds = tuple(_kind(value, rule) for value in ccprs)
    sequences, start = [], 0
    for kind, frames in groupby(kinds):
        stop = start + len(list(frames))
        if kind == HARD and stop - start > rule.longer_than:
            sequences.append(range(start, stop))
        start = stop
    return Selection(kinds, tuple(sequences))


def _kind(value: float, rule: SelectionRule) -> str:
    if value < rule.hard_below:
        return HARD
    return EASY if value > rule.easy_above else BETWEEN


@dataclass(frozen=True)
class Frame:
    """A frame of a selection.

    Attributes:
        frame: its file's name.
        ccpr: of the frame as it is.
        kind: see `Selection`.
        sequence: number of the sequence that it is in, from 1 on; 0 for none.
        ssim, psnr: of the enhanced frame to the original.
    """

    frame: str
    ccpr: float
    kind: str
    sequence: int
    ssim: float
    psnr: float


def read_frames(folder: Path, size: int) -> dict[str, NDArray[np.uint8]]:
    """The photographs of a folder or a capture by name, in natural order, longer side at most `size` pixels.

    Raises:
        InputError: there are none, or one cannot be read.
    """
    place = next((folder / name for name in IMAGE_FOLDERS if (folder / name).is_dir()), folder)
    names = list_images(place) if place.is_dir() else []
    if not names:
        raise InputError("no photographs are there", where=folder, remedy="give a folder of photographs or a capture")
    frames = {}
    for name in names:
        pixels, _ = read_pixels(place / name, upright=True)
        height, width = pixels.shape[:2]
        frames[name] = downscale(pixels, *fit_size(width, height, size))
    return frames


def measure_selection(
    frames: dict[str, NDArray[np.uint8]],
    enhancer: Enhancer,
    observer: Layer,
    rule: SelectionRule = SelectionRule(),
    reporter: Reporter | None = None,
) -> list[Frame]:
    """Select among frames, and compare each with what the enhancer, fitted to all of them, makes of it."""
    reporter = reporter or Reporter()
    reporter.status(STAGE, "fitting the enhancer")
    enhancer.fit(list(frames.values()))
    figures = []
    for done, pixels in enumerate(frames.values()):
        original, enhanced = image_to_tensor(pixels), image_to_tensor(to_bytes(enhancer(pixels)))
        seen = simulate(original, observer.cvd, observer.severity, ENHANCED_FOR)
        figures.append((ccpr(original, seen)[0], ssim(original, enhanced), psnr(original, enhanced)))
        reporter.progress(STAGE, (done + 1) / len(frames))
    selection = select_frames([preserved for preserved, _, _ in figures], rule)
    sequence = {index: n for n, run in enumerate(selection.sequences, 1) for index in run}
    return [
        Frame(name, preserved, selection.kinds[i], sequence.get(i, 0), similarity, ratio)
        for i, (name, (preserved, similarity, ratio)) in enumerate(zip(frames, figures, strict=True))
    ]


def write_selection(folder: Path, frames: Sequence[Frame], rule: SelectionRule = SelectionRule()) -> str:
    """Write ``selection.csv`` and ``selection.md``; returns the text of the latter."""
    write_csv(folder / "selection.csv", Frame, frames)
    hard = [frame for frame in frames if frame.kind == HARD]
    lines = [f"{len(frames)} frames: {len(hard)} hard (CCPR below {rule.hard_below:g})."]
    for n in sorted({frame.sequence for frame in frames} - {0}):
        run = [frame.frame for frame in frames if frame.sequence == n]
        lines.append(f"- sequence {n}: {len(run)} frames, {run[0]} to {run[-1]}")
    if not any(frame.sequence for frame in frames):
        lines.append(f"- no run of more than {rule.longer_than} hard frames")
    easy = [frame for frame in frames if frame.kind == EASY]
    rest = [frame for frame in frames if frame.kind != HARD]
    lines += ["", "Enhanced against original:"]
    lines += [f"- {_likeness(easy)} on easy frames (CCPR above {rule.easy_above:g})"]
    lines += [f"- {_likeness(rest)} on all that are not hard"]
    text = "\n".join(lines) + "\n"
    (folder / "selection.md").write_text(text, encoding="utf-8")
    return text


def likeness(frames: Sequence[Frame]) -> tuple[float, float]:
    """Mean SSIM of the enhanced frames, and mean PSNR over those that changed at all; NaN where there is no frame."""
    if not frames:
        return math.nan, math.nan
    changed = [frame.psnr for frame in frames if math.isfinite(frame.psnr)]
    ratio = float(np.mean(changed)) if changed else math.inf
    return float(np.mean([frame.ssim for frame in frames])), ratio


def _likeness(frames: Sequence[Frame]) -> str:
    if not frames:
        return "no figures"
    similarity, ratio = likeness(frames)
    return f"SSIM {number(similarity, 3)}, PSNR {number(ratio, 1)} dB ({len(frames)} frames)"
