"""The figures that an enhancer is to reach on images that no training saw, and whether it does."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ...color.held_colors import HELD_COLORS
from ..tables import number
from .means import held_mean, kept_gain, mean, readable_plates, select
from .methods import LUT, NONE, gain_label
from .scores import EnhancerScores

READABLE_SHARE, PLATE_MEAN = 0.95, 20.0
LEAST_CCPR_GAIN = 0.05
MOST_SSIM_LOSS = 0.01
EASY_SSIM, EASY_PSNR = 0.975, 34.0
HELD_DELTA_E = 1.5
KEPT_GAIN = 0.7
SECONDS_PER_MEGAPIXEL = 0.9

_PLATE_TYPES = ("protan", "deutan")
_FULL = 1.0  # severity of the headline


@dataclass(frozen=True)
class Figure:
    """One line of the headline.

    Attributes:
        what: the figure.
        whom: observer, or nothing where it concerns no one observer.
        target: what is to be reached, in words.
        measured: the value.
        reached: whether it is; None where nothing could be measured.
        digits: how many to show behind the point.
    """

    what: str
    whom: str
    target: str
    measured: float
    reached: bool | None
    digits: int = 3

    def cells(self) -> list[str]:
        """As a row of a table."""
        verdict = "–" if self.reached is None else "yes" if self.reached else "**no**"
        return [self.what, self.whom, self.target, number(self.measured, self.digits), verdict]


def figures_to_reach(
    scores: Sequence[EnhancerScores], candidate: str, photographs: Sequence[str], seconds: float
) -> list[Figure]:
    """The headline for the method `candidate`: severity 1, plates, and the photographs of all sets together.

    Args:
        scores: of a comparison.
        candidate: label of the method.
        photographs: names of the sets that are photographs.
        seconds: that the candidate takes for a megapixel.
    """
    figures: list[Figure] = []
    full = select(scores, severity=_FULL)
    types = list(dict.fromkeys(row.cvd for row in full))
    for cvd in [cvd for cvd in types if cvd in _PLATE_TYPES]:
        figures += _plates(select(full, method=candidate, cvd=cvd), cvd)
    for cvd in types:
        rows = select(full, cvd=cvd, image_sets=photographs)
        figures += _hard(rows, candidate, cvd) + _easy(rows, candidate, cvd)
        figures += _held(rows, candidate, cvd) + _kept(rows, candidate, cvd)
    figures.append(_at_most("seconds per megapixel", "", SECONDS_PER_MEGAPIXEL, seconds, 2))
    return figures


def _plates(rows: Sequence[EnhancerScores], cvd: str) -> list[Figure]:
    return [
        _at_least("plates readable, share", cvd, READABLE_SHARE, readable_plates(rows), 2),
        _at_least("plates, mean ΔE76 through S", cvd, PLATE_MEAN, mean(rows, "plate_after"), 1),
    ]


def _hard(rows: Sequence[EnhancerScores], candidate: str, cvd: str) -> list[Figure]:
    """Contrast and similarity of hard photographs, beside the controls' on the same images."""
    hard = select(rows, kind="hard")

    def of(method: str, figure: str) -> float:
        return mean(select(hard, method=method), figure)

    gain, similarity = of(candidate, "ccpr"), of(candidate, "ssim_simulated")
    bounds = [
        ("none + 0.05", of(NONE, "ccpr") + LEAST_CCPR_GAIN),
        ("LUT", of(LUT, "ccpr")),
        ("gain at its ΔE76", of(gain_label(candidate), "ccpr")),
    ]
    figures = [_at_least(f"CCPR τ 6, hard photographs, against {name}", cvd, bound, gain) for name, bound in bounds]
    bounds = [("none - 0.01", of(NONE, "ssim_simulated") - MOST_SSIM_LOSS), ("LUT", of(LUT, "ssim_simulated"))]
    return figures + [
        _at_least(f"SSIM to simulated, hard photographs, against {name}", cvd, bound, similarity)
        for name, bound in bounds
    ]


def _easy(rows: Sequence[EnhancerScores], candidate: str, cvd: str) -> list[Figure]:
    easy = select(rows, method=candidate, kind="easy")
    return [
        _at_least("easy photographs, SSIM to the original", cvd, EASY_SSIM, mean(easy, "ssim")),
        _at_least("easy photographs, PSNR to the original, dB", cvd, EASY_PSNR, mean(easy, "psnr"), 1),
    ]


def _held(rows: Sequence[EnhancerScores], candidate: str, cvd: str) -> list[Figure]:
    mine = select(rows, method=candidate)
    return [_at_most(f"ΔE00 of {color} areas", cvd, HELD_DELTA_E, held_mean(mine, color), 2) for color in HELD_COLORS]


def _kept(rows: Sequence[EnhancerScores], candidate: str, cvd: str) -> list[Figure]:
    hard = select(rows, method=candidate, kind="hard")
    kept = {"Viénot": kept_gain(hard, rows, "vienot"), "Brettel": kept_gain(hard, rows, "brettel")}
    return [
        _at_least(f"CCPR gain kept under {model}", cvd, KEPT_GAIN, share, 2)
        for model, share in kept.items()
        if not (math.isnan(share) and cvd == "tritan" and model == "Viénot")
    ]


def _at_least(what: str, whom: str, bound: float, measured: float, digits: int = 3) -> Figure:
    return Figure(what, whom, f"≥ {number(bound, digits)}", measured, _verdict(bound, measured), digits)


def _at_most(what: str, whom: str, bound: float, measured: float, digits: int) -> Figure:
    return Figure(what, whom, f"≤ {number(bound, digits)}", measured, _verdict(-bound, -measured), digits)


def _verdict(bound: float, measured: float) -> bool | None:
    return None if math.isnan(bound) or math.isnan(measured) else measured >= bound
