"""What docs/enhancer shows of a training: its curve, and what the weights make of pictures that were kept from it."""

from __future__ import annotations

import csv
import shutil
import tempfile
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...core.enhance import CganEnhancer, Enhancer, SceneNetworkEnhancer
from ...core.files.images import read_png, to_bytes, write_jpeg
from ...core.settings import Layer
from ..benchmarks.charts import Theme, plot_series, write_charts
from ..benchmarks.enhancers.pictures import write_contact_sheet
from .data.kinds import draw
from .gan.training import LOG, WEIGHTS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_OBSERVER, _MODEL = Layer("deutan", 1.0), "machado"
_SAMPLES = ("still life", "print", "foliage")
_JPEG_QUALITY = 88
_HIGHEST = 1.2  # of the relative objectives that are shown; a single picture that is spoilt would hide all others
_SAMPLE_SEED, _SAMPLE_SIDE = 30_000_001, 256  # training counts up from small seeds; pixels


def write_report(training: Path, folder: Path) -> None:
    """Write ``curve.svg``, ``curve.csv`` and ``samples.jpg`` of a training into `folder`.

    Raises:
        InputError: its weights cannot be used, or matplotlib is missing.
    """
    with open(training / LOG, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    write_charts(folder, "curve", (7.2, 3.0), partial(_draw, rows), formats=("svg",))
    shutil.copyfile(training / LOG, folder / "curve.csv")
    images = [_versions(_sample(kind), training / WEIGHTS) for kind in _SAMPLES]
    with tempfile.TemporaryDirectory() as temporary:
        sheet = Path(temporary) / "samples.png"
        write_contact_sheet(sheet, images, _OBSERVER, _MODEL)
        write_jpeg(folder / "samples.jpg", read_png(sheet), _JPEG_QUALITY)


def _draw(rows: list[dict[str, str]], figure: Figure, theme: Theme) -> None:
    steps = [int(row["step"]) for row in rows]
    left, right = figure.subplots(1, 2)
    for key, label, style in zip(("objective", "kept"), ("in training", "kept scenes"), theme.series, strict=False):
        plot_series(left, steps, [float(row[key]) for row in rows], style, label)
    for key, label, style in zip(
        ("adversarial", "discriminator"), ("generator", "discriminator"), theme.series, strict=False
    ):
        told = [row for row in rows if row[key]]  # without an adversary there is nothing
        plot_series(right, [int(row["step"]) for row in told], [float(row[key]) for row in told], style, label)
    left.set(title="objective over the untouched picture's", xlabel="step", ylim=(0.0, _HIGHEST))
    right.set(title="cross entropy of the adversaries", xlabel="step")
    left.legend()
    right.legend()


def _sample(kind: str) -> NDArray[np.uint8]:
    return draw(kind, _SAMPLE_SIDE, _SAMPLE_SIDE, np.random.default_rng(_SAMPLE_SEED), _OBSERVER.cvd).image


def _versions(image: NDArray[np.uint8], weights: Path) -> dict[str, NDArray[np.uint8]]:
    """The picture, predicted, predicted and briefly fitted, and fitted from nothing."""
    who = (_OBSERVER.cvd, _OBSERVER.severity, _MODEL)
    enhancers: dict[str, Enhancer] = {
        "predicted": CganEnhancer(*who, weights=weights, fit_steps=0),
        "25 steps of a fit": CganEnhancer(*who, weights=weights, fit_steps=25),
        "scene": SceneNetworkEnhancer(*who),
    }
    versions = {"original": image}
    for name, enhancer in enhancers.items():
        enhancer.fit([image])
        versions[name] = to_bytes(enhancer(image))
    return versions
