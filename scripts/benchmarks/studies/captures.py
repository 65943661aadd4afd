"""The captures of studies: the demo, other synthetic showrooms and any folder; rendered and read as needed."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Protocol

import numpy as np

from ....core.bootstrap import ROOT
from ....core.capture.model import Capture, View
from ....core.capture.reader import read_capture
from ....core.demo import SHOWROOM
from ....core.errors import InputError
from ....core.evaluate.evaluation import Split
from ....core.runtime.protocol import Reporter, StageSpan
from ....core.settings import Settings
from ..provenance import digest_of, fingerprint

STAGE = "scenes"
DEMO = "demo"
RENDERED: Mapping[str, tuple[str, ...]] = {
    "showroom-protan": ("--seed", "5", "--variant", "protan"),
    "showroom-tritan": ("--seed", "9", "--variant", "tritan", "--satin-roughness", ".15", "--yarn-scale", ".6"),
}
"""Showrooms that are not shipped, with the arguments of make_showroom.py; each has colours that its type confuses."""
SHOWROOMS = (DEMO, *RENDERED)
_SIZE = ("--width", "480", "--height", "360")
_SCRIPT = ROOT / "scripts" / "make_showroom.py"
_CAMERAS = "transforms.json"  # written last, so a showroom that has it is complete
_PROGRESS = re.compile(r"photographs: +(\d+) %")


@dataclass(frozen=True)
class Subject:
    """A capture to train on, and the capture that results are evaluated on: the same unless one was perturbed.

    Attributes:
        given: the capture to train on.
        split: of `given`; its test views serve the training curve and the product's own decisions.
        judged: the capture whose held-out views figures are measured on.
        judged_split: of `judged`.
    """

    given: Capture
    split: Split
    judged: Capture
    judged_split: Split

    @classmethod
    def of(cls, capture: Capture, holdout: int = Settings.holdout) -> Subject:
        """The ordinary case: every `holdout`-th view of the capture is held out."""
        split = Split.every(len(capture.views), holdout)
        return cls(capture, split, capture, split)

    @property
    def is_ordinary(self) -> bool:
        """Whether results are judged by the capture that was given."""
        return self.judged is self.given


class SubjectSource(Protocol):
    """Loads a subject; small enough to be sent to another process.

    Attributes:
        name: what tables call it.
    """

    @property
    def name(self) -> str: ...

    @property
    def key(self) -> str:
        """Changes with the subject; the same in every session."""
        ...

    def load(self) -> Subject:
        """Read it."""
        ...


@dataclass(frozen=True)
class CaptureFolder:
    """A capture in a folder.

    Attributes:
        name: what tables call it.
        folder: any capture that the product reads.
        max_size: longer side of the views in pixels.
        fitted_size: longer side of the views to train on, if smaller than those that results are judged by.
    """

    name: str
    folder: Path
    max_size: int
    fitted_size: int | None = None

    @property
    def key(self) -> str:
        files = sorted(path for path in self.folder.rglob("*") if path.is_file())
        contents = [(path.relative_to(self.folder).as_posix(), _content(path)) for path in files]
        fitted = self.max_size if self.fitted_size is None else min(self.fitted_size, self.max_size)
        return repr((self.name, self.max_size, fitted, contents))

    def load(self) -> Subject:
        judged = Subject.of(read_capture(self.folder, max_size=self.max_size))
        if self.fitted_size is None or self.fitted_size >= self.max_size:
            return judged
        given = Subject.of(read_capture(self.folder, max_size=self.fitted_size))
        return Subject(given.given, given.split, judged.judged, judged.judged_split)


def _content(file: Path) -> str:
    """The digest of a file, which is read once as long as it does not change."""
    found = file.stat()
    return _digest(file, found.st_size, found.st_mtime_ns)


@cache
def _digest(file: Path, size: int, written: int) -> str:  # the latter two tell whether it has changed
    return digest_of(file)


@dataclass(frozen=True)
class Centred:
    """A capture cropped so that its principal points are in the middle, within a quarter of a pixel.

    Some programs take them to be there whatever the file says, OpenSplat's rasteriser for processors among them.
    """

    base: CaptureFolder

    @property
    def name(self) -> str:
        return self.base.name

    @property
    def key(self) -> str:
        return repr((self.base.key, "centred"))

    def load(self) -> Subject:
        whole = self.base.load().given
        return Subject.of(replace(whole, views=tuple(_centred(view) for view in whole.views)))


def _centred(view: View) -> View:
    camera = view.camera
    rows, columns = _span(camera.height, camera.cy), _span(camera.width, camera.cx)
    cut = (rows, columns)
    size = {"width": columns.stop - columns.start, "height": rows.stop - rows.start}
    return replace(
        view,
        camera=replace(camera, **size, cx=camera.cx - columns.start, cy=camera.cy - rows.start),
        image=np.ascontiguousarray(view.image[cut]),
        alpha=None if view.alpha is None else np.ascontiguousarray(view.alpha[cut]),
        again=None if view.again is None else np.ascontiguousarray(view.again[cut]),
        mask=None if view.mask is None else np.ascontiguousarray(view.mask[cut]),
    )


def _span(length: int, center: float) -> slice:
    """The most of `length` pixels around a centre."""
    start = max(math.ceil(2.0 * center - length), 0)
    return slice(start, min(start + round(2.0 * (center - start)), length))


def showrooms(folder: Path, reporter: Reporter, wanted: Sequence[str] = SHOWROOMS) -> dict[str, Path]:
    """The folders of the named showrooms; those missing from `folder` are rendered there, which takes minutes each.

    Raises:
        InputError: one could not be rendered.
    """
    arguments = {name: (*RENDERED[name], *_SIZE) for name in wanted if name != DEMO}
    rendered = render_showrooms(arguments, folder, reporter)
    return {name: SHOWROOM if name == DEMO else rendered[name] for name in wanted}


def capture_sources(asked: Sequence[str], max_size: int, folder: Path, reporter: Reporter) -> list[CaptureFolder]:
    """The captures named on a command line.

    Args:
        asked: names of showrooms, folders, or NAME=FOLDER.
        max_size: longer side of the views in pixels.
        folder: for rendered showrooms.

    Raises:
        InputError: there is no such capture, two have one name, or a showroom could not be rendered.
    """
    places = dict(_place(text) for text in asked)
    if len(places) < len(asked):
        raise InputError("two captures have the same name", where="--captures", remedy="use NAME=FOLDER for one")
    rendered = showrooms(folder, reporter, [name for name, place in places.items() if place is None])
    return [CaptureFolder(name, place or rendered[name], max_size) for name, place in places.items()]


def render_showrooms(wanted: Mapping[str, Sequence[str]], folder: Path, reporter: Reporter) -> dict[str, Path]:
    """Render those of the wanted showrooms that do not exist yet; returns the folders of all.

    Args:
        wanted: arguments of make_showroom.py, without ``--out``, by the showroom's name.
        folder: of the showrooms' folders, each called by its name and a digest of its arguments.

    Raises:
        InputError: one could not be rendered, most likely for lack of the bpy wheel.
    """
    places = {name: folder / f"{name}-{fingerprint(' '.join(words), tuple)}" for name, words in wanted.items()}
    missing = [name for name, place in places.items() if not (place / _CAMERAS).is_file()]
    for done, name in enumerate(missing):
        message = f"rendering {name}"
        reporter.status(STAGE, message)
        span = StageSpan(reporter, STAGE, done / len(missing), (done + 1) / len(missing), message)
        _render(places[name], wanted[name], span)
    return places


def _render(folder: Path, arguments: Sequence[str], reporter: Reporter) -> None:
    command = [sys.executable, str(_SCRIPT), "--out", str(folder), *arguments]
    # stderr goes to the same pipe, so that it cannot fill up unread.
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        assert process.stdout is not None
        last = ""
        for line in process.stdout:
            last = line.strip() or last
            if found := _PROGRESS.match(line):
                reporter.progress(STAGE, int(found[1]) / 100.0)
    if process.returncode:
        raise InputError(
            f"the showroom could not be rendered ({last})",
            where=folder,
            remedy="install the bpy wheel (pip install '.[blender]'), or leave out the axes that need it",
        )


def _place(text: str) -> tuple[str, Path | None]:
    """A capture's name and folder; None for a showroom that may have to be rendered."""
    if text in SHOWROOMS:
        return text, None
    name, separator, folder = text.partition("=")
    path = Path(folder if separator else text)
    if not path.is_dir():
        names = ", ".join(SHOWROOMS)
        raise InputError(f"unknown capture '{text}'", where="--captures", remedy=f"use {names}, FOLDER or NAME=FOLDER")
    return (name if separator else path.resolve().name), path
