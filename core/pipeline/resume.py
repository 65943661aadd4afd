"""Adding layers to a finished run: what it was made of, what has to be the same, and the report of both."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..capture.model import Capture, View
from ..capture.reader import inspect_capture, read_capture
from ..errors import InputError
from ..files.untrusted import MAX_JSON_BYTES, explained, is_file, is_there, parse_json, read_text
from ..runs.layout import CAPTURE_FOLDER, GAUSSIANS_FILE, REPORT_FILE, layer_gaussians_file, layer_still_file
from ..runs.report import SCHEMA, check_report
from ..runtime.protocol import Reporter, StageSpan
from ..settings import Settings
from ..splats.calibration.corrections import CORRECTED
from ..splats.gaussians import Gaussians
from ..splats.io.ply import read_ply
from ..splats.training.given_cameras import GIVEN_POSES
from ..splats.training.lens import FOCAL_LENGTH
from .given import NEW_RUN, completed_addition

_POSE_TOLERANCE = 1e-6


@dataclass(frozen=True)
class EarlierRun:
    """A finished run to which layers are added.

    Attributes:
        out: its folder as the user named it.
        report: its report.
        settings: its own.
        capture: its photographs and cameras as they were used.
        gaussians: geometry and original colours.
        layers: those whose files are there; one that was lost may be added again.
    """

    out: str
    report: dict[str, Any]
    settings: Settings
    capture: Capture
    gaussians: Gaussians
    layers: frozenset[str]

    @classmethod
    def read(cls, folder: Path, out: str) -> EarlierRun:
        """Read a run from `folder`, which the user calls `out`.

        Raises:
            InputError: there is none, or its files are damaged.
        """
        if not (folder / REPORT_FILE).exists():
            raise InputError(
                "no finished run to add a layer to, and no checkpoint to go on from",
                where=out,
                remedy="leave out --resume",
            )
        try:
            report = parse_json(read_text(folder / REPORT_FILE, most_bytes=MAX_JSON_BYTES, remedy=NEW_RUN))
            schema = report["schema"]
            if schema != SCHEMA:
                raise InputError(f"the run was made by another version ({schema})", where=out, remedy=NEW_RUN)
            settings = _settings_of(report, out)
            check_report(report)
        except (ValueError, KeyError, TypeError) as error:
            what = f"the report of the finished run is damaged{explained(error)}"
            raise InputError(what, where=out, remedy=NEW_RUN) from None
        # Its order decides which views are held out, and earlier versions wrote another one than `read_capture` has.
        capture = read_capture(folder / CAPTURE_FOLDER, max_size=None, keep_order=True)
        layers = frozenset(name for name in report["layers"] if is_file(folder / layer_gaussians_file(name)))
        return cls(out, report, settings, capture, read_ply(folder / GAUSSIANS_FILE), layers)

    def complete(self, asked: Settings) -> Settings:
        """`asked` with the run's own value of every option that has to be the same and was left at its default.

        Raises:
            InputError: such an option has another value, or the run has one of the layers.
        """
        asked = completed_addition(asked, self.settings)
        present = sorted({layer.name for layer in asked.layers} & self.layers)
        if present:
            raise InputError(
                f"the finished run has {', '.join(present)} already", where="--cvd", remedy="ask for other layers"
            )
        return asked

    def check_photographs(self, folder: Path, reporter: Reporter) -> None:
        """Make sure that `folder` is the capture that the run was made from, or the run's own copy of it.

        Where the run estimated the cameras itself, these stay, and only the number of photographs is compared; where it
        corrected them, the poses or the focal lengths are not compared.

        Raises:
            InputError: it is another one, or it has changed.
        """
        own = Path(self.out, CAPTURE_FOLDER)
        if is_there(folder) and is_there(own) and folder.samefile(own):
            return  # its cameras lie in it, wherever those of the run came from
        found = inspect_capture(folder, cameras=self.settings.cameras_from)
        if found.format == "sfm":
            # Which frames of a video are taken is not known before it is looked through.
            enough = found.views >= len(self.capture.views) or found.videos > 0
            _require(enough, f"{found.views} photographs, fewer than the finished run has", folder)
            return
        size = max(max(view.camera.width, view.camera.height) for view in self.capture.views)
        # The finished run's report has its warnings already.
        quiet = StageSpan(reporter, "capture", 0.0, 1.0, "comparing with the finished run", warns=False)
        given = read_capture(folder, max_size=size, cameras=self.settings.cameras_from, reporter=quiet)
        found_to_move = self.report.get("moving", {}).get("views", [])
        _compare(
            *(given.views, self.capture.views, folder, found_to_move),
            poses=self._as_given("poses") and self._as_given(GIVEN_POSES),
            lens=self._as_given(FOCAL_LENGTH),
        )

    def _as_given(self, what: str) -> bool:
        """Whether the run left `what` of the cameras as it was."""
        return not str(self.report.get("decision", {}).get(what, "")).startswith(CORRECTED)

    def extend(self, added: Mapping[str, Any]) -> dict[str, Any]:
        """The run's report with the layers of a report that has only what was added.

        ``resumed`` gets an entry with the names of the layers and the seconds; the run's own ``seconds`` stay.
        """
        warnings = self.report["warnings"] + [item for item in added["warnings"] if item not in self.report["warnings"]]
        peaks = [report["peak_memory_mb"] for report in (self.report, added) if report["peak_memory_mb"]]
        addition = {
            "layers": list(added["layers"]),
            "settings": added["settings"],
            "versions": added["versions"],
            "device": added["device"],
            "seconds": added["seconds"],
        }
        own, layers = self.report["settings"], added["settings"]["layers"]
        kept = [layer for layer in own["layers"] if layer not in layers]  # one that was lost is there already
        return {
            **self.report,
            **_without_pictures_of(added["layers"], self.report),
            "settings": {**own, "layers": [*kept, *layers]},
            "layers": {**self.report["layers"], **added["layers"]},
            "peak_memory_mb": max(peaks, default=None),
            "warnings": warnings,
            "notes": {**self.report["notes"], **added["notes"]},
            "resumed": [*self.report.get("resumed", ()), addition],
        }


def _without_pictures_of(layers: Collection[str], report: Mapping[str, Any]) -> dict[str, Any]:
    """The parts of `report` that list pictures, less those of `layers`.

    A layer that is added may be one that was lost, of which `remove_layer` has deleted the pictures that were left.
    """
    gone = (*layers, *map(layer_still_file, layers))
    parts = {}
    for name, listing in (("blender", "stills"), ("turntable", "layers")):
        part = report.get(name)
        if isinstance(part, dict) and isinstance(part.get(listing), list):
            parts[name] = {**part, listing: [entry for entry in part[listing] if entry not in gone]}
    return parts


def _settings_of(report: Mapping[str, Any], out: str) -> Settings:
    """The settings that the run of `report` had.

    Raises:
        InputError: they are damaged; what is wrong with them concerns the run, not the options that are given now.
        KeyError, TypeError, ValueError: there are none.
    """
    try:
        return Settings.from_dict({**report["settings"], "resume": False})
    except InputError as error:
        what = f"the report of the finished run is damaged ({error.where}: {error.what})"
        raise InputError(what, where=out, remedy=NEW_RUN) from None


def _compare(
    given: Sequence[View], used: Sequence[View], folder: Path, moving: Collection[str], *, poses: bool, lens: bool
) -> None:
    """Views called in `moving` have masks of the run's own beside those that were given."""
    _require(len(given) == len(used), f"{len(given)} views, the finished run has {len(used)}", folder)
    for new, old in zip(*(sorted(views, key=attrgetter("key")) for views in (given, used)), strict=True):
        _require(new.key == old.key, f"view '{new.key}' where the finished run has '{old.key}'", folder)
        sizes = [f"{view.camera.width}x{view.camera.height}" for view in (new, old)]
        _require(sizes[0] == sizes[1], f"view '{new.key}' is {sizes[0]}, in the finished run {sizes[1]}", folder)
        same = (
            _are_near(_middle(new), _middle(old))
            and (not lens or _are_near(_focal_lengths(new), _focal_lengths(old)))
            and (not poses or _are_near(new.world_to_camera, old.world_to_camera))
        )
        _require(same, f"view '{new.key}' has another camera than in the finished run", folder)
        new_mask, old_mask = (np.ones(0, bool) if view.mask is None else view.mask for view in (new, old))
        if old.key in moving and old.mask is not None:
            new_mask = old_mask if new.mask is None else old_mask & new.mask
        _require(np.array_equal(new_mask, old_mask), f"the mask of '{new.key}' has changed since the run", folder)
        _require(np.array_equal(new.image, old.image), f"photograph '{new.key}' has changed since the run", folder)


def _are_near(first: ArrayLike, second: ArrayLike) -> bool:
    return np.allclose(first, second, rtol=_POSE_TOLERANCE, atol=_POSE_TOLERANCE)


def _middle(view: View) -> tuple[float, float]:
    return view.camera.cx, view.camera.cy


def _focal_lengths(view: View) -> tuple[float, float]:
    return view.camera.fx, view.camera.fy


def _require(condition: bool, what: str, folder: Path) -> None:
    if not condition:
        raise InputError(what, where=folder, remedy=f"give the run's own capture, or {NEW_RUN}")
