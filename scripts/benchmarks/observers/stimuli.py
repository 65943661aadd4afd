"""The pictures of a study: photographs as each method enhances them, and turntables of finished runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ....core.capture.scaling import downscale, fit_size
from ....core.errors import InputError
from ....core.files.images import read_png, to_bytes
from ....core.files.untrusted import is_folder
from ....core.runs.layout import ORIGINAL, TURNTABLE_FOLDER, spread_over_turn
from ....core.settings import Layer
from ..baselines import ContrastGain, mean_delta_e_2000
from ..embedding import jpeg_uri
from ..enhancers.methods import GAIN, LUT, SCENE, method_factory
from ..studies.captures import CaptureFolder
from .study import STILL, TURNTABLE, Stimulus, Version

Image = NDArray[np.uint8]

METHODS = (ORIGINAL, LUT, SCENE, GAIN)
SEVERITY, SIMULATION = 1.0, "machado"
_QUALITY = 92
_PNG = "*.png"


def stills(source: CaptureFolder, cvd: str, count: int) -> list[Stimulus]:
    """Photographs that no method was fitted to, as each of `METHODS` shows them.

    The contrast gain changes the chosen photographs by the same mean ΔE00 as the scene network.

    Args:
        cvd: the type of the observer, with severity 1.
        count: of photographs, spread over those held out; fewer where there are fewer.

    Raises:
        InputError: the capture cannot be read, or no photograph is held out.
    """
    subject = source.load()
    views = subject.judged.views
    held_out = subject.judged_split.test
    if not held_out:
        raise InputError("no photograph is held out", where=source.name, remedy="use a capture of nine views or more")
    chosen = [held_out[place] for place in sorted({round(i) for i in np.linspace(0, len(held_out) - 1, count)})]
    originals = [views[index].image for index in chosen]
    fitted_to = [subject.given.views[index].image for index in subject.split.train]
    made: dict[str, list[Image]] = {ORIGINAL: originals}
    for name in (LUT, SCENE):
        enhancer = method_factory(name)(cvd, SEVERITY, SIMULATION)
        enhancer.fit(fitted_to)
        made[name] = [to_bytes(enhancer(image)) for image in originals]
    made[GAIN] = matched_by_gain(originals, made[SCENE])
    return [
        Stimulus(cvd, STILL, f"{source.name} {views[index].key}", _versions({m: [made[m][place]] for m in METHODS}))
        for place, index in enumerate(chosen)
    ]


def matched_by_gain(originals: Sequence[Image], enhanced: Sequence[Image]) -> list[Image]:
    """The originals with their contrast raised until their mean ΔE00 is that of the enhanced ones."""
    changes = [mean_delta_e_2000(*pair) for pair in zip(originals, enhanced, strict=True)]
    gain = ContrastGain(float(np.mean(changes)), difference=mean_delta_e_2000)
    gain.fit(originals)
    return [to_bytes(gain(image)) for image in originals]


def turntables(runs: Mapping[str, Path], cvd: str, frames: int, max_size: int) -> list[Stimulus]:
    """One stimulus: the turntable of the first run in original colours, and of every run in a layer for the type.

    Args:
        runs: folders of finished runs by the names of their methods; none gives nothing.
        frames: of a turn, as far apart as can be.
        max_size: longer side in pixels.

    Raises:
        InputError: a run has no turntable of such a layer, or their lengths differ.
    """
    if not runs:
        return []
    name, first = next(iter(runs.items()))
    folders = {ORIGINAL: first / TURNTABLE_FOLDER / ORIGINAL}
    folders |= {name: _layer_folder(run, cvd) for name, run in runs.items()}
    files = {method: sorted(folder.glob(_PNG)) for method, folder in folders.items()}
    for method, found in files.items():
        if len(found) != len(files[ORIGINAL]) or not found:
            remedy = "give runs whose turntables have the same number of frames (run.py --turntable 48)"
            raise InputError(f"{len(found)} frames of a turntable", where=folders[method], remedy=remedy)
    numbers = spread_over_turn(len(files[ORIGINAL]), frames)
    pictures = {
        method: [_at_most(read_png(found[number - 1]), max_size) for number in numbers]
        for method, found in files.items()
    }
    return [Stimulus(cvd, TURNTABLE, name, _versions(pictures))]


def _layer_folder(run: Path, cvd: str) -> Path:
    layer = Layer(cvd, SEVERITY).name  # as the stills
    place = run / TURNTABLE_FOLDER / layer
    if not is_folder(place):
        remedy = f"add it with scripts/run.py --resume --cvd {cvd} --turntable 48, or leave out --cvd {cvd}"
        raise InputError(f"there is no turntable for {layer}", where=place.parent, remedy=remedy)
    return place


def _versions(pictures: Mapping[str, Sequence[Image]]) -> tuple[Version, ...]:
    originals = pictures[ORIGINAL]
    return tuple(
        Version(
            method,
            tuple(jpeg_uri(image, _QUALITY) for image in images),
            float(np.mean([mean_delta_e_2000(*pair) for pair in zip(originals, images, strict=True)])),
        )
        for method, images in pictures.items()
    )


def _at_most(image: Image, max_size: int) -> Image:
    height, width = image.shape[:2]
    width, height = fit_size(width, height, max_size)
    return downscale(image, width, height)
