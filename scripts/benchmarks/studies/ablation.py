"""Ablations: the contribution of each part of the method, which is left out or replaced while everything else stays.

Command: ``benchmark.py ablation``.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd

from ....core.pipeline.stages import Plans
from ....core.runtime.cli import ConsoleReporter
from ....core.splats.raster import ContrastPlan
from ....core.splats.strategy import MultiViewConsistent
from ....core.splats.training.joint import JointPlan
from ....core.splats.training.layers import LayerPlan
from ....core.splats.training.plan import TrainingPlan
from ....core.splats.training.start import StartRule
from ..enhancers.methods import SCENE
from ..options import Part, add_study_arguments, chosen_sources, made_by, named_path, with_quick_defaults, work_folder
from ..provenance import trained_product
from ..strategies import CloneSplitPrune
from ..tables import Column, frame_of, means_and_deviations, number, tables_of_means, write_csv, write_text
from .captures import SubjectSource
from .jobs import Job, run_jobs
from .recipe import Recipe, Trial, failures, optimistic, with_derived
from .table import DRIFT

SIZE, ITERATIONS, SEEDS = 240, 800, 3
_DEFINITIONS = (
    "The first row has the default's own figures, the others {differences}. Figures as in the main table. *Gaussians* "
    "and *processor seconds* (of geometry, enhancement and layer) are ratios. Without L_mv the colours are still "
    "fitted with the weights that the views' agreement gives each pixel; a plain fit counts all pixels alike."
)
_DIFFERENCES: tuple[Column, ...] = (
    ("psnr", "PSNR", "+.2f"),
    ("ccpr", "CCPR", "+.3f"),
    ("ssim_simulated", "SSIM to simulated", "+.3f"),
    ("psnr_to_enhanced", "PSNR to enhanced", "+.2f"),
    ("rwe", "RWE", "+.3f"),
    ("rwe_long", "7 apart", "+.3f"),
    ("rwe_normalised", "/ σ", "+.3f"),
)
_RATIOS: tuple[Column, ...] = (("gaussians", "Gaussians", ".2f"), ("processor_seconds", "processor seconds", ".2f"))
_ENHANCED: Column = ("rwe_enhanced", "RWE of enhanced photographs", ".3f")
"""What an enhancer does before any reconstruction; given as it is."""


@dataclass(frozen=True)
class Variant:
    """The method with one thing changed.

    Attributes:
        name: begins the labels of its recipes.
        title: its name in the table.
        mode: of the run.
        plans: of the fits.
        of_geometry: whether only the geometry changes, which does not depend on the enhancer.
    """

    name: str
    title: str
    mode: str = "layers"
    plans: Plans = field(default_factory=Plans)
    of_geometry: bool = False


DEFAULT = Variant("default", "the default (`layers`)")
VARIANTS = (
    Variant("no-multi-view-loss", "without L_mv", plans=Plans(layer=LayerPlan(multi_view_weight=0.0))),
    Variant(
        "no-layer-hinge",
        "no hinge on the layer's contrast",
        plans=Plans(layer=LayerPlan(contrast=ContrastPlan(weight=0.0))),
    ),
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
    Variant(
        "no-geometry-hinge",
        "no hinge on the geometry's contrast",
        plans=Plans(training=TrainingPlan(contrast=None)),
        of_geometry=True,
    ),
    Variant(
        "sparse-start",
        "from sparse points alone, without dense stereo",
        plans=Plans(training=TrainingPlan(start=StartRule(dense=None))),
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
        title: its heading in the text.
        enhancer, drift: as in `Recipe`.
        geometry: whether variants that only change the geometry are tried with it too.
    """

    name: str
    title: str
    enhancer: str
    drift: float = 0.0
    geometry: bool = True

    @property
    def variants(self) -> tuple[Variant, ...]:
        """The variants to try with it, besides the default."""
        return tuple(variant for variant in VARIANTS if self.geometry or not variant.of_geometry)

    def label(self, variant: Variant) -> str:
        """The label of a variant's recipe with this enhancer."""
        return f"{variant.name}-{self.name}"

    def recipe(self, variant: Variant, iterations: int, seed: int) -> Recipe:
        """The variant with this enhancer."""
        return Recipe(
            self.label(variant),
            variant.mode,
            self.enhancer,
            iterations=iterations,
            seed=seed,
            drift=self.drift,
            plans=variant.plans,
        )


SETTINGS = (
    Setting("scene", "The product's scene network", SCENE),
    Setting("drifting", f"The same, hues turned by {DRIFT:g}° from view to view", SCENE, DRIFT, geometry=False),
)


def ablation_jobs(
    sources: Sequence[SubjectSource], iterations: int, seeds: int, weights: Mapping[str, Path] | None = None
) -> list[Job]:
    """One job per capture.

    Args:
        weights: further networks by name, with other norms for example; tried with the default variant.
    """
    tried = [(setting, variant) for setting in SETTINGS for variant in (DEFAULT, *setting.variants)]
    tried += [(setting, DEFAULT) for setting in _weight_settings(weights)]
    recipes = tuple(setting.recipe(variant, iterations, seed) for seed in range(seeds) for setting, variant in tried)
    return [Job(source, recipes) for source in sources]


def write_ablation(
    folder: Path, trials: pd.DataFrame, heading: Sequence[str], weights: Mapping[str, Path] | None = None
) -> list[str]:
    """Write ``ablation.csv``, a line for each trial; returns the lines of the text."""
    write_csv(folder / "ablation.csv", trials)
    trials = with_derived(trials)
    lines = ["# Ablations", "", *heading, "", _definitions(trials), "", *optimistic(trials)]
    for capture, mine in trials.groupby("capture", sort=False):
        lines += [f"## {capture}", ""]
        for setting in SETTINGS:
            titles = {setting.label(variant): variant.title for variant in (DEFAULT, *setting.variants)}
            lines += [f"### {setting.title}", "", *_tables(mine, titles), ""]
        if weights:
            titles = {setting.label(DEFAULT): setting.title for setting in _weight_settings(weights)}
            titles = {SETTINGS[0].label(DEFAULT): "the product's scene network", **titles}
            lines += ["### Other networks", "", *_tables(mine, titles, _ENHANCED), ""]
    return [*lines, *failures(trials)]


def _definitions(trials: pd.DataFrame) -> str:
    """What the tables have, by whether there is more than one seed."""
    differences = "their differences to it"
    if trials.seed.nunique() > 1:
        differences = f"the means of {differences}, seed by seed; second tables have the standard deviations over seeds"
    return _DEFINITIONS.format(differences=differences)


def _tables(trials: pd.DataFrame, titles: Mapping[str, str], *absolute: Column) -> list[str]:
    """Tables of the first label's own figures and of how the others differ from it.

    Args:
        trials: of one capture.
        titles: of the rows, by the trials' labels.
        absolute: columns that have their own figures in all rows.
    """
    columns = (*_DIFFERENCES, *_RATIOS, *absolute)
    differing, ratios = ([name for name, _, _ in some] for some in (_DIFFERENCES, _RATIOS))
    keyed = trials.assign(title=trials.label.map(titles)).set_index("seed")
    kept = ["title", *(name for name, _, _ in columns)]
    default, *others = (keyed.loc[keyed.label == label, kept].copy() for label in titles)
    for changed in others:
        changed[differing] -= default[differing]
        changed[ratios] /= default[ratios]
    means, deviations = means_and_deviations(pd.concat([default, *others]), ["title"], columns)
    means = means.astype(object)
    for name, _, specification in columns:
        means.loc[0, name] = number(means.loc[0, name], ".0f" if name in ratios else specification.lstrip("+"))
    return tables_of_means(means, deviations, [("title", "", "")], columns)


def _weight_settings(weights: Mapping[str, Path] | None) -> list[Setting]:
    return [Setting(f"weights-{name}", name, str(path)) for name, path in (weights or {}).items()]


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_study_arguments(parser, max_size=SIZE, iterations=ITERATIONS, seeds=SEEDS)
    what = "a further network, with another norm for example; repeatable"
    parser.add_argument("--weights", type=named_path, action="append", metavar="NAME=FILE", help=what)


def _measure(options: argparse.Namespace) -> str:
    """Leave out one part after the other; writes ablation.csv and ablation.md."""
    options = with_quick_defaults(options)
    weights = dict(options.weights or ())
    jobs = ablation_jobs(chosen_sources(options), options.iterations, options.seeds, weights)
    reporter = ConsoleReporter(sys.stderr)
    trials = run_jobs(jobs, work_folder(options), reporter, processes=options.processes, again=options.again)
    tried = frame_of(Trial, trials)
    lines = write_ablation(options.out, tried, made_by(options, tried), weights)
    return write_text(options.out / "ablation.md", lines)


PART = Part(
    "ablation",
    "what each part of the method contributes",
    _add_arguments,
    _measure,
    pages=("ablation.md",),
    shaped_by=lambda: (*trained_product(), VARIANTS, SETTINGS, Recipe("any")),
)
