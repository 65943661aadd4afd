"""Compares enhancers on image sets: every image, observer and method, and what less strength costs and gains.

The controls are part of every comparison: the image as it is (`none`), and plain contrast gain that changes each image
as much as the network does (`gain`). Each method is fitted to the image at hand, as it would be to a scene.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ..enhance.enhancer import Enhancer
from ..events import Reporter
from ..settings import Layer
from .enhancer_means import image_class
from .enhancer_methods import (
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
from .enhancer_scores import ENHANCED_FOR, Enhanced, EnhancerScores, Judge
from .evaluation import spread
from .image_sets import ImageSet, TestImage

STAGE = "enhancers"

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


def compare_enhancers(
    image_sets: Sequence[ImageSet], plan: ComparisonPlan, reporter: Reporter | None = None
) -> Comparison:
    """Measure every method on every image for every observer.

    Raises:
        InputError: a method that does not exist, or gain without anything to match.
    """
    reporter = reporter or Reporter()
    names = [NONE, *(name for name in plan.methods if name not in (NONE, GAIN))]
    references = gain_references(list(plan.methods)) if GAIN in plan.methods else []
    comparison = Comparison()
    strongest = max(observer.severity for observer in plan.observers)
    work = list(_work(image_sets, plan))
    _time_methods(names, plan.observers[0], image_sets[0].images[0], comparison)
    enhancers: dict[Layer, dict[str, Enhancer]] = {}
    for done, (observer, image_set, image, is_shown) in enumerate(work):
        if observer not in enhancers:
            enhancers[observer] = {
                name: method_factory(name)(observer.cvd, observer.severity, ENHANCED_FOR) for name in names
            }
        judge = Judge(image_set.name, image, observer, other_models=plan.other_models)
        candidates = {
            name: enhance(method_label(name), enhancer, image.pixels) for name, enhancer in enhancers[observer].items()
        }
        for reference in references:
            change = judge.delta_e_76(candidates[reference].pixels)
            candidates[f"{GAIN} {reference}"] = matched_gain(reference, image.pixels, change)
        made = list(candidates.values())
        comparison.scores.extend(judge.score(candidate) for candidate in made)
        if observer.severity == strongest:
            if plan.trade_off and image_class(judge.ccpr_input) == "hard":
                comparison.trade_offs.extend(_trade_offs(judge, image_set, image, observer, made))
            if is_shown:
                versions = {candidate.method: candidate.pixels for candidate in made}
                comparison.shown.append(Shown(image_set.name, observer, versions))
        reporter.progress(STAGE, (done + 1) / len(work), f"{observer.name}, {image_set.name}")
    return comparison


def _work(image_sets: Sequence[ImageSet], plan: ComparisonPlan) -> Iterator[tuple[Layer, ImageSet, TestImage, bool]]:
    """Every image for every observer whom it concerns, and whether it is one of those to look at."""
    for observer, image_set in product(plan.observers, image_sets):
        images = [image for image in image_set.images if image.cvd in (None, observer.cvd)]
        shown = spread(range(len(images)), plan.shown)
        for index, image in enumerate(images):
            yield observer, image_set, image, index in shown


def _time_methods(names: Sequence[str], observer: Layer, image: TestImage, comparison: Comparison) -> None:
    for name in names:
        enhancer = method_factory(name)(observer.cvd, observer.severity, ENHANCED_FOR)
        comparison.seconds[method_label(name)] = seconds_per_megapixel(enhancer, image.pixels)


def _trade_offs(
    judge: Judge, image_set: ImageSet, image: TestImage, observer: Layer, candidates: Sequence[Enhanced]
) -> list[TradeOff]:
    points = []
    for candidate in candidates:
        for strength in STRENGTHS if candidate.method != NONE else STRENGTHS[-1:]:
            pixels = blend(image.pixels, candidate.pixels, strength)
            points.append(
                TradeOff(
                    image_set=image_set.name,
                    image=image.name,
                    cvd=observer.cvd,
                    severity=observer.severity,
                    method=candidate.method,
                    strength=strength,
                    ccpr=judge.ccpr(pixels),
                    delta_e_76=judge.delta_e_76(pixels),
                )
            )
    return points
