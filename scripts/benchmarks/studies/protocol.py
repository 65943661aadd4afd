"""The protocol of Hu and Xiao (2026) on photographs in recording order, such as the scenes of Mip-NeRF 360.

Sequences of frames that are hard for the observer are reconstructed and compared; easy frames are measured separately,
because enhancement must not harm them. Their Table 1 stands beside the same figures of ours. Part of
``benchmark.py table``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Any

import pandas as pd

from ....core.capture.reader import read_capture
from ....core.errors import InputError
from ....core.runtime.protocol import Reporter
from ....core.settings import Layer
from ..enhancers.frames import EASY, HARD, SelectionRule, likeness, measure_selection, select_frames
from ..enhancers.methods import LUT, SCENE, method_factory, method_label
from ..enhancers.scores import ENHANCED_FOR
from ..provenance import enhanced_product, fingerprint
from ..tables import Column, markdown_table, write_csv
from .captures import CaptureFolder, Subject
from .recipe import optimistic

ENHANCERS = (SCENE, LUT)
PAPERS_RULE = SelectionRule()
SSIM_TARGET = 0.975
"""Of easy frames; Hu and Xiao report 0.962."""
PSNR_TARGET = 34.0
"""dB, of easy frames; Hu and Xiao report 31.8."""
PAPERS_TABLE = (
    {"title": "photographs", "ccpr": 0.713, "ssim_simulated": 0.625},
    {"title": "conditional GAN, view by view", "mode": "post", "ccpr": 0.842, "ssim_simulated": 0.760, "rwe": 0.087},
    {"title": "the same", "mode": "joint", "ccpr": 0.839, "ssim_simulated": 0.758, "rwe": 0.033},
)
"""Means over their hard sequences, from Table 1 of Hu and Xiao (2026)."""
PAPER = "Hu and Xiao (2026)"
_KEYS: tuple[Column, ...] = (("capture", "capture", ""), ("title", "enhancer", ""), ("mode", "mode", ""))
_TABLE_ONE: tuple[Column, ...] = (
    ("ccpr", "CCPR", ".3f"),
    ("ssim_simulated", "SSIM to simulated", ".3f"),
    ("rwe", "RWE, L1", ".3f"),
    ("processor_seconds", "processor seconds", ".0f"),
)
_WHAT_DIFFERS = (
    "- **Scenes**: theirs are the hard sequences of Mip-NeRF 360, runs of more than 60 frames with a CCPR below 0.8; a "
    "capture that has none, as the first table says, has rows that compare with each other, not with theirs.",
    "- **Enhancer**: theirs is a conditional GAN that was trained beforehand and sees a view at a time; ours is fitted "
    "to the scene, and *LUT of each view* is the one here that sees a view at a time.",
    "- **Ours**: their integrated method fits geometry and colours to the enhanced views, which is `joint`; the "
    "product's own is `layers`, which fits the geometry to the photographs.",
    "- **SSIM to simulated**: of the photograph to the picture as the observer sees it, here with the simulation in "
    "linear light; they write a matrix product in RGB and do not say of which values.",
    "- **RWE**: their Eq. 10, a mean of ratios of pixels, has no bound where a photograph's own difference is near 0; "
    "their figures are of the size of mean absolute differences, and so that is what is given here.",
    "- **Cost**: theirs is 5,000 iterations in 100 to 110 s on an RTX 3090; ours is the "
    "number of steps said above, in seconds of one processor core.",
)
_MODELS = "sparse"  # folder with the cameras of a Mip-NeRF 360 scene
_COLUMNS: tuple[Column, ...] = (
    ("scene", "scene", ""),
    ("enhancer", "enhancer", ""),
    ("frames", "frames", "d"),
    ("hard", "hard", "d"),
    ("longest_run", "longest run", "d"),
    ("sequences", "sequences", "d"),
    ("easy", "easy", "d"),
    ("easy_ssim", "SSIM", ".3f"),
    ("easy_psnr", "PSNR", ".1f"),
    ("reached", "reached", ""),
    ("others_ssim", "SSIM, all not hard", ".3f"),
    ("others_psnr", "PSNR, all not hard", ".1f"),
)


@dataclass(frozen=True)
class FrameRun:
    """A sequence of a capture: a subject with these frames alone.

    Attributes:
        name: its name in tables.
        capture: the whole capture.
        first, last: indices of its views, inclusive.
    """

    name: str
    capture: CaptureFolder
    first: int
    last: int

    @property
    def key(self) -> str:
        return repr((self.capture.key, self.first, self.last))

    def load(self) -> Subject:
        whole = read_capture(self.capture.folder, max_size=self.capture.max_size)
        return Subject.of(replace(whole, views=whole.views[self.first : self.last + 1]))


def scenes_of(folder: Path, max_size: int) -> list[CaptureFolder]:
    """The scenes in a folder of scenes, or the folder itself if it is a scene.

    Raises:
        InputError: there is none.
    """
    places = [folder] if (folder / _MODELS).is_dir() else sorted(path.parent for path in folder.glob(f"*/{_MODELS}"))
    if not places:
        remedy = "give a folder with images_4/ and sparse/0/, or one with such folders in it"
        raise InputError("no scene in the layout of Mip-NeRF 360", where=folder, remedy=remedy)
    return [CaptureFolder(place.resolve().name, place, max_size) for place in places]


def filter_frames(
    source: CaptureFolder, enhancers: Sequence[str], observer: Layer, folder: Path, reporter: Reporter
) -> dict[str, pd.DataFrame]:
    """The frames of a capture by enhancer, as from `measure_selection`; stored in `folder` for the next call."""
    found = {}
    for name in enhancers:
        label = method_label(name)
        key = fingerprint(f"{source.key} {name}", enhanced_product)
        path = folder / f"{source.name}-{source.max_size}-{observer.name}-{label}-{key}.csv"
        if path.is_file():
            found[label] = pd.read_csv(path, dtype={"frame": str}, float_precision="round_trip")
            continue
        views = read_capture(source.folder, max_size=source.max_size).views
        enhancer = method_factory(name)(observer.cvd, observer.severity, ENHANCED_FOR)
        frames = {view.key: view.image for view in views}
        shown = [view.shown for view in views]
        found[label] = measure_selection(frames, enhancer, observer, reporter=reporter, shown=shown)
        path.parent.mkdir(parents=True, exist_ok=True)
        found[label].to_csv(path, index=False, na_rep="nan")
    return found


def sequences_of(source: CaptureFolder, frames: pd.DataFrame, rule: SelectionRule = PAPERS_RULE) -> list[FrameRun]:
    """The runs of hard frames that are long enough."""
    runs = select_frames(frames.ccpr.tolist(), rule).sequences
    return [
        FrameRun(f"{source.name}-{count}", source, run.start, run.stop - 1) for count, run in enumerate(runs, start=1)
    ]


def summarise(scene: str, enhancer: str, frames: pd.DataFrame) -> dict[str, Any]:
    """A row of ``frames.csv``: counts of frames, and the means of `likeness` for easy ones and for all not hard."""
    runs = [len(list(group)) for kind, group in groupby(frames.kind) if kind == HARD]
    easy_ssim, easy_psnr = likeness(frames[frames.kind == EASY])
    others_ssim, others_psnr = likeness(frames[frames.kind != HARD])
    return {
        "scene": scene,
        "enhancer": enhancer,
        "frames": len(frames),
        "hard": int((frames.kind == HARD).sum()),
        "longest_run": max(runs, default=0),
        "sequences": frames.sequence[frames.sequence > 0].nunique(),
        "easy": int((frames.kind == EASY).sum()),
        "easy_ssim": easy_ssim,
        "easy_psnr": easy_psnr,
        "others_ssim": others_ssim,
        "others_psnr": others_psnr,
    }


def table_one(trials: pd.DataFrame) -> pd.DataFrame:
    """Table 1 of the paper, and behind it the same figures of ours.

    Args:
        trials: columns of `Trial`, and ``title`` (of the enhancer); only what was tried in mode `post` too
            is compared.

    Returns:
        ``capture``, ``title``, ``mode``, and the means over the seeds of ``ccpr``, ``ssim_simulated``, ``rwe`` (mean
        absolute difference) and ``processor_seconds``; NaN where there is no such figure.
    """
    keys, figures = [name for name, _, _ in _KEYS], [name for name, _, _ in _TABLE_ONE]
    trials = trials.assign(rwe=trials.rwe_absolute)
    both = trials.groupby(keys[:2])["mode"].transform(lambda modes: "post" in set(modes))
    parts = [pd.DataFrame(PAPERS_TABLE).assign(capture=PAPER)]
    for capture, mine in trials[both].groupby("capture", sort=False):
        inputs = mine[["ccpr_input", "ssim_input"]].mean()
        photographs = {"ccpr": inputs.ccpr_input, "ssim_simulated": inputs.ssim_input}
        parts.append(pd.DataFrame([{"capture": capture, "title": "photographs", **photographs}]))
        parts.append(mine.groupby(keys, sort=False)[figures].mean().reset_index())
    return pd.concat(parts)[[*keys, *figures]].fillna({"mode": ""})


def write_frames(
    folder: Path,
    scenes: pd.DataFrame,
    trials: pd.DataFrame,
    heading: Sequence[str],
) -> list[str]:
    """Write ``frames.csv``; returns the lines of the text.

    Args:
        scenes: rows of `summarise`.
        trials: as for `table_one`.
    """
    rule = PAPERS_RULE
    write_csv(folder / "frames.csv", scenes)
    reached = (scenes.easy_ssim >= SSIM_TARGET) & (scenes.easy_psnr >= PSNR_TARGET)
    verdicts = reached.map({True: "yes", False: "no"}).where(scenes.easy > 0, "no easy frame")
    return [
        "# Hard and easy frames",
        "",
        *heading,
        "",
        f"Observer: deutan 1.0. A frame is hard where its CCPR is below {rule.hard_below:g}; a run of more than "
        f"{rule.longer_than} hard frames is a sequence, which is reconstructed and compared; a frame is easy where its "
        f"CCPR is above {rule.easy_above:g}. SSIM and PSNR are of the enhanced easy frames to the originals, PSNR over "
        f"those that changed. To be reached: SSIM {SSIM_TARGET:g} and PSNR {PSNR_TARGET:g} dB.",
        "",
        *markdown_table(scenes.assign(reached=verdicts), _COLUMNS),
        "",
        "## Their Table 1, and ours",
        "",
        *optimistic(trials),
        *markdown_table(table_one(trials), [*_KEYS, *_TABLE_ONE]),
        "",
        *_WHAT_DIFFERS,
    ]
