"""Compares enhancers on image sets: every image, observer and method, and what less strength costs and gains.

The controls are part of every comparison: the image as it is (`none`), and plain contrast gain that changes each image
as much as the network does (`gain`). Each method is fitted to the image at hand, as it would be to a scene.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from itertools import product
from multiprocessing import get_context

import numpy as np
import torch
from numpy.typing import NDArray

from ...enhance.enhancer import Enhancer
from ...events import Reporter
from ...settings import Layer
from ..evaluation import spread
from .image_sets import ImageSet, TestImage
from .means import image_class
from .methods import (
    GAIN,
    NONE,
    blend,
    enhance,
    gain_references,
    matched_gain,
    method_factory,
    method_label,
    seconds_per_megapixel,
)
from .scores import ENHANCED_FOR, Enhanced, EnhancerScores, Judge

STAGE = "enhancers"

_IMAGES_AT_A_TIME = 4  # enough that loading a network does not count, few enough that processes finish together

STRENGTHS = (0.25, 0.5, 0.75, 1.0)


@dataclass(frozen=True)
class TradeOff:
    """One point of a method's trade-off on one image: what is gained at part of its strength, for how much change."""

    image_set: str
    image: str
    cvd: str
    severity: float
    method: str
    strength: float
    ccpr: float
    delta_e_76: float


@dataclass(frozen=True)
class Shown:
    """An image to look at: its versions by the methods' labels."""

    image_set: str
    observer: Layer
    versions: dict[str, NDArray[np.uint8]]


@dataclass(frozen=True)
class Comparison:
    """What a comparison found.

    Attributes:
        scores: every image set, observer, image and method.
        trade_offs: of the hard images, at `STRENGTHS`, for the strongest observers.
        shown: some images of each set, for the strongest observers.
        seconds: per megapixel of each method, on one image of a megapixel.
    """

    scores: list[EnhancerScores] = field(default_factory=list)
    trade_offs: list[TradeOff] = field(default_factory=list)
    shown: list[Shown] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)

    def add(self, part: Comparison) -> None:
        """Append what was found on other images."""
        self.scores.extend(part.scores)
        self.trade_offs.extend(part.trade_offs)
        self.shown.extend(part.shown)


@dataclass(frozen=True)
class ComparisonPlan:
    """What is compared.

    Attributes:
        methods: names of `enhancer_methods`, or files of weights. `none` is always part of it.
        observers: for whom.
        other_models: whether the other simulation models judge too.
        trade_off: whether the trade-off is measured.
        shown: how many images of each set are kept to look at.
    """

    methods: tuple[str, ...]
    observers: tuple[Layer, ...]
    other_models: bool = True
    trade_off: bool = True
    shown: int = 3

    @property
    def enhancers(self) -> tuple[str, ...]:
        """The methods without contrast gain, `none` first."""
        return NONE, *(name for name in self.methods if name not in (NONE, GAIN))


def compare_enhancers(
    image_sets: Sequence[ImageSet], plan: ComparisonPlan, reporter: Reporter | None = None, processes: int = 1
) -> Comparison:
    """Measure every method on every image for every observer.

    Args:
        image_sets, plan: what is compared.
        reporter: hears of the progress.
        processes: how many share the work; with more than one, each uses one thread.

    Raises:
        InputError: a method that does not exist, or gain without anything to match.
    """
    reporter = reporter or Reporter()
    if GAIN in plan.methods:
        gain_references(plan.methods)  # refuses before anything takes time
    comparison = Comparison(seconds=_time_methods(plan, image_sets[0].images[0]))
    parts = list(_parts(image_sets, plan))
    with contextlib.ExitStack() as stack:
        results: Iterable[Comparison] = map(_compare, parts)
        if processes > 1:
            # Not forked: torch's threads do not survive it.
            pool = ProcessPoolExecutor(
                processes, get_context("spawn"), initializer=torch.set_num_threads, initargs=(1,)
            )
            results = stack.enter_context(pool).map(_compare, parts)
        for done, (part, found) in enumerate(zip(parts, results, strict=True)):
            comparison.add(found)
            message = f"{part.observer.name}, {part.image_set}"
            reporter.progress(STAGE, (done + 1) / len(parts), message)
    return comparison


@dataclass(frozen=True)
class _Part:
    """Some images of a set for one observer: what a process does at a time.

    Attributes:
        plan: of the whole comparison.
        observer, image_set: for whom, and the set's name.
        images: of the set.
        shown: names of those to keep.
    """

    plan: ComparisonPlan
    observer: Layer
    image_set: str
    images: tuple[TestImage, ...]
    shown: frozenset[str]


def _parts(image_sets: Sequence[ImageSet], plan: ComparisonPlan) -> Iterator[_Part]:
    """Every image for every observer whom it concerns."""
    for observer, image_set in product(plan.observers, image_sets):
        images = [image for image in image_set.images if image.cvd in (None, observer.cvd)]
        shown = frozenset(images[index].name for index in spread(range(len(images)), plan.shown))
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
            found.trade_offs.extend(_trade_offs(judge, part, image, made))
        if is_strongest and image.name in part.shown:
            versions = {candidate.method: candidate.pixels for candidate in made}
            found.shown.append(Shown(part.image_set, observer, versions))
    return found


def _make(name: str, observer: Layer) -> Enhancer:
    return method_factory(name)(observer.cvd, observer.severity, ENHANCED_FOR)


def _candidates(
    enhancers: Mapping[str, Enhancer], plan: ComparisonPlan, image: TestImage, judge: Judge
) -> list[Enhanced]:
    """What each enhancer makes of the image, and the contrast gains that change it as much."""
    made = {name: enhance(method_label(name), enhancer, image.pixels) for name, enhancer in enhancers.items()}
    references = gain_references(plan.methods) if GAIN in plan.methods else []
    changes = {name: judge.delta_e_76(made[name].pixels) for name in references}
    return [*made.values(), *(matched_gain(name, image.pixels, change) for name, change in changes.items())]


def _time_methods(plan: ComparisonPlan, image: TestImage) -> dict[str, float]:
    return {
        method_label(name): seconds_per_megapixel(_make(name, plan.observers[0]), image.pixels)
        for name in plan.enhancers
    }


def _trade_offs(judge: Judge, part: _Part, image: TestImage, candidates: Sequence[Enhanced]) -> list[TradeOff]:
    points = []
    for candidate in candidates:
        for strength in STRENGTHS if candidate.method != NONE else STRENGTHS[-1:]:
            pixels = blend(image.pixels, candidate.pixels, strength)
            points.append(
                TradeOff(
                    image_set=part.image_set,
                    image=image.name,
                    cvd=part.observer.cvd,
                    severity=part.observer.severity,
                    method=candidate.method,
                    strength=strength,
                    ccpr=judge.ccpr(pixels),
                    delta_e_76=judge.delta_e_76(pixels),
                )
            )
    return points
