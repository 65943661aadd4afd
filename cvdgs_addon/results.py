"""Finished runs in the open file: loading them, adding the layers of a later run, and what their reports say."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.files.untrusted import is_file, read_json
from ..core.runs.layout import GAUSSIANS_FILE, REPORT_FILE
from ..core.runtime.progress import format_seconds
from .comparison import follow_comparison
from .scene.bystanders import hide_start_cube
from .scene.convert import load_run
from .scene.finished_run import RUN_PROPERTY, FinishedRun, read_run
from .scene.origin import run_of
from .scene.splat_attributes import (
    color_attribute,
    is_gaussian,
    opaque,
    point_positions,
    require_object_mode,
    write_attribute,
)
from .scene.splats import is_splats, layer_names, show_layer
from .watching import WATCHER

_MOST_SHOWN = 1e15  # no figure of a run is larger


def show_run(folder: str, scene: bpy.types.Scene, *, anew: bool = False) -> bpy.types.Object:
    """Show the finished run in `folder`, and its newest layer; returns the Gaussians' object.

    The panels are about these Gaussians then, and the 3D views show them in colour. The untouched cube of a new file,
    which stands in their middle, is hidden.

    Where `scene` has the run already, only the layers that it lacks are added, so that whatever was done to the object
    stays; also where the run has been moved to `folder` since. Where that is not possible because Gaussians were
    deleted, the run is added as a further object.

    Args:
        folder: of the run.
        scene: that shows it.
        anew: whether the run took the place of an earlier one: `scene` gets its colours, and where its Gaussians are
            others, those of the earlier run are hidden.

    Raises:
        InputError: the run cannot be read or used, or its Gaussians are being edited.
    """
    run = read_run(folder)
    if anew:
        _renew(scene, folder, run)
    splats = next((found for found in splats_of(scene, folder) if _can_take_layers(found, run)), None)
    splats = splats or _of_moved_run(scene, folder, run)
    if splats is None:
        splats = load_run(run, scene).splats
        splats[RUN_PROPERTY] = folder
        new = list(run.layers)
    else:
        new = [layer for layer in run.layers if layer not in layer_names(splats)]
        for layer in new:
            _set_layer(splats, layer, run.layers[layer])
    newest = next(reversed(read_report(folder).get("layers", {})), "")
    if newest in layer_names(splats):
        show_layer(splats, newest)
    scene.cvdgs.display.target = splats
    follow_comparison(scene)
    hide_start_cube(scene)
    WATCHER.show(scene, closer=True)
    return splats


def splats_of(scene: bpy.types.Scene, folder: str) -> Iterator[bpy.types.Object]:
    """The Gaussians' objects of `scene` that came from the run in `folder`."""
    for candidate in scene.objects:
        if is_splats(candidate) and run_of(candidate) == folder:
            yield candidate


def is_finished_run(folder: str) -> bool:
    """Whether a run has finished in `folder`."""
    return bool(folder) and is_file(Path(folder, REPORT_FILE))


def read_report(folder: str) -> dict[str, Any]:
    """The report of the run in `folder`; empty where there is none that can be read."""
    path = Path(folder, REPORT_FILE)
    try:
        return _report(path, path.stat().st_mtime_ns)
    except (OSError, ValueError, InputError):
        return {}


@lru_cache(maxsize=4)
def _report(path: Path, _changed: int) -> dict[str, Any]:
    """The report as it was written at a time; panels ask for it at every redraw."""
    report = read_json(path)
    return report if isinstance(report, dict) and isinstance(report.get("layers"), dict) else {}


def figures_of(report: dict[str, Any]) -> dict[str, list[tuple[str, str]]]:
    """What the panel shows of a report: a heading and (name, value) pairs; what was not measured is left out."""
    reconstruction, seconds = _part(report, "reconstruction"), _part(report, "seconds")
    tables = {
        "Reconstruction": [
            ("Gaussians", _shown(report.get("gaussians"), "{:,}")),
            ("Held-out views, PSNR", _shown(reconstruction.get("psnr"), "{:.1f} dB")),
            ("Held-out views, SSIM", _shown(reconstruction.get("ssim"), "{:.3f}")),
            ("Time", _duration(seconds.get("total"))),
        ]
    }
    for name in _part(report, "layers"):
        layer = _part(_part(report, "layers"), name)
        contrast, natural, consistency = (_part(layer, part) for part in ("ccpr", "naturalness", "rwe"))
        tables[name] = [
            ("Contrast left in the photos", _change(contrast.get("input"), contrast.get("enhanced"))),
            ("Contrast left in the scene", _change(contrast.get("unenhanced"), contrast.get("rendered"))),
            ("Colour change, ΔE00", _shown(natural.get("delta_e"), "{:.1f}")),
            ("Colour drift between views (photos = 1, lower is better)", _shown(consistency.get("ratio"), "{:.2f}")),
        ]
    return {heading: [row for row in rows if row[1]] for heading, rows in tables.items()}


def _part(report: dict[str, Any], name: str) -> dict[str, Any]:
    """The table `name` of a report; empty where there is something else, because a panel must not fail to draw."""
    part = report.get(name)
    return part if isinstance(part, dict) else {}


def _shown(value: Any, template: str) -> str:
    return template.format(value) if isinstance(value, int | float) and abs(value) < _MOST_SHOWN else ""


def _change(before: Any, after: Any) -> str:
    """Two shares as percentages, e.g. "55 → 76 %"."""
    shown = " → ".join(filter(None, (_shown(value, "{:.0%}").removesuffix("%") for value in (before, after))))
    return f"{shown} %" if shown else ""


def _duration(value: Any) -> str:
    return format_seconds(value) if _shown(value, "{}") else ""


def _can_take_layers(splats: bpy.types.Object, run: FinishedRun) -> bool:
    require_object_mode(splats)
    return int(is_gaussian(splats.data).sum()) == len(run.gaussians)


def _of_moved_run(scene: bpy.types.Scene, folder: str, run: FinishedRun) -> bpy.types.Object | None:
    """The Gaussians of `run` from when it was in another folder, where it is no longer; they name the new one then."""
    for candidate in filter(is_splats, scene.objects):
        before = run_of(candidate)
        if candidate.library is not None or candidate.data.is_editmode or (before and _has_gaussians(before)):
            continue
        if np.array_equal(point_positions(candidate.data), run.gaussians.means):
            candidate[RUN_PROPERTY] = folder
            return candidate
    return None


def _has_gaussians(folder: str) -> bool:
    return is_file(Path(folder, GAUSSIANS_FILE))


def _renew(scene: bpy.types.Scene, folder: str, run: FinishedRun) -> None:
    """Bring what `scene` has of an earlier run in `folder` up to date, or out of the way."""
    for splats in list(splats_of(scene, folder)):
        require_object_mode(splats)
        if np.array_equal(point_positions(splats.data), run.gaussians.means):
            for layer in set(run.layers) & set(layer_names(splats)):
                _set_layer(splats, layer, run.layers[layer])
        else:
            splats.hide_viewport = splats.hide_render = True
            del splats[RUN_PROPERTY]  # its files are gone


def _set_layer(splats: bpy.types.Object, layer: str, colors: NDArray[np.float32]) -> None:
    mesh = splats.data
    rgba = np.zeros((len(mesh.vertices), 4), np.float32)
    rgba[is_gaussian(mesh)] = opaque(colors)
    write_attribute(mesh, color_attribute(layer), "FLOAT_COLOR", rgba)
    mesh.update()
