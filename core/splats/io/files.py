"""Reads and writes files of Gaussians of any format. numpy only: Blender's Python imports this.

The format is recognised by the content when a file is read, and chosen by the suffix when it is written.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...files.untrusted import opened
from ...runs.layout import ORIGINAL
from ..floaters import floater_scores, kept_after
from ..gaussians import MOST_FILE_BYTES, Gaussians
from ..web.page import SUFFIX as WEB_PAGE_SUFFIX
from ..web.page import write_web_page
from .gltf import MAGIC as GLTF_MAGIC
from .gltf import read_glb, write_glb
from .layers import layer_name, sharing_geometry
from .ply import EXPORT_PLAIN, read_floaters, read_ply, write_ply
from .splat_file import read_splat, write_splat
from .spz import GZIP_MAGIC, MAGIC, read_spz, write_spz
from .usd import SUFFIXES as USD_SUFFIXES
from .usd import require_usd, write_usd

_WRITERS: dict[str, Callable[[Path, Gaussians], None]] = {".ply": write_ply, ".spz": write_spz, ".splat": write_splat}
# These hold several layers, what points up, and how long a unit is.
_WRITERS_OF_LAYERS: dict[str, Callable[[Path, Mapping[str, Gaussians], str, float], None]] = {
    ".glb": write_glb,
    **dict.fromkeys(USD_SUFFIXES, write_usd),
    # A page has its own cameras, and no unit.
    WEB_PAGE_SUFFIX: lambda path, layers, up, _: write_web_page(path, layers, up),
}
SUFFIXES = (*_WRITERS, ".glb")  # of what is read and written
WITH_A_WORLD = (".glb", *USD_SUFFIXES)
"""Suffixes of the formats that say which direction is up, and how long a unit is."""
_WRITTEN = (*_WRITERS, *_WRITERS_OF_LAYERS)
# Other formats of splat programs, by suffix; most have no magic bytes.
_OTHER_FORMATS = {
    ".sog": "SOG (PlayCanvas, SuperSplat)",
    ".ksplat": "KSPLAT (GaussianSplats3D)",
    ".lcc": "LCC (XGRIDS)",
    ".spx": "SPX (Reall3D)",
    ".rad": "RAD (Spark)",
    ".gltf": "glTF in several files",
    **dict.fromkeys(USD_SUFFIXES, "USD"),
}
_HIGHEST_LOGIT = 30.0  # exporters write an opacity of one as an infinite logit; from 17 on, float32 opacities are one


def read_gaussians(path: str | Path, *, drop_damaged: bool = False) -> Gaussians:
    """Read a 3DGS .ply (text or binary), a .spz (version 2 to 4), a .splat or the first layer of a .glb file.

    Infinite opacity logits become large ones, and rotations of length zero the identity. All returned values are
    finite.

    Args:
        path: the file.
        drop_damaged: drop Gaussians with other values that are not finite, instead of refusing the file.

    Raises:
        InputError: none of these formats, empty, cut short, a mesh, or damaged.
    """
    return next(iter(read_layers([path], drop_damaged=drop_damaged).values()))


def read_layers(paths: Sequence[str | Path], *, drop_damaged: bool = False) -> dict[str, Gaussians]:
    """Read files of the same Gaussians in several colours: a layer each, named after the file, or the layers of a .glb.

    The layers share the arrays of their geometry; otherwise as `read_gaussians`.

    Raises:
        InputError: also where the geometries differ or two layers have one name.
    """
    return read_sound_layers(paths, drop_damaged=drop_damaged)[0]


def read_sound_layers(
    paths: Sequence[str | Path], *, drop_damaged: bool = False
) -> tuple[dict[str, Gaussians], NDArray[np.bool_]]:
    """As `read_layers`; also returns which of the N Gaussians of the files the layers hold, (N,)."""
    layers: dict[str, Gaussians] = {}
    sources: dict[str, Path] = {}
    for path in map(Path, paths):
        for name, gaussians in _read(path).items():
            if name in layers:
                raise InputError(f"a second layer called '{name}'", where=path, remedy="rename one of the files")
            if not len(gaussians):
                raise InputError("it holds no Gaussians", where=path, remedy="export it again")
            first = next(iter(layers.values()), gaussians)
            layers[name] = gaussians if first is gaussians else sharing_geometry(first, gaussians, path)
            sources[name] = path
    first = next(iter(layers.values()))
    np.clip(first.opacity_logits, -_HIGHEST_LOGIT, _HIGHEST_LOGIT, out=first.opacity_logits)
    first.quaternions[~first.quaternions.any(axis=1), 0] = 1.0
    damaged = np.zeros(len(first), bool)
    for name, gaussians in layers.items():
        damaged |= _damaged(gaussians)
        if damaged.any() and not drop_damaged:
            raise InputError(
                f"{damaged.sum():,} of {len(gaussians):,} Gaussians have values that are not finite numbers",
                where=sources[name],
                remedy="export it again, or drop them (scripts/convert.py --drop-damaged)",
            )
    if not damaged.any():
        return layers, ~damaged
    if damaged.all():
        what = "every Gaussian has values that are not finite numbers"
        raise InputError(what, where=sources[next(iter(layers))], remedy="export it again")
    return _taken(layers, ~damaged), ~damaged


def write_gaussians(path: str | Path, gaussians: Gaussians) -> None:
    """Write `gaussians` in the format of the suffix of `path`: .ply, .spz (version 3), .splat, .glb, .usd or .html.

    A .splat file holds colours of degree 0 only. The file is written completely or not at all.

    Raises:
        InputError: an unknown suffix, or the file cannot be written.
    """
    write_layers(path, {ORIGINAL: gaussians})


def write_layers(path: str | Path, layers: Mapping[str, Gaussians], *, up: str = "", metres: float = 1.0) -> None:
    """Write `layers`, whose geometry is the first one's, as `write_gaussians` does.

    Args:
        up: the axis of the scene that points up, as `layers.turn_to_y` takes it, or nothing where that is not known.
        metres: in a unit of the scene; formats without a place for it leave it out.

    Raises:
        InputError: also for several layers, or `up`, in a format that has no place for them.
    """
    path = Path(path)
    require_known_suffix(path)
    suffix = path.suffix.lower()
    if suffix in _WRITERS_OF_LAYERS:
        _WRITERS_OF_LAYERS[suffix](path, layers, up, metres)
        return
    if up or len(layers) > 1:
        what = "cannot say what is up" if up else f"holds one layer, not {len(layers)}"
        able = ".glb, .usd or .html"
        remedy = f"write {able}" if up else f"write {able}, or choose one (scripts/convert.py --layer)"
        raise InputError(f"a {suffix} file {what}", where=path, remedy=remedy)
    (gaussians,) = layers.values()
    _WRITERS[suffix](path, gaussians)


def most_important(layers: Mapping[str, Gaussians], count: int) -> dict[str, Gaussians]:
    """The `count` Gaussians of every layer that contribute most to pictures, in their order; all if they are fewer."""
    first = next(iter(layers.values()))
    if len(first) <= count:
        return dict(layers)
    return _taken(layers, np.sort(np.argsort(-first.importance, kind="stable")[:count]))


def without_floaters(
    layers: Mapping[str, Gaussians],
    paths: Sequence[str | Path],
    clean: float,
    held: NDArray[np.bool_] | None = None,
) -> dict[str, Gaussians]:
    """Every layer without the Gaussians whose scores are above 1 - `clean`; see `core.splats.floaters`.

    Args:
        paths: the files of the layers. Of a run, one has the scores; else shape and place alone tell.
        held: (N,) which of the files' Gaussians the layers hold; without it all.

    Raises:
        InputError: nothing would be left, or scores are damaged.
    """
    first = next(iter(layers.values()))
    held = np.ones(len(first), bool) if held is None else held
    recorded = (read_floaters(path) for path in map(Path, paths) if _is_ply(_start_of(path)))
    scores = next((one[held] for one in recorded if one is not None and len(one) == len(held)), None)
    kept = kept_after(floater_scores(first) if scores is None else scores, clean)
    if not kept.any():
        raise InputError("nothing would be left", where=paths[0], remedy="give --clean a smaller number")
    return _taken(layers, kept)


def require_known_suffix(path: Path) -> None:
    """Raise `InputError` unless `write_gaussians` can write to a file with the suffix of `path`."""
    suffix = path.suffix.lower()
    if suffix not in _WRITTEN:
        raise InputError(
            f"'{path.suffix}' is not a format for Gaussians", where=path, remedy=f"name the file {', '.join(_WRITTEN)}"
        )
    if suffix in USD_SUFFIXES:
        require_usd(path)


def _taken(layers: Mapping[str, Gaussians], index: NDArray[np.integer] | NDArray[np.bool_]) -> dict[str, Gaussians]:
    """The same Gaussians of every layer, as `Gaussians.take` chooses them; their geometry stays shared."""
    geometry = next(iter(layers.values())).take(index)
    return {name: replace(geometry, sh=gaussians.sh[index]) for name, gaussians in layers.items()}


def _start_of(path: Path) -> bytes:
    """The bytes that tell most formats apart."""
    with opened(path, most_bytes=MOST_FILE_BYTES) as file:
        return file.read(4)


def _is_ply(start: bytes) -> bool:
    return start[:3] == b"ply"


def _read(path: Path) -> dict[str, Gaussians]:
    """The layers as they are in the file."""
    start = _start_of(path)
    if not start:
        raise InputError("the file is empty", where=path, remedy="copy or export it again")
    if _is_ply(start):
        return {layer_name(path): read_ply(path)}
    if start == MAGIC or start[:2] == GZIP_MAGIC:
        return {layer_name(path): read_spz(path)}
    if start == GLTF_MAGIC:
        return read_glb(path)
    # A .splat file has no magic bytes: only its suffix tells.
    if path.suffix.lower() == ".splat":
        return {layer_name(path): read_splat(path)}
    suffix = path.suffix.lower()
    if suffix in _OTHER_FORMATS:
        raise InputError(f"{_OTHER_FORMATS[suffix]} cannot be read", where=path, remedy=EXPORT_PLAIN)
    raise InputError(
        "not a file of Gaussians in a known format",
        where=path,
        remedy=f"choose one of {', '.join(SUFFIXES)}, or {EXPORT_PLAIN}",
    )


def _damaged(gaussians: Gaussians) -> NDArray[np.bool_]:
    """(N,) whether any value of the Gaussian is not finite."""
    result = np.zeros(len(gaussians), bool)
    for field in fields(Gaussians):
        values = getattr(gaussians, field.name).reshape(len(gaussians), -1)
        with np.errstate(over="ignore", invalid="ignore"):
            # One pass over the sum instead of one per value; it overflows only for values far beyond any use.
            result |= ~np.isfinite(values.sum(axis=1, dtype=np.float32))
    return result
