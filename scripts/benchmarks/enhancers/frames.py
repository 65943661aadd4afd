"""The frame filter of Hu and Xiao (2026): which frames are hard, and whether enhancement leaves easy ones unchanged.

A frame is hard if its CCPR is below 0.8, and a maximal run of more than 60 hard frames is a sequence to enhance.
Enhancement must not harm easy frames: these are compared with their originals. Command: ``benchmark.py select``.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray

from ....core.capture.files import IMAGE_FOLDERS
from ....core.color.metrics import ccpr, psnr, ssim
from ....core.color.simulation import simulate
from ....core.color.spaces import image_to_tensor
from ....core.enhance import Enhancer, enhance_bytes
from ....core.enhance.pairs import Alphas
from ....core.runtime.cli import ConsoleReporter
from ....core.runtime.protocol import Reporter
from ....core.settings import Layer
from ..options import Part, positive
from ..tables import number, write_csv, write_text
from .image_sets import read_images
from .methods import method_factory
from .scores import ENHANCED_FOR

STAGE = "selection"
HARD, BETWEEN, EASY = "hard", "between", "easy"
_COVERED = 127  # alpha above which a pixel counts, as in evaluations


@dataclass(frozen=True)
class SelectionRule:
    """When a frame is hard or easy, and a run of hard frames a sequence.

    Attributes:
        hard_below: CCPR below which a frame is hard.
        longer_than: consecutive hard frames above which a run is a sequence.
        easy_above: CCPR above which a frame is easy.
    """

    hard_below: float = 0.8
    longer_than: int = 60
    easy_above: float = 0.97


@dataclass(frozen=True)
class Selection:
    """The kinds of a list of frames.

    Attributes:
        kinds: "hard", "between" or "easy" for each frame; "between" also where there is no contrast to preserve (NaN).
        sequences: the maximal runs of hard frames that are long enough, as indices, in order.
    """

    kinds: tuple[str, ...]
    sequences: tuple[range, ...]


def select_frames(ccprs: Sequence[float], rule: SelectionRule = SelectionRule()) -> Selection:
    """Apply the rule to the CCPR of each frame, in recording order."""
    kinds = tuple(HARD if x < rule.hard_below else EASY if x > rule.easy_above else BETWEEN for x in ccprs)
    sequences, start = [], 0
    for kind, frames in groupby(kinds):
        stop = start + len(list(frames))
        if kind == HARD and stop - start > rule.longer_than:
            sequences.append(range(start, stop))
        start = stop
    return Selection(kinds, tuple(sequences))


def read_frames(folder: Path, size: int) -> dict[str, NDArray[np.uint8]]:
    """The photographs of a folder or a capture by name, in natural order, longer side at most `size` pixels.

    Raises:
        InputError: there are none, or one cannot be read.
    """
    return read_images(next((folder / name for name in IMAGE_FOLDERS if (folder / name).is_dir()), folder), size)


def measure_selection(
    frames: dict[str, NDArray[np.uint8]],
    enhancer: Enhancer,
    observer: Layer,
    rule: SelectionRule = SelectionRule(),
    reporter: Reporter | None = None,
    *,
    shown: Alphas = None,
) -> pd.DataFrame:
    """Select among frames, and compare each with its enhancement; the enhancer is fitted to all of them.

    Args:
        shown: of each frame, as `View.shown`; None where all pixels count.

    Returns:
        A row for each ``frame``: ``ccpr`` of the original; ``kind``, see `Selection`; ``sequence``, the number of its
        sequence from 1 on, 0 for none; ``ssim`` and ``psnr`` of the enhanced frame to the original.
    """
    reporter = reporter or Reporter()
    reporter.status(STAGE, "fitting the enhancer")
    shown = shown or [None] * len(frames)
    enhancer.fit(list(frames.values()), alphas=shown)
    rows = []
    for done, ((name, pixels), alpha) in enumerate(zip(frames.items(), shown, strict=True)):
        original, enhanced = image_to_tensor(pixels), image_to_tensor(enhance_bytes(enhancer, pixels, alpha))
        seen = simulate(original, observer.cvd, observer.severity, ENHANCED_FOR)
        mask = None if alpha is None else torch.from_numpy(alpha > _COVERED)
        likenesses = (compare(original, enhanced, mask=mask) for compare in (ssim, psnr))
        rows.append((name, ccpr(original, seen, mask=mask)[0], *likenesses))
        reporter.progress(STAGE, (done + 1) / len(frames))
    found = pd.DataFrame(rows, columns=["frame", "ccpr", "ssim", "psnr"])
    selection = select_frames(found.ccpr.tolist(), rule)
    sequence = {index: n for n, run in enumerate(selection.sequences, 1) for index in run}
    found = found.assign(kind=selection.kinds, sequence=[sequence.get(index, 0) for index in found.index])
    return found[["frame", "ccpr", "kind", "sequence", "ssim", "psnr"]]


def write_selection(folder: Path, frames: pd.DataFrame, rule: SelectionRule = SelectionRule()) -> str:
    """Write ``selection.csv`` and ``selection.md``; returns the text of the latter."""
    write_csv(folder / "selection.csv", frames)
    lines = [f"{len(frames)} frames: {(frames.kind == HARD).sum()} hard (CCPR below {rule.hard_below:g})."]
    for n, run in frames[frames.sequence > 0].groupby("sequence")["frame"]:
        lines.append(f"- sequence {n}: {len(run)} frames, {run.iloc[0]} to {run.iloc[-1]}")
    if not frames.sequence.any():
        lines.append(f"- no run of more than {rule.longer_than} hard frames")
    lines += ["", "Enhanced against original:"]
    lines += [f"- {_in_words(frames[frames.kind == EASY])} on easy frames (CCPR above {rule.easy_above:g})"]
    lines += [f"- {_in_words(frames[frames.kind != HARD])} on all that are not hard"]
    return write_text(folder / "selection.md", lines)


def likeness(frames: pd.DataFrame) -> tuple[float, float]:
    """Mean SSIM of the enhanced frames, and mean PSNR of those that changed; NaN without any frame."""
    if frames.empty:
        return math.nan, math.nan
    changed = frames.psnr[np.isfinite(frames.psnr)]
    return float(frames.ssim.mean()), math.inf if changed.empty else float(changed.mean())


def _in_words(frames: pd.DataFrame) -> str:
    if frames.empty:
        return "no figures"
    similarity, ratio = likeness(frames)
    return f"SSIM {number(similarity, '.3f')}, PSNR {number(ratio, '.1f')} dB ({len(frames)} frames)"


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("frames", type=Path, metavar="FOLDER", help="photographs in recording order, or a capture")
    add("--enhancer", default="lut", help="name or weight file (lut)")
    add("--cvd", default="deutan", metavar="TYPE", help="type (deutan)")
    add("--severity", type=float, default=1.0, metavar="0..1", help="severity (1)")
    add("--max-size", type=positive, default=640, metavar="PIXELS", help="longer side of the frames (640)")


def _measure(options: argparse.Namespace) -> str:
    """Select among the frames of a folder; writes selection.csv and selection.md."""
    frames = read_frames(options.frames, options.max_size)
    observer = Layer(options.cvd, options.severity)
    enhancer = method_factory(options.enhancer)(observer.cvd, observer.severity, ENHANCED_FOR)
    found = measure_selection(frames, enhancer, observer, reporter=ConsoleReporter(sys.stderr))
    return write_selection(options.out, found)


PART = Part("select", "hard frames and sequences of a folder, and how easy frames change", _add_arguments, _measure)
