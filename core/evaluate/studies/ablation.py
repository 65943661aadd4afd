"""What each part of the method contributes: it is left out or replaced, and everything else stays."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ...splats.joint import JointPlan
from ...splats.layers import LayerPlan
from ...splats.plan import TrainingPlan
from ...splats.strategy import CloneSplitPrune, MultiViewConsistent
from ...stages import Plans
from ..enhancers.methods import LUT, NETWORK
from ..tables import markdown_table, write_csv
from .jobs import Job
from .recipe import Recipe, Trial
from .subject import SubjectSource
from .summary import Summary, failures, seeds_of
from .table import DRIFT


@dataclass(frozen=True)
class Variant:
    """The method with one thing changed.

    Attributes:
        name: starts the labels of its recipes.
        title: what the table calls it.
        mode: of the run.
        plans: how the fits are done.
        of_geometry: whether it changes the geometry alone, which does not depend on the enhancer.
    """

    name: str
    title: str
    mode: str = "layers"
    plans: Plans = field(default_factory=Plans)
    of_geometry: bool = False


DEFAULT = Variant("default", "the default (`layers`)")
VARIANTS = (
    Variant("no-multi-view-loss", "without L_mv", plans=Plans(layer=LayerPlan(multi_view_weight=0.0))),
    Variant("plain-fit", "plain instead of robust fit, without L_mv", plans=Plans(guided=False)),
    Variant(
        "gradient-densify",
        "clone and split by gradients instead of multi-view densify",
        plans=Plans(training=TrainingPlan(strategy=CloneSplitPrune())),
        of_geometry=True,
    ),
    Variant(
        "no-pruning",
        "no pruning before the end",
        plans=Plans(training=TrainingPlan(strategy=MultiViewConsistent(prune=False))),
        of_geometry=True,
    ),
    Variant("joint", "`joint` instead of `layers`", mode="joint"),
    Variant(
        "joint-no-multi-view-loss",
        "`joint` without L_mv",
        mode="joint",
        plans=Plans(joint=JointPlan(multi_view_weight=0.0)),
    ),
    Variant("post", "`post` instead of `layers`", mode="post"),
)


@dataclass(frozen=True)
class Setting:
    """An enhancer that the variants are tried with.

    Attributes:
        name: ends the labels of the recipes.
        title: what the text calls it.
        enhancer, drift: as in `Recipe`.
        geometry: whether variants that change the geometry alone are tried with it too.
    """

    name: str
    title: str
    enhancer: str
    drift: float = 0.0
    geometry: bool = True

    @property
    def variants(self) -> tuple[Variant, ...]:
        """Those that are tried with it, beside the default."""
        return tuple(variant for variant in VARIANTS if self.geometry or not variant.of_geometry)

    def recipe(self, variant: Variant, iterations: int, seed: int) -> Recipe:
        """The variant with this enhancer."""
        return Recipe(
            f"{variant.name}-{self.name}",
            variant.mode,
            self.enhancer,
            iterations=iterations,
            seed=seed,
            drift=self.drift,
            plans=variant.plans,
        )


SETTINGS = (
    Setting("network", "The product's network", NETWORK),
    Setting("drifting", f"The scene LUT, hues turned by {DRIFT:g}° from view to view", LUT, DRIFT, geometry=False),
)


def ablation_jobs(
    sources: Sequence[SubjectSource], iterations: int, seeds: int, weights: Mapping[str, Path] | None = None
) -> list[Job]:
    """A job a capture.

    Args:
        weights: further networks by name, with other norms for example; tried by the default way.
    """
    return [
        Job(
            source,
            tuple(
                recipe
                for seed in range(seeds)
                for recipe in (
                    *(
                        setting.recipe(variant, iterations, seed)
                        for setting in SETTINGS
                        for variant in (DEFAULT, *setting.variants)
                    ),
                    *(_with_weights(file).recipe(DEFAULT, iterations, seed) for file in _named(weights)),
                )
            ),
        )
        for source in sources
    ]


def write_ablation(
    folder: Path, trials: Sequence[Trial], heading: Sequence[str], weights: Mapping[str, Path] | None = None
) -> list[str]:
    """Write ``ablation.csv``, a line a trial; returns the lines of the text."""
    write_csv(folder / "ablation.csv", Trial, trials)
    lines = ["# Ablations", "", *heading, "", *_DEFINITIONS, ""]
    for setting in SETTINGS:
        lines += [f"## {setting.title}", "", *_setting_table(trials, setting), ""]
    if weights:
        lines += ["## Other networks", "", *_weights_table(trials, weights), ""]
    failed = failures(trials)
    return [*lines, *(["## What failed", "", *failed] if failed else [])]


_DEFINITIONS = [
    "The first row has the default's own figures, the others their differences to it, capture by capture and seed by "
    "seed; ± is the standard deviation of these differences. Figures as in the main table. *Gaussians* and *processor "
    "seconds* (of geometry, enhancement and layer) are ratios. Without L_mv the colours are still fitted with the "
    "weights that the views' agreement gives each pixel; a plain fit counts all pixels alike.",
]

_Figure = Callable[[Trial], float]
_DIFFERENCES: tuple[tuple[str, _Figure, int], ...] = (
    ("PSNR", lambda trial: trial.psnr, 2),
    ("CCPR", lambda trial: trial.ccpr, 3),
    ("SSIM to simulated", lambda trial: trial.ssim_simulated, 3),
    ("PSNR to enhanced", lambda trial: trial.psnr_to_enhanced, 2),
    ("RWE", lambda trial: trial.rwe, 3),
    ("7 apart", lambda trial: trial.rwe_long, 3),
    ("/ σ", lambda trial: trial.rwe_normalised, 3),
)
_RATIOS: tuple[tuple[str, _Figure, int], ...] = (
    ("Gaussians", lambda trial: trial.gaussians or math.nan, 2),
    ("processor seconds", lambda trial: trial.processor_seconds, 2),
)
_HEADER = [name for name, _, _ in (*_DIFFERENCES, *_RATIOS)]


def _setting_table(trials: Sequence[Trial], setting: Setting) -> list[str]:
    default = _of_label(trials, setting.recipe(DEFAULT, 0, 0).label)
    body = [[DEFAULT.title, *_absolute(default)]]
    for variant in setting.variants:
        changed = _of_label(trials, setting.recipe(variant, 0, 0).label)
        body.append([variant.title, *_against(changed, default)])
    return markdown_table(["", *_HEADER], body)


def _weights_table(trials: Sequence[Trial], weights: Mapping[str, Path]) -> list[str]:
    default = _of_label(trials, SETTINGS[0].recipe(DEFAULT, 0, 0).label)
    body = [["the product's network", *_absolute(default)]]
    for setting in (_with_weights(file) for file in _named(weights)):
        body.append([setting.title, *_against(_of_label(trials, setting.recipe(DEFAULT, 0, 0).label), default)])
    return markdown_table(["", *_HEADER, "RWE of enhanced photographs"], _with_enhanced(trials, body, weights))


def _with_enhanced(trials: Sequence[Trial], body: Sequence[list[str]], weights: Mapping[str, Path]) -> list[list[str]]:
    """The rows with what the enhancer does before any reconstruction, as it is."""
    settings = (SETTINGS[0], *(_with_weights(file) for file in _named(weights)))
    found = [_of_label(trials, setting.recipe(DEFAULT, 0, 0).label) for setting in settings]
    return [
        [*row, Summary.of(trial.rwe_enhanced for trial in some).text(3)] for row, some in zip(body, found, strict=True)
    ]


def _absolute(trials: Sequence[Trial]) -> list[str]:
    whole = {name: 0 for name, _, _ in _RATIOS}
    return [
        Summary.of(figure(trial) for trial in trials).text(whole.get(name, digits))
        for name, figure, digits in (*_DIFFERENCES, *_RATIOS)
    ]


def _against(changed: Sequence[Trial], default: Sequence[Trial]) -> list[str]:
    pairs = list(zip(changed, default, strict=True))
    differences = [
        _signed(Summary.of(figure(one) - figure(other) for one, other in pairs), digits)
        for _, figure, digits in _DIFFERENCES
    ]
    ratios = [
        Summary.of(figure(one) / figure(other) for one, other in pairs).text(digits) for _, figure, digits in _RATIOS
    ]
    return differences + ratios


def _signed(summary: Summary, digits: int) -> str:
    text = summary.text(digits)
    return text if math.isnan(summary.mean) or summary.mean < 0.0 else f"+{text}"


def _of_label(trials: Sequence[Trial], label: str) -> list[Trial]:
    """Those of all captures and seeds, in the same order for every label."""
    captures = dict.fromkeys(trial.capture for trial in trials)
    return [trial for capture in captures for trial in seeds_of(trials, capture, label)]


def _named(weights: Mapping[str, Path] | None) -> list[tuple[str, Path]]:
    return list((weights or {}).items())


def _with_weights(file: tuple[str, Path]) -> Setting:
    name, path = file
    return Setting(f"weights-{name}", name, str(path))
