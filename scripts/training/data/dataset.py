"""The paired dataset: images, and their recolouring by a teacher for several observers each.

    FOLDER/manifest.json                what the samples are and how they were made; grows while they are
    FOLDER/samples/000123.safetensors   input (H, W, 3) uint8, targets (K, H, W, 3) uint8

Sample i follows from the seed and i alone, so samples are made in any order, by any number of processes, and what an
interrupted run left is used by the next. The first samples of a dataset are a smaller dataset with the same settings.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import multiprocessing
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load as load_tensors
from safetensors.numpy import save as save_tensors

from ....core.color.matrices import check_simulation
from ....core.color.simulation import Observer
from ....core.enhance.teacher import TeacherSettings, fit_luts
from ....core.errors import InputError
from ....core.files.images import to_bytes
from ....core.files.untrusted import read_json, replacing
from ....core.runtime.protocol import Reporter
from ..gradient_teacher import GradientTeacher
from .kinds import KIND_SHARES, KINDS, PHOTOGRAPH, SMALLEST_IMAGE, Photographs, draw_input, draw_observers

STAGE = "pairs"
TEACHERS = ("lut", "gradient")
"""Teachers that make targets: one LUT an image, or gradient-domain daltonisation."""

MANIFEST = "manifest.json"
_FORMAT, _VERSION = "cvdgs-pairs", 1
_MANIFEST_INTERVAL = 10.0  # seconds between two versions of a growing manifest
_LARGEST_COUNT = 1_000_000  # the file names have six digits
_MANIFEST_BYTES = 512 * _LARGEST_COUNT  # of a manifest, with room to spare

# A sixth of the default fit's time; on six images of as many kinds its CCPR is lower by 0.003 on average.
FAST_TEACHER = TeacherSettings(pairs=1000, steps=80, relaxation_steps=30, learning_rate=0.02)
"""The LUT teacher's settings for targets."""


@dataclass(frozen=True)
class DatasetSettings:
    """What a dataset is made of.

    Attributes:
        count: number of samples.
        size: sides of the images, in pixels.
        seed: of everything random.
        teacher: one of `TEACHERS`.
        observers: targets a sample, each for another observer.
        kind_shares: how often each kind of image is drawn, in proportion.
        photographs: folders whose images are inputs too.
        photograph_share: of the samples; without `photographs` there are none.
        processes: that work in parallel; the result does not depend on it.
    """

    count: int = 1500
    size: int = 288
    seed: int = 0
    teacher: str = "lut"
    observers: int = 4
    kind_shares: Mapping[str, float] = field(default_factory=lambda: dict(KIND_SHARES))
    photographs: tuple[str, ...] = ()
    photograph_share: float = 0.08
    processes: int = 1

    def check(self) -> None:
        """Raise `InputError` for values from which no dataset can be made."""
        limits = (
            ("count", self.count, 1, _LARGEST_COUNT),
            ("size", self.size, SMALLEST_IMAGE, 4096),
            ("seed", self.seed, 0, 2**63 - 1),
            ("observers", self.observers, 1, 64),
            ("photograph_share", self.photograph_share, 0.0, 1.0),
            ("processes", self.processes, 1, 256),
        )
        for name, value, low, high in limits:
            if not low <= value <= high:  # also refuses NaN
                raise InputError(f"{value} is out of range", where=name, remedy=f"give {low:g} to {high:g}")
        if self.teacher not in TEACHERS:
            raise InputError(f"there is no teacher {self.teacher!r}", remedy=f"use {' or '.join(TEACHERS)}")
        unknown = set(self.kind_shares) - set(KINDS)
        shares = list(self.kind_shares.values())
        if unknown or not shares or min(shares) < 0.0 or not 0.0 < sum(shares) < np.inf:
            raise InputError("the shares are unusable", where="kind_shares", remedy=f"use some of {', '.join(KINDS)}")


@dataclass(frozen=True)
class Sample:
    """An image and its recolourings.

    Attributes:
        input: (H, W, 3) uint8.
        targets: (K, H, W, 3) uint8.
        observers: K (type, severity, simulation), for whom each target is.
        kind: what the image shows, one of `KINDS` or `PHOTOGRAPH`.
    """

    input: NDArray[np.uint8]
    targets: NDArray[np.uint8]
    observers: tuple[tuple[str, float, str], ...]
    kind: str


def make_dataset(folder: Path, settings: DatasetSettings, reporter: Reporter | None = None) -> None:
    """Make a dataset, or what is missing or damaged of it.

    Args:
        folder: created as needed; it may hold a dataset that was made with the same settings, of any `count`.
        settings: see there.
        reporter: hears of every sample.

    Raises:
        InputError: unusable settings, photographs that cannot be read, or a folder that holds something else.
    """
    settings.check()
    reporter = reporter or Reporter()
    reporter.status(STAGE, f"{settings.count} images for {settings.observers} observers each")
    photographs = Photographs.find(settings.photographs)
    description = _describe(settings, photographs)
    entries = _reusable_entries(folder, description)
    (folder / "samples").mkdir(parents=True, exist_ok=True)
    wanted = [index for index in range(settings.count) if index not in entries]
    _write_manifest(folder, description, entries)
    written = time.monotonic()
    made = _make_samples(folder, settings, photographs, wanted)
    try:
        for index, entry in made:
            entries[index] = entry
            if time.monotonic() - written > _MANIFEST_INTERVAL:
                _write_manifest(folder, description, entries)
                written = time.monotonic()
            reporter.progress(STAGE, len(entries) / max(settings.count, len(entries)), f"sample {len(entries)}")
    finally:
        made.close()
        _write_manifest(folder, description, entries)
    reporter.progress(STAGE, 1.0)


class PairedDataset:
    """Reads a dataset, also one that is still growing: it has the samples that were listed when it was opened.

    Args:
        folder: that `make_dataset` wrote.

    Raises:
        InputError: the manifest is missing, damaged or of another version.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        manifest = _read_manifest(folder)
        self._settings: dict[str, Any] = manifest["settings"]
        self._entries = [entry for _, entry in sorted(manifest["samples"].items())]

    def __len__(self) -> int:
        return len(self._entries)

    @property
    def summary(self) -> dict[str, Any]:
        """The settings, the number of samples and how many there are of each kind; JSON values."""
        kinds = [entry["kind"] for entry in self._entries]
        counts = {kind: kinds.count(kind) for kind in sorted(set(kinds))}
        return {**self._settings, "samples": len(self), "kinds": counts}

    def sample(self, index: int) -> Sample:
        """Read a sample; `index` counts those that are there, from 0.

        Raises:
            InputError: its file is missing or not what the manifest says.
        """
        entry = self._entries[index]
        path = self._folder / "samples" / entry["file"]
        remedy = "run the same command again to remake it"
        try:
            content = path.read_bytes()
        except OSError as error:
            raise InputError(f"the sample cannot be read ({error.strerror})", where=path, remedy=remedy) from None
        if hashlib.sha256(content).hexdigest() != entry["sha256"]:
            raise InputError("the sample is damaged", where=path, remedy=remedy)
        observers = tuple((cvd, severity, model) for cvd, severity, model in entry["observers"])
        try:
            tensors = load_tensors(content)
            image, targets = tensors["input"], tensors["targets"]
        except (SafetensorError, KeyError) as error:
            raise InputError(f"the sample cannot be read ({error})", where=path, remedy=remedy) from None
        if (
            image.dtype != np.uint8
            or targets.dtype != np.uint8
            or image.ndim != 3
            or targets.shape != (len(observers), *image.shape)
        ):
            raise InputError("the sample is not a pair of images", where=path, remedy=remedy)
        return Sample(image, targets, observers, entry["kind"])


# ---- making


def _make_samples(
    folder: Path, settings: DatasetSettings, photographs: Photographs, indices: Sequence[int]
) -> Generator[tuple[int, dict[str, Any]], None, None]:
    """Make the samples of these indices, in any order; yields each one's manifest entry when it is on the disk."""
    if settings.processes == 1 or len(indices) < 2:
        for index in indices:
            yield index, _make_sample(folder, settings, photographs, index)
        return
    # Not forked: torch's threads and kornia's do not survive it.
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(settings.processes, context, initializer=torch.set_num_threads, initargs=(1,))
    try:
        waiting = iter(indices)
        running: dict[Future, int] = {}
        while True:
            # No more than the processes need, so that an interrupted run ends at once.
            for index in itertools.islice(waiting, 2 * settings.processes - len(running)):
                running[pool.submit(_make_sample, folder, settings, photographs, index)] = index
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                yield running.pop(future), future.result()
    finally:
        pool.shutdown(cancel_futures=True)


def _make_sample(folder: Path, settings: DatasetSettings, photographs: Photographs, index: int) -> dict[str, Any]:
    """Draw, recolour and store one sample; its manifest entry."""
    generator = np.random.default_rng([settings.seed, index])
    drawn = draw_input(settings.size, settings.kind_shares, photographs, settings.photograph_share, generator)
    observers = draw_observers(settings.observers, drawn.confuses, generator)
    targets = np.stack(_TARGETS[settings.teacher](drawn.image, observers, index))
    content = save_tensors({"input": np.ascontiguousarray(drawn.image), "targets": targets})
    name = f"{index:06d}.safetensors"
    _write(folder / "samples" / name, content)
    return {
        "file": name,
        "sha256": hashlib.sha256(content).hexdigest(),
        "kind": drawn.kind,
        "seed": [settings.seed, index],
        "confuses": drawn.confuses,
        "source": drawn.source,
        "observers": [[observer.cvd, observer.severity, observer.simulation] for observer in observers],
    }


def _lut_targets(image: NDArray[np.uint8], observers: Sequence[Observer], seed: int) -> list[NDArray[np.uint8]]:
    return [to_bytes(lut(image)) for lut in fit_luts([image], observers, settings=FAST_TEACHER, seed=seed)]


def _gradient_targets(image: NDArray[np.uint8], observers: Sequence[Observer], seed: int) -> list[NDArray[np.uint8]]:
    teachers = [
        GradientTeacher(observer.cvd, observer.severity, observer.simulation, seed=seed) for observer in observers
    ]
    for teacher in teachers:
        teacher.fit([image])
    return [to_bytes(teacher(image)) for teacher in teachers]


_TARGETS: Mapping[str, Callable[[NDArray[np.uint8], Sequence[Observer], int], list[NDArray[np.uint8]]]] = {
    "lut": _lut_targets,
    "gradient": _gradient_targets,
}


# ---- the manifest


def _describe(settings: DatasetSettings, photographs: Photographs) -> dict[str, Any]:
    """What the samples depend on, besides their index; JSON values."""
    description = asdict(settings)
    del description["count"], description["processes"]
    description["photographs"] = list(photographs.names)
    if settings.teacher == "lut":
        description["teacher_settings"] = asdict(FAST_TEACHER)
    return description


def _reusable_entries(folder: Path, description: Mapping[str, Any]) -> dict[int, dict[str, Any]]:
    """Entries of the samples in `folder` that are intact; refuses a folder that holds anything else."""
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        return {}
    manifest = _read_manifest(folder)
    if manifest["settings"] != json.loads(json.dumps(description)):
        raise InputError(
            "the dataset there was made with other settings", where=folder, remedy="give another folder or empty it"
        )
    return {
        index: entry
        for index, entry in manifest["samples"].items()
        if _is_intact(folder / "samples" / entry["file"], entry["sha256"])
    }


def _is_intact(path: Path, sha256: str) -> bool:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest() == sha256
    except OSError:
        return False


def _write_manifest(folder: Path, description: Mapping[str, Any], entries: Mapping[int, Mapping[str, Any]]) -> None:
    manifest = {
        "format": _FORMAT,
        "version": _VERSION,
        "settings": description,
        "samples": {str(index): entries[index] for index in sorted(entries)},
    }
    _write(folder / MANIFEST, json.dumps(manifest, indent=1).encode())


def _write(path: Path, content: bytes) -> None:
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def _read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest, checked, the samples by their number."""
    path = folder / MANIFEST
    remedy = "give a folder that make_dataset wrote"
    if not path.exists():
        raise InputError("there is no paired dataset", where=path, remedy=remedy)
    manifest = read_json(path, most_bytes=_MANIFEST_BYTES, remedy=remedy)
    if not isinstance(manifest, dict) or manifest.get("format") != _FORMAT:
        raise InputError("not the manifest of a paired dataset", where=path, remedy=remedy)
    if manifest.get("version") != _VERSION:
        raise InputError(
            f"the dataset has version {manifest.get('version')!r}, not {_VERSION}",
            where=path,
            remedy="make it again",
        )
    try:
        samples = {int(number): _checked_entry(int(number), entry) for number, entry in manifest["samples"].items()}
        settings = dict(manifest["settings"])
    except (KeyError, TypeError, ValueError, AttributeError, InputError):
        raise InputError("the manifest is damaged", where=path, remedy=remedy) from None
    return {"settings": settings, "samples": samples}


def _checked_entry(index: int, entry: Mapping[str, Any]) -> dict[str, Any]:
    """The entry, if it is one; its file lies in the samples' folder and nowhere else."""
    observers = [(cvd, float(severity), model) for cvd, severity, model in entry["observers"]]
    for observer in observers:
        check_simulation(*observer)
    if entry["file"] != f"{index:06d}.safetensors" or entry["kind"] not in (*KINDS, PHOTOGRAPH):
        raise ValueError("not an entry")
    return {**entry, "sha256": str(entry["sha256"]), "observers": observers}
