"""How much enhancement makes views contradict each other, before any reconstruction.

The correspondences come from a quick reconstruction of the unenhanced photographs, so they are the same for every
enhancer and can be cached in a file. Command: ``benchmark.py drift``.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ....core.capture.model import Capture
from ....core.capture.reader import read_capture
from ....core.color.simulation import Observer
from ....core.consistency import Correspondences, CorrespondenceSettings, SceneCorrespondences, relative_warping_error
from ....core.demo import SHOWROOM
from ....core.enhance import Enhancer, enhance_bytes
from ....core.evaluate.evaluation import SceneMatches, Split
from ....core.evaluate.scores import Scorer
from ....core.files.untrusted import replacing
from ....core.intake.sampling import evenly_spread
from ....core.runtime.cli import ConsoleReporter
from ....core.runtime.protocol import Reporter, StageSpan
from ....core.settings import Layer
from ....core.splats import raster
from ....core.splats.renderer import SceneRenderer
from ....core.splats.targets import Background
from ....core.splats.training.plan import TrainingPlan
from ....core.splats.training.trainer import Trainer
from ..options import Part, names, positive
from ..provenance import enhanced_product, fingerprint, trained_product
from ..tables import Column, markdown_table, write_csv, write_text
from .methods import check_labels, method_factory, method_label
from .scores import ENHANCED_FOR

STAGE = "drift"
RECONSTRUCTION_STEPS = 1200  # depth converges long before colour detail
_GAUSSIANS = 20_000
_SCORED_VIEWS = 12  # more views hardly change the mean CCPR
_DIGITS = 12  # of a fingerprint
_PAIR_FIELDS = tuple(field.name for field in fields(Correspondences))


_COLUMNS: tuple[Column, ...] = (
    ("capture", "capture", ""),
    ("cvd", "type", ""),
    ("severity", "severity", "g"),
    ("method", "method", ""),
    ("ccpr_input", "CCPR in", ".3f"),
    ("ccpr", "CCPR", ".3f"),
    ("ratio", "RWE", ".3f"),
    ("normalised_ratio", "RWE / σ", ".3f"),
    ("absolute", "L1", ".4f"),
    ("absolute_original", "L1 of input", ".4f"),
    ("long_ratio", "RWE, 7 apart", ".3f"),
    ("long_absolute", "L1, 7 apart", ".4f"),
    ("e_warp_scaled", "E_warp × 10⁴", ".2f"),
)


def measure_drift(
    capture: Capture,
    matches: SceneMatches,
    methods: Sequence[str],
    observers: Sequence[Layer],
    reporter: Reporter | None = None,
) -> pd.DataFrame:
    """The drift of each method for each observer, fitted to the scene's training views as in a run.

    Returns:
        A row for each ``capture``, ``method``, ``cvd`` and ``severity``: mean CCPR of the photographs (``ccpr_input``)
        and of the enhanced views (``ccpr``; a low warping error alone is worth nothing), the fields of `WarpingError`
        for adjacent views, and ``long_ratio`` and ``long_absolute`` for views that are seven apart.

    Raises:
        InputError: a method or an observer that does not exist.
    """
    check_labels(methods)
    reporter = reporter or Reporter()
    jobs = [(observer, method) for observer in observers for method in methods]
    rows = []
    for done, (observer, method) in enumerate(jobs):
        enhancer = method_factory(method)(observer.cvd, observer.severity, ENHANCED_FOR)
        name = capture.source.name
        what = {"capture": name, "method": method_label(method), "cvd": observer.cvd, "severity": observer.severity}
        rows.append({**what, **_measure_views(capture, matches, enhancer, observer)})
        reporter.progress(STAGE, (done + 1) / len(jobs), f"{name}, {observer.name}")
    return pd.DataFrame(rows)


def _measure_views(capture: Capture, matches: SceneMatches, enhancer: Enhancer, observer: Layer) -> dict[str, Any]:
    training = [capture.views[i] for i in Split.every(len(capture.views)).train]
    enhancer.fit([view.image for view in training], alphas=[view.alpha for view in training])
    views = [capture.views[i] for i in matches.views]
    originals = [view.image for view in views]
    enhanced = [enhance_bytes(enhancer, view.image, view.alpha) for view in views]
    contrasts = []
    for i in evenly_spread(range(len(views)), _SCORED_VIEWS):
        alpha, seen_as = views[i].alpha, Observer(observer.cvd, observer.severity, ENHANCED_FOR)
        scorer = Scorer(originals[i], seen_as, None if alpha is None else alpha > 127)
        contrasts.append((scorer.ccpr(originals[i]), scorer.ccpr(enhanced[i])))
    ccpr_input, ccpr = np.nanmean(contrasts, axis=0)
    long = relative_warping_error(originals, enhanced, matches.long)
    return {
        "ccpr_input": ccpr_input,
        "ccpr": ccpr,
        **vars(relative_warping_error(originals, enhanced, matches.short)),
        "long_ratio": long.ratio,
        "long_absolute": long.absolute,
    }


def reconstruct_matches(
    capture: Capture, steps: int = RECONSTRUCTION_STEPS, reporter: Reporter | None = None, seed: int = 0
) -> SceneMatches:
    """Correspondences of the capture's views from a quick reconstruction in the original colours."""
    reporter = reporter or Reporter()
    raster.load("cpu", reporter)
    rasterizer, background = raster.Rasterizer("cpu"), Background.of(capture.views)
    plan = TrainingPlan(steps=steps, limit=_GAUSSIANS, poses=None)
    trainer = Trainer(rasterizer, capture.views, [], capture.points, capture.point_colors, plan, background, seed)
    trained = trainer.train(StageSpan(reporter, STAGE, 0.0, 1.0, f"reconstructing {capture.source.name}"))
    scene = SceneRenderer(rasterizer, capture.views, background)
    every_pixel = CorrespondenceSettings()
    return SceneMatches.find(
        SceneCorrespondences(capture.views, lambda index: scene.depth(trained.gaussians, index), every_pixel)
    )


def cached_matches(
    folder: Path, capture: Capture, steps: int = RECONSTRUCTION_STEPS, reporter: Reporter | None = None
) -> SceneMatches:
    """As `reconstruct_matches`, cached in `folder` for the same photographs, cameras, steps and trainer."""
    path = folder / f"matches-{capture.source.name}-{_fingerprint(capture)}-{steps}.npz"
    if path.is_file():
        return load_matches(path)
    matches = reconstruct_matches(capture, steps, reporter)
    save_matches(path, matches)
    return matches


def _fingerprint(capture: Capture) -> str:
    """A hash of photographs and cameras, since captures may have the same name, and of what reconstructs them."""
    digest = hashlib.sha256(fingerprint("", lambda: (*trained_product(), _GAUSSIANS)).encode())
    for view in capture.views:
        digest.update(np.ascontiguousarray(view.image).tobytes())
        digest.update(repr((view.camera, view.world_to_camera.tolist())).encode())
    return digest.hexdigest()[:_DIGITS]


def save_matches(path: Path, matches: SceneMatches) -> None:
    """Write the correspondences as an .npz of plain arrays."""
    arrays: dict[str, NDArray] = {"views": np.array(matches.views)}
    for range_name, pairs in (("short", matches.short), ("long", matches.long)):
        for index, pair in enumerate(pairs):
            arrays |= {f"{range_name}.{index}.{field}": np.asarray(getattr(pair, field)) for field in _PAIR_FIELDS}
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path, contested=True) as unfinished:
        np.savez_compressed(unfinished, **arrays)  # type: ignore[arg-type]


def load_matches(path: Path) -> SceneMatches:
    """Read what `save_matches` wrote."""
    with np.load(path, allow_pickle=False) as arrays:
        pairs: dict[str, list[Correspondences]] = {"short": [], "long": []}
        for name in (name for name in arrays.files if name.endswith(".first")):
            values = {field: arrays[f"{name.removesuffix('first')}{field}"] for field in _PAIR_FIELDS}
            values |= {"first": int(values["first"]), "second": int(values["second"])}
            pairs[name.partition(".")[0]].append(Correspondences(**values))
        return SceneMatches(arrays["views"].tolist(), pairs["short"], pairs["long"])


def write_drift(folder: Path, rows: pd.DataFrame) -> str:
    """Write ``drift.csv`` and ``drift.md``; returns the text of the latter."""
    write_csv(folder / "drift.csv", rows)
    table = markdown_table(rows.assign(e_warp_scaled=1e4 * rows.e_warp), _COLUMNS)
    lines = ["# Drift of enhanced, not yet reconstructed views", "", *table, ""]
    lines += [
        "RWE: Σ|Î_i - Î_j| / Σ|I_i - I_j| over correspondences of adjacent views; / σ: each difference divided by the "
        "deviation of its images. L1: mean difference per pixel and channel of values in [0, 1]."
    ]
    return write_text(folder / "drift.md", lines)


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--capture", type=Path, action="append", help="a capture besides the demo; repeatable")
    add("--enhancers", type=names, default=("none", "lut"), metavar="A,B", help="names or weight files (none,lut)")
    add("--cvd", type=names, default=("deutan",), metavar="A,B", help="types (deutan)")
    add("--severity", type=float, default=1.0, metavar="0..1", help="severity (1)")
    add("--max-size", type=positive, default=480, metavar="PIXELS", help="longer side of the views (480)")
    add(
        "--steps",
        type=positive,
        default=RECONSTRUCTION_STEPS,
        metavar="N",
        help=f"steps of the reconstruction ({RECONSTRUCTION_STEPS})",
    )


def _measure(options: argparse.Namespace) -> str:
    """Measure drift on the demo and other captures; writes drift.csv and drift.md, caches correspondences as .npz."""
    reporter = ConsoleReporter(sys.stderr)
    observers = [Layer(cvd, options.severity) for cvd in options.cvd]
    rows = []
    for folder in [SHOWROOM, *(options.capture or [])]:
        capture = read_capture(folder, max_size=options.max_size, reporter=reporter)
        matches = cached_matches(options.out, capture, options.steps, reporter)
        rows.append(measure_drift(capture, matches, options.enhancers, observers, reporter))
    return write_drift(options.out, pd.concat(rows))


PART = Part(
    "drift",
    "how much enhanced views contradict each other before reconstruction",
    _add_arguments,
    _measure,
    pages=("drift.md",),
    shaped_by=lambda: (*enhanced_product(), RECONSTRUCTION_STEPS, _GAUSSIANS, _SCORED_VIEWS),
)
