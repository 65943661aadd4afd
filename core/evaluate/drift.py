"""How much the enhancement of single views makes them contradict each other, before any reconstruction.

The correspondences come from a quick reconstruction of the unenhanced photographs, so they are the same for every
enhancer and can be kept in a file between runs.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from ..capture import Capture, View
from ..color.metrics import ccpr
from ..color.simulation import simulate
from ..color.spaces import image_to_tensor
from ..consistency import Correspondences, CorrespondenceSettings, SceneCorrespondences, relative_warping_error
from ..enhance import Enhancer
from ..events import Reporter, StageSpan
from ..images import to_bytes
from ..settings import Layer
from ..splats import raster
from ..splats.plan import TrainingPlan
from ..splats.renderer import SceneRenderer
from ..splats.targets import Background
from ..splats.trainer import Trainer
from ..whole_file import replacing
from .enhancers.methods import check_labels, method_factory, method_label
from .enhancers.scores import ENHANCED_FOR
from .evaluation import Split, spread
from .matches import SceneMatches
from .tables import markdown_table, number, write_csv

STAGE = "drift"
RECONSTRUCTION_STEPS = 1200  # depth is settled long before colour detail is
_GAUSSIANS = 20_000
_SCORED_VIEWS = 12  # CCPR of more moves the mean little
_DIGITS = 12  # of a fingerprint; names stay readable
_PAIR_FIELDS = tuple(field.name for field in fields(Correspondences))


@dataclass(frozen=True)
class Drift:
    """One enhancer on one capture's views. The figures of `WarpingError` are those of adjacent views.

    Attributes:
        capture: its name.
        method: label of the enhancer.
        cvd, severity: the observer.
        ccpr_input, ccpr: of the photographs and of the enhanced views; a low warping error is worth nothing alone.
        ratio, absolute, absolute_original, normalised_ratio, e_warp, e_warp_original: see `WarpingError`.
        long_ratio, long_absolute: of views that are seven apart.
        correspondences: of adjacent views.
    """

    capture: str
    method: str
    cvd: str
    severity: float
    ccpr_input: float
    ccpr: float
    ratio: float
    absolute: float
    absolute_original: float
    normalised_ratio: float
    e_warp: float
    e_warp_original: float
    long_ratio: float
    long_absolute: float
    correspondences: int


def measure_drift(
    capture: Capture,
    matches: SceneMatches,
    methods: Sequence[str],
    observers: Sequence[Layer],
    reporter: Reporter | None = None,
) -> list[Drift]:
    """Drift of each method for each observer, fitted to the scene's training views as a run does.

    Raises:
        InputError: a method or an observer that does not exist.
    """
    check_labels(methods)
    reporter = reporter or Reporter()
    jobs = [(observer, method) for observer in observers for method in methods]
    rows = []
    for done, (observer, method) in enumerate(jobs):
        enhancer = method_factory(method)(observer.cvd, observer.severity, ENHANCED_FOR)
        rows.append(_measure(capture, matches, enhancer, method_label(method), observer))
        reporter.progress(STAGE, (done + 1) / len(jobs), f"{capture.source.name}, {observer.name}")
    return rows


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
    """As `reconstruct_matches`, kept in `folder` for the next call with the same photographs, cameras and steps."""
    path = folder / f"matches-{capture.source.name}-{_fingerprint(capture)}-{steps}.npz"
    if path.is_file():
        return load_matches(path)
    matches = reconstruct_matches(capture, steps, reporter)
    save_matches(path, matches)
    return matches


def _fingerprint(capture: Capture) -> str:
    """Differs between captures that happen to have the same name."""
    digest = hashlib.sha256()
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
        for name in arrays.files:
            range_name, _, rest = name.partition(".")
            if rest.endswith(".first"):
                prefix = name.removesuffix("first")
                pairs[range_name].append(
                    Correspondences(
                        first=int(arrays[f"{prefix}first"]),
                        second=int(arrays[f"{prefix}second"]),
                        first_pixels=arrays[f"{prefix}first_pixels"],
                        second_positions=arrays[f"{prefix}second_positions"],
                    )
                )
        return SceneMatches(arrays["views"].tolist(), pairs["short"], pairs["long"])


def write_drift(folder: Path, rows: Sequence[Drift]) -> str:
    """Write ``drift.csv`` and ``drift.md``; returns the text of the latter."""
    write_csv(folder / "drift.csv", Drift, rows)
    header = ["capture", "type", "severity", "method", "CCPR in", "CCPR", "RWE", "RWE / σ", "L1", "L1 of input"]
    header += ["RWE, 7 apart", "L1, 7 apart", "E_warp × 10⁴"]
    body = [
        [row.capture, row.cvd, f"{row.severity:g}", row.method]
        + [number(value, 3) for value in (row.ccpr_input, row.ccpr, row.ratio, row.normalised_ratio)]
        + [number(value, 4) for value in (row.absolute, row.absolute_original)]
        + [number(row.long_ratio, 3), number(row.long_absolute, 4), number(1e4 * row.e_warp, 2)]
        for row in rows
    ]
    lines = ["# Drift of enhanced, not yet reconstructed views", "", *markdown_table(header, body), ""]
    lines += [
        "RWE: Σ|Î_i - Î_j| / Σ|I_i - I_j| over correspondences of adjacent views; / σ: each difference divided by the "
        "deviation of its images. L1: mean difference per pixel and channel of values in [0, 1]."
    ]
    text = "\n".join(lines) + "\n"
    (folder / "drift.md").write_text(text, encoding="utf-8")
    return text


def _measure(capture: Capture, matches: SceneMatches, enhancer: Enhancer, method: str, observer: Layer) -> Drift:
    training = [capture.views[i] for i in Split.every(len(capture.views)).train]
    enhancer.fit([view.image for view in training], alphas=[view.alpha for view in training])
    views = [capture.views[i] for i in matches.views]
    originals = [view.image for view in views]
    enhanced = [to_bytes(enhancer(image)) for image in originals]
    scored = spread(range(len(views)), _SCORED_VIEWS)
    short = relative_warping_error(originals, enhanced, matches.short)
    long = relative_warping_error(originals, enhanced, matches.long)
    return Drift(
        capture=capture.source.name,
        method=method,
        cvd=observer.cvd,
        severity=observer.severity,
        ccpr_input=_mean_ccpr([(views[i], originals[i]) for i in scored], observer),
        ccpr=_mean_ccpr([(views[i], enhanced[i]) for i in scored], observer),
        ratio=short.ratio,
        absolute=short.absolute,
        absolute_original=short.absolute_original,
        normalised_ratio=short.normalised_ratio,
        e_warp=short.e_warp,
        e_warp_original=short.e_warp_original,
        long_ratio=long.ratio,
        long_absolute=long.absolute,
        correspondences=short.correspondences,
    )


def _mean_ccpr(pairs: Sequence[tuple[View, NDArray[np.uint8]]], observer: Layer) -> float:
    """Mean CCPR of candidates for views, over what the photographs cover."""
    preserved = []
    for view, candidate in pairs:
        mask = None if view.alpha is None else torch.from_numpy(view.alpha > 127)
        seen = simulate(image_to_tensor(candidate), observer.cvd, observer.severity, ENHANCED_FOR)
        preserved.append(ccpr(image_to_tensor(view.image), seen, mask=mask)[0])
    return float(np.nanmean(preserved))
