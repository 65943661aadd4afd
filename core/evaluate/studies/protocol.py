"""The protocol of Hu and Xiao (2026) on photographs in the order of recording, such as the scenes of Mip-NeRF 360.

Frames that are hard for the observer make up sequences, and these are what is reconstructed and compared; frames that
are easy are measured apart, because enhancement must not harm what needs none.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import groupby
from pathlib import Path

from ...capture import read_capture
from ...errors import InputError
from ...events import Reporter
from ...settings import Layer
from ..enhancers.methods import LUT, NETWORK, method_factory, method_label
from ..enhancers.scores import ENHANCED_FOR
from ..selection import EASY, HARD, Frame, SelectionRule, likeness, measure_selection, select_frames
from ..tables import markdown_table, number, write_csv
from .subject import CaptureFolder, Subject

ENHANCERS = (NETWORK, LUT)
PAPERS_RULE = SelectionRule()
SSIM_TO_REACH = 0.975
"""Of easy frames; Hu and Xiao report 0.962."""
PSNR_TO_REACH = 34.0
"""dB, of easy frames; Hu and Xiao report 31.8."""
_MODELS = "sparse"  # folder of a Mip-NeRF 360 scene that holds its cameras


@dataclass(frozen=True)
class FrameRun:
    """A sequence of a capture: a subject of these frames alone.

    Attributes:
        name: what tables call it.
        capture: that it is a part of.
        first, last: of its views, both included.
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


@dataclass(frozen=True)
class SceneFrames:
    """The frames of a scene, and what an enhancer does to them.

    Attributes:
        scene, enhancer: what was measured.
        frames, hard, easy: their numbers; see `SelectionRule`.
        longest_run: of hard frames.
        sequences: runs that are long enough.
        easy_ssim, easy_psnr: of the enhanced easy frames to the originals.
        others_ssim, others_psnr: of all that are not hard.
    """

    scene: str
    enhancer: str
    frames: int
    hard: int
    longest_run: int
    sequences: int
    easy: int
    easy_ssim: float
    easy_psnr: float
    others_ssim: float
    others_psnr: float


def scenes_of(folder: Path, max_size: int) -> list[CaptureFolder]:
    """The scenes in a folder of scenes, or the folder itself where it is one.

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
) -> dict[str, list[Frame]]:
    """The frames of a capture by enhancer; kept in `folder` for the next call."""
    found = {}
    for name in enhancers:
        label = method_label(name)
        path = folder / f"{source.name}-{source.max_size}-{observer.name}-{label}.json"
        if path.is_file():
            found[label] = [Frame(**values) for values in json.loads(path.read_text(encoding="utf-8"))]
            continue
        views = read_capture(source.folder, max_size=source.max_size).views
        enhancer = method_factory(name)(observer.cvd, observer.severity, ENHANCED_FOR)
        frames = {view.key: view.image for view in views}
        found[label] = measure_selection(frames, enhancer, observer, reporter=reporter)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps([asdict(frame) for frame in found[label]]), encoding="utf-8")
    return found


def sequences_of(source: CaptureFolder, frames: Sequence[Frame], rule: SelectionRule = PAPERS_RULE) -> list[FrameRun]:
    """The runs of hard frames that are long enough."""
    runs = select_frames([frame.ccpr for frame in frames], rule).sequences
    return [
        FrameRun(f"{source.name}-{count}", source, run.start, run.stop - 1) for count, run in enumerate(runs, start=1)
    ]


def summarise(scene: str, enhancer: str, frames: Sequence[Frame]) -> SceneFrames:
    """The figures of a scene."""
    runs = [len(list(group)) for kind, group in groupby(frame.kind for frame in frames) if kind == HARD]
    easy = [frame for frame in frames if frame.kind == EASY]
    easy_ssim, easy_psnr = likeness(easy)
    others_ssim, others_psnr = likeness([frame for frame in frames if frame.kind != HARD])
    return SceneFrames(
        scene=scene,
        enhancer=enhancer,
        frames=len(frames),
        hard=sum(frame.kind == HARD for frame in frames),
        longest_run=max(runs, default=0),
        sequences=len({frame.sequence for frame in frames} - {0}),
        easy=len(easy),
        easy_ssim=easy_ssim,
        easy_psnr=easy_psnr,
        others_ssim=others_ssim,
        others_psnr=others_psnr,
    )


def write_frames(
    folder: Path, scenes: Sequence[SceneFrames], heading: Sequence[str], rule: SelectionRule = PAPERS_RULE
) -> list[str]:
    """Write ``frames.csv``; returns the lines of the text."""
    write_csv(folder / "frames.csv", SceneFrames, scenes)
    header = ["scene", "enhancer", "frames", "hard", "longest run", "sequences", "easy", "SSIM", "PSNR", "reached"]
    header += ["SSIM, all not hard", "PSNR, all not hard"]
    body = [
        [scene.scene, scene.enhancer]
        + [str(count) for count in (scene.frames, scene.hard, scene.longest_run, scene.sequences, scene.easy)]
        + [number(scene.easy_ssim, 3), number(scene.easy_psnr, 1), _reached(scene)]
        + [number(scene.others_ssim, 3), number(scene.others_psnr, 1)]
        for scene in scenes
    ]
    return [
        "# Hard and easy frames",
        "",
        *heading,
        "",
        f"Observer: deutan 1.0. A frame is hard where its CCPR is below {rule.hard_below:g}; a run of more than "
        f"{rule.longer_than} hard frames is a sequence, which is reconstructed and compared; a frame is easy where its "
        f"CCPR is above {rule.easy_above:g}. SSIM and PSNR are of the enhanced easy frames to the originals, PSNR over "
        f"those that changed. To be reached: SSIM {SSIM_TO_REACH:g} and PSNR {PSNR_TO_REACH:g} dB.",
        "",
        *markdown_table(header, body),
    ]


def _reached(scene: SceneFrames) -> str:
    if not scene.easy:
        return "no easy frame"
    return "yes" if scene.easy_ssim >= SSIM_TO_REACH and scene.easy_psnr >= PSNR_TO_REACH else "no"
