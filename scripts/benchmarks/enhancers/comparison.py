"""Compares enhancers on image sets: every image, observer and method, and what partial strength costs and gains.

Two controls are part of every comparison: the image as it is (`none`), and plain contrast gain that changes each image
as much as the scene network does (`gain`). Each method is fitted to each image alone, as it would be to a scene.
Command: ``benchmark.py enhancer``.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray

from ....core.enhance import Enhancer
from ....core.errors import InputError
from ....core.intake.sampling import evenly_spread
from ....core.runtime.cli import ConsoleReporter
from ....core.runtime.protocol import Reporter
from ....core.settings import Layer
from ...training.data.plates import SMALLEST_PLATE
from ..options import Part, named_path, names, numbers, positive
from ..provenance import enhanced_product
from .image_sets import PLATE_TYPES, ImageSet, TestImage, fresh_plates, fresh_textiles, read_photographs
from .methods import (
    GAIN,
    LUT,
    NONE,
    SCENE,
    blend,
    check_labels,
    enhance,
    gain_references,
    is_network,
    matched_gain,
    method_factory,
    method_label,
    seconds_per_megapixel,
)
from .pictures import write_chart, write_contact_sheet
from .report import image_class, write_comparison
from .scores import ENHANCED_FOR, Enhanced, Judge
from .summaries import JUDGES_PAGE, SEVERITIES_PAGE, write_summaries

STAGE = "enhancers"
STRENGTHS = (0.25, 0.5, 0.75, 1.0)
_SHOWN = 3  # images of each set on its contact sheets
_IMAGES_AT_A_TIME = 4  # enough that loading a network does not matter, few enough that processes finish together
TRADE_OFFS = ["image_set", "image", "cvd", "severity", "method", "strength", "ccpr", "delta_e_76"]
ALL_ENHANCERS = ("none", "gain", "fidaner", "lut", "scene", "cgan")
QUICK: dict[str, Any] = {
    "types": ("protan", "deutan"),
    "severities": (1.0,),
    "size": 256,
    "plates": 10,
    "textiles": 6,
    "most_photographs": 6,
    "other_models": False,
    "trade_off": False,
}
"""The comparison under `--quick`: enough to monitor a training, in less than a minute without the LUT."""


@dataclass(frozen=True)
class EnhancerBenchmark:
    """A comparison with its image sets.

    Attributes:
        methods: names or weight files.
        photographs: name and folder of each set.
        types, severities: of the observers, in every combination.
        size: longer side of the images in pixels.
        plates: number for each type.
        textiles: number in all.
        most_photographs: of a set; None for all.
        other_models: whether to score under Viénot and Brettel too.
        trade_off: whether the trade-off is measured and drawn.
        processes: number of parallel processes; with several, each uses one thread.
    """

    methods: tuple[str, ...]
    photographs: dict[str, Path] = field(default_factory=dict)
    types: tuple[str, ...] = PLATE_TYPES
    severities: tuple[float, ...] = (0.4, 0.7, 1.0)
    size: int = 384
    plates: int = 40
    textiles: int = 20
    most_photographs: int | None = None
    other_models: bool = True
    trade_off: bool = True
    processes: int = 1

    @property
    def observers(self) -> tuple[Layer, ...]:
        """Every type at every severity."""
        return tuple(Layer(cvd, severity) for severity, cvd in product(self.severities, self.types))

    @property
    def enhancers(self) -> tuple[str, ...]:
        """The methods without contrast gain; `none` is always included, and first."""
        return NONE, *(name for name in self.methods if name not in (NONE, GAIN))

    def run(self, folder: Path, reporter: Reporter | None = None) -> str:
        """Measure and write everything into `folder`; returns the text of ``enhancer.md``.

        Raises:
            InputError: a method, a type or a folder that cannot be used.
        """
        if not self.methods:
            raise InputError("no enhancer is named", where="--enhancers", remedy="name some, e.g. none,gain,lut")
        check_labels(self.methods)
        if self.size < SMALLEST_PLATE:
            remedy = f"give at least {SMALLEST_PLATE}"
            raise InputError(f"images of {self.size} pixels are too small", where="--size", remedy=remedy)
        image_sets = self._image_sets()
        found = compare_enhancers(image_sets, self, reporter)
        counts = ", ".join(f"{image_set.name} ({len(image_set.images)})" for image_set in image_sets)
        what = f"Images of at most {self.size} pixels: {counts}. Each method was fitted to each image alone."
        scores, trade_offs = pd.DataFrame(found.scores), pd.DataFrame(found.trade_offs, columns=TRADE_OFFS)
        text = write_comparison(folder, scores, trade_offs, found.seconds, image_sets, self._candidate(), what)
        write_summaries(folder, scores, image_sets, what)
        points = trade_offs[trade_offs.image_set.isin(self.photographs)]
        if not points.empty:
            write_chart(folder, "enhancer", points, "CCPR of hard photographs against change")
        for name, observer in dict.fromkeys((shown.image_set, shown.observer) for shown in found.shown):
            images = [x.versions for x in found.shown if (x.image_set, x.observer) == (name, observer)]
            write_contact_sheet(folder / f"sheet-{name}-{observer.name}.png", images, observer, ENHANCED_FOR)
        return text

    def _image_sets(self) -> list[ImageSet]:
        sets = [
            read_photographs(name, folder, self.size, self.most_photographs)
            for name, folder in self.photographs.items()
        ]
        sets += [fresh_plates(self.plates, self.size, self.types)] if self.plates else []
        sets += [fresh_textiles(self.textiles, self.size)] if self.textiles else []
        if not sets:
            raise InputError("there are no images to compare on", where="--images", remedy="give NAME=FOLDER")
        return sets

    def _candidate(self) -> str:
        """The method of the headline: the scene network, else a trained one, else the LUT, else the last of all."""
        compared = [name for name in self.methods if name not in (NONE, GAIN)] or [NONE]
        ranks = (lambda name: name == SCENE, is_network, lambda name: name == LUT)
        ranked = [name for is_one in ranks for name in compared if is_one(name)]
        return method_label((ranked or compared[-1:])[0])


@dataclass(frozen=True)
class Shown:
    """An image for the contact sheets: its versions by the methods' labels."""

    image_set: str
    observer: Layer
    versions: dict[str, NDArray[np.uint8]]


@dataclass(frozen=True)
class Comparison:
    """The result of a comparison.

    Attributes:
        scores: rows of `Judge.score` for every image set, observer, image and method.
        trade_offs: rows of `TRADE_OFFS` for each method at `STRENGTHS` on the hard images, for the strongest observers.
        shown: some images of each set, for the strongest observers.
        seconds: per megapixel, by the label of the method.
    """

    scores: list[dict[str, Any]] = field(default_factory=list)
    trade_offs: list[tuple[Any, ...]] = field(default_factory=list)
    shown: list[Shown] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)

    def add(self, part: Comparison) -> None:
        """Append the results for other images."""
        self.scores.extend(part.scores)
        self.trade_offs.extend(part.trade_offs)
        self.shown.extend(part.shown)


def compare_enhancers(
    image_sets: Sequence[ImageSet], plan: EnhancerBenchmark, reporter: Reporter | None = None
) -> Comparison:
    """Measure every method on every image for every observer.

    Raises:
        InputError: a method that does not exist, or gain without anything to match.
    """
    reporter = reporter or Reporter()
    if GAIN in plan.methods:
        gain_references(plan.methods)  # raises before anything takes time
    comparison = Comparison(seconds=_time_methods(plan, image_sets[0].images[0]))
    parts = list(_parts(image_sets, plan))
    with contextlib.ExitStack() as stack:
        results: Iterable[Comparison] = map(_compare, parts)
        if plan.processes > 1:
            # Not forked: torch's threads do not survive it.
            context = get_context("spawn")
            pool = ProcessPoolExecutor(plan.processes, context, initializer=torch.set_num_threads, initargs=(1,))
            results = stack.enter_context(pool).map(_compare, parts)
        for done, (part, found) in enumerate(zip(parts, results, strict=True)):
            comparison.add(found)
            reporter.progress(STAGE, (done + 1) / len(parts), f"{part.observer.name}, {part.image_set}")
    return comparison


@dataclass(frozen=True)
class _Part:
    """Some images of a set for one observer: the unit of work of a process.

    Attributes:
        plan: of the whole comparison.
        observer, image_set: the observer and the set's name.
        images: of the set.
        shown: names of those to keep.
    """

    plan: EnhancerBenchmark
    observer: Layer
    image_set: str
    images: tuple[TestImage, ...]
    shown: frozenset[str]


def _parts(image_sets: Sequence[ImageSet], plan: EnhancerBenchmark) -> Iterator[_Part]:
    """Every image for every observer that it concerns."""
    for observer, image_set in product(plan.observers, image_sets):
        images = [image for image in image_set.images if image.cvd in (None, observer.cvd)]
        shown = frozenset(images[index].name for index in evenly_spread(range(len(images)), _SHOWN))
        for start in range(0, len(images), _IMAGES_AT_A_TIME):
            some = tuple(images[start : start + _IMAGES_AT_A_TIME])
            yield _Part(plan, observer, image_set.name, some, shown)


def _compare(part: _Part) -> Comparison:
    plan, observer = part.plan, part.observer
    enhancers = {name: _make(name, observer) for name in plan.enhancers}
    is_strongest = observer.severity == max(other.severity for other in plan.observers)
    found = Comparison()
    for image in part.images:
        judge = Judge(part.image_set, image, observer, other_models=plan.other_models)
        made = _candidates(enhancers, plan, image, judge)
        found.scores.extend(judge.score(candidate) for candidate in made)
        if is_strongest and plan.trade_off and image_class(judge.ccpr_input) == "hard":
            what = (part.image_set, image.name, observer.cvd, observer.severity)
            found.trade_offs.extend((*what, *point) for point in _trade_offs(judge, image, made))
        if is_strongest and image.name in part.shown:
            versions = {candidate.method: candidate.pixels for candidate in made}
            found.shown.append(Shown(part.image_set, observer, versions))
    return found


def _make(name: str, observer: Layer) -> Enhancer:
    return method_factory(name)(observer.cvd, observer.severity, ENHANCED_FOR)


def _candidates(
    enhancers: Mapping[str, Enhancer], plan: EnhancerBenchmark, image: TestImage, judge: Judge
) -> list[Enhanced]:
    """The image enhanced by every enhancer, and by contrast gains that change it as much."""
    made = {name: enhance(method_label(name), enhancer, image.pixels) for name, enhancer in enhancers.items()}
    references = gain_references(plan.methods) if GAIN in plan.methods else []
    changes = {name: judge.delta_e_76(made[name].pixels) for name in references}
    return [*made.values(), *(matched_gain(name, image.pixels, change) for name, change in changes.items())]


def _time_methods(plan: EnhancerBenchmark, image: TestImage) -> dict[str, float]:
    return {
        method_label(name): seconds_per_megapixel(_make(name, plan.observers[0]), image.pixels)
        for name in plan.enhancers
    }


def _trade_offs(
    judge: Judge, image: TestImage, candidates: Sequence[Enhanced]
) -> Iterator[tuple[str, float, float, float]]:
    """Method, strength, CCPR and mean ΔE76."""
    for candidate in candidates:
        for strength in STRENGTHS if candidate.method != NONE else STRENGTHS[-1:]:
            pixels = blend(image.pixels, candidate.pixels, strength)
            yield candidate.method, strength, judge.ccpr(pixels), judge.delta_e_76(pixels)


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add, usual = parser.add_argument, EnhancerBenchmark(methods=())
    all_names = ",".join(ALL_ENHANCERS)
    add("--enhancers", type=names, default=ALL_ENHANCERS, metavar="A,B", help=f"names or weight files ({all_names})")
    what = "photographs, besides plates and textiles; repeatable"
    add("--images", type=named_path, action="append", default=[], metavar="NAME=FOLDER", help=what)
    add("--cvd", type=names, dest="types", metavar="A,B", help=f"types ({','.join(usual.types)})")
    add("--severity", type=numbers, dest="severities", metavar="A,B", help="severities (0.4,0.7,1)")
    add("--size", type=positive, metavar="PIXELS", help=f"longer side of the images ({usual.size})")
    add("--plates", type=int, metavar="N", help=f"plates for each type ({usual.plates})")
    add("--textiles", type=int, metavar="N", help=f"textiles in all ({usual.textiles})")
    add("--processes", type=positive, default=1, metavar="N", help="parallel processes (1)")
    add("--quick", action="store_true", help="fewer and smaller images, protan and deutan 1.0, Machado only")


def _measure(options: argparse.Namespace) -> str:
    """Compare enhancers; writes enhancer.csv, three pages, the trade-off and contact sheets."""
    asked = {name: getattr(options, name) for name in ("types", "severities", "size", "plates", "textiles")}
    chosen = (QUICK if options.quick else {}) | {name: value for name, value in asked.items() if value is not None}
    benchmark = EnhancerBenchmark(options.enhancers, dict(options.images), processes=options.processes, **chosen)
    return benchmark.run(options.out, ConsoleReporter(sys.stderr))


PART = Part(
    "enhancer",
    "enhancers compared on photographs, plates and textiles",
    _add_arguments,
    _measure,
    pages=("enhancer.md", JUDGES_PAGE, SEVERITIES_PAGE),
    shaped_by=lambda: (*enhanced_product(), EnhancerBenchmark(methods=()), STRENGTHS),
)
