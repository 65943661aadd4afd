"""Binary glTF files (GLB) with Gaussians, in and out. numpy only: Blender's Python imports this.

After Khronos' extension KHR_gaussian_splatting (ellipse kernel, display-referred sRGB) of glTF 2.0. Positions and
colour coefficients are those of `Gaussians`, bit by bit; rotations are unit quaternions xyzw, scales and opacities are
no logarithms and logits but plain. The spherical harmonics of the extension are ours, sign by sign.

Every layer is a mesh, a node and a scene called like it; the first one's scene is the file's default. The primitives
share the accessors of the geometry, so that a layer adds no more than its colours. Scenes are a part of glTF that every
viewer knows: one without node visibility would draw all layers on top of each other, and variants of materials
(KHR_materials_variants) do not concern Gaussians, whose materials are ignored. A viewer without the extension shows
points; those of the first layer have its colours (COLOR_0, linear light).
"""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Mapping
from math import inf
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from ...color.srgb import decode
from ...errors import InputError
from ...files.untrusted import opened, parse_json, writing_whole
from ..gaussians import HIGHEST_SH_DEGREE, MOST_FILE_BYTES, Gaussians, require_room
from .layers import first_of, turn_to_y
from .splat_file import finite_scales, logarithm, normalised

MAGIC = b"glTF"

_HEADER = struct.Struct("<4sIIII")  # magic, version, length of the file; length and kind of the first chunk
_CHUNK = struct.Struct("<II")  # length and kind of the second one
_JSON_CHUNK, _BINARY_CHUNK = 0x4E4F534A, 0x004E4942
_VERSION = 2
_MOST_GLB_BYTES = (1 << 32) - 1  # lengths have 32 bits
_MOST_JSON_BYTES = 1 << 20  # a layer of the highest degree takes 5 kB
_FLOAT, _UNSIGNED_SHORT = 5126, 5123  # componentType
_VERTICES = 34962  # target of a bufferView
_POINTS = 0  # mode of a primitive
_EXTENSION = "KHR_gaussian_splatting"
_KERNEL, _COLOR_SPACE = "ellipse", "srgb_rec709_display"
_SPLATTING = {
    "kernel": _KERNEL,
    "colorSpace": _COLOR_SPACE,
    "projection": "perspective",
    "sortingMethod": "cameraDistance",
}
_POSITION, _FALLBACK_COLOR = "POSITION", "COLOR_0"
_ROTATION, _SCALE, _OPACITY = (f"{_EXTENSION}:{name}" for name in ("ROTATION", "SCALE", "OPACITY"))
_GEOMETRY = {_POSITION: "VEC3", _ROTATION: "VEC4", _SCALE: "VEC3", _OPACITY: "SCALAR"}
_WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
_USE_ANOTHER = "choose a .glb that scripts/convert.py has written, or export a .ply"


def write_glb(path: str | Path, layers: Mapping[str, Gaussians], up: str = "", metres: float = 1.0) -> None:
    """Write `layers`, whose geometry is the first one's, to `path`.

    Args:
        up: the axis of the scene that points up, as `turn_to_y` takes it: the nodes turn it to glTF's Y. Without it
            they stand as they are.
        metres: in a unit of the scene, by which the nodes scale it.

    Raises:
        InputError: no Gaussians, or more than a GLB can hold.
    """
    path = Path(path)
    document = _Writer()
    first = first_of(layers, path)
    geometry = {
        _POSITION: document.add(first.means, extremes=True),
        _ROTATION: document.add(normalised(first.quaternions)[:, [1, 2, 3, 0]]),
        _SCALE: document.add(finite_scales(first.log_scales)),
        _OPACITY: document.add(_opacities(first)[:, None]),
    }
    fallback = {_FALLBACK_COLOR: document.add(_points_colors(first))}
    for name, gaussians in layers.items():
        colors = zip(_coefficients(gaussians.sh_degree), gaussians.sh.transpose(1, 0, 2), strict=True)
        attributes = {semantic: document.add(values) for semantic, values in colors}
        document.add_layer(name, geometry | attributes | fallback, turn_to_y(up), metres)
        fallback = {}
    document.write(path)


def read_glb(path: str | Path) -> dict[str, Gaussians]:
    """Read the layers of a GLB file as `write_glb` writes it: float32 throughout, one geometry, nothing compressed.

    Coordinates are those of the meshes; a rotation of their nodes only says what is up, and a scale how long a unit is.

    Raises:
        InputError: not a GLB file, without Gaussians, damaged, or of a layout that is not read.
    """
    path = Path(path)
    with opened(path, most_bytes=MOST_FILE_BYTES) as file:
        document = _Reader(file, path)
        primitives = document.primitives()
        return _read_layers(document, primitives, path)


def _coefficients(degree: int) -> list[str]:
    """Semantics of the colour terms up to `degree`, in our order."""
    return [f"{_EXTENSION}:SH_DEGREE_{n}_COEF_{i}" for n in range(degree + 1) for i in range(2 * n + 1)]


def _opacities(gaussians: Gaussians) -> NDArray[np.float32]:
    with np.errstate(over="ignore"):  # exp(-logit) of a logit below -709 is infinite, and the opacity zero
        return gaussians.opacities


def _points_colors(gaussians: Gaussians) -> NDArray[np.uint16]:
    """(N, 4) linear light and opacity in 65535ths."""
    light = decode(np.minimum(gaussians.base_colors, 1.0))
    return np.round(np.column_stack([light, _opacities(gaussians)]) * 65535.0).astype(np.uint16)


class _Writer:
    """The description of a GLB file and the numbers that it refers to."""

    def __init__(self) -> None:
        self._arrays: list[NDArray] = []
        self._size = 0
        self._document: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "cvdgs"},
            "extensionsUsed": [_EXTENSION],
            "scene": 0,
            **{kind: [] for kind in ("scenes", "nodes", "meshes", "accessors", "bufferViews")},
        }

    def add(self, values: NDArray, *, extremes: bool = False) -> int:
        """Append an attribute, (N, width) numbers or fractions of 65535; returns the number of its accessor."""
        as_fractions = values.dtype == np.uint16
        values = np.ascontiguousarray(values, "<u2" if as_fractions else "<f4")
        accessor: dict[str, Any] = {
            "bufferView": len(self._arrays),
            "componentType": _UNSIGNED_SHORT if as_fractions else _FLOAT,
            "count": len(values),
            "type": next(kind for kind, width in _WIDTHS.items() if width == values.shape[1]),
        }
        if as_fractions:
            accessor["normalized"] = True
        if extremes:
            accessor |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        view = {"buffer": 0, "byteOffset": self._size, "byteLength": values.nbytes, "target": _VERTICES}
        self._document["accessors"].append(accessor)
        self._document["bufferViews"].append(view)
        self._arrays.append(values)
        self._size += values.nbytes  # of four bytes each, or pairs of two: views stay aligned
        return len(self._arrays) - 1

    def add_layer(
        self, name: str, attributes: dict[str, int], rotation: tuple[float, ...] | None, scale: float
    ) -> None:
        """A primitive, in a mesh, node and scene of its own."""
        number = len(self._document["meshes"])
        primitive = {"attributes": attributes, "mode": _POINTS, "extensions": {_EXTENSION: _SPLATTING}}
        node = {"name": name, "mesh": number} | ({"rotation": rotation} if rotation else {})
        node |= {"scale": [scale] * 3} if scale != 1.0 else {}
        self._document["meshes"].append({"name": name, "primitives": [primitive]})
        self._document["nodes"].append(node)
        self._document["scenes"].append({"name": name, "nodes": [number]})

    def write(self, path: Path) -> None:
        """Write everything to `path`, completely or not at all."""
        text = json.dumps(self._document | {"buffers": [{"byteLength": self._size}]}, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        length = _HEADER.size + len(text) + _CHUNK.size + self._size
        if length > _MOST_GLB_BYTES or len(text) > _MOST_JSON_BYTES:
            raise InputError(
                f"a GLB cannot hold all this ({length / 1e9:.1f} GB)",
                where=path,
                remedy="write fewer layers, or a .ply",
            )
        with writing_whole(path) as file:
            file.write(_HEADER.pack(MAGIC, _VERSION, length, len(text), _JSON_CHUNK))
            file.write(text)
            file.write(_CHUNK.pack(self._size, _BINARY_CHUNK))
            for values in self._arrays:
                file.write(values.data)


class _Reader:
    """The description in an open GLB file, none of which is believed, and the numbers that it refers to."""

    def __init__(self, file: BinaryIO, path: Path) -> None:
        self._file, self._path = file, path
        size = os.fstat(file.fileno()).st_size
        header = file.read(_HEADER.size)
        if len(header) < _HEADER.size:
            raise self.cut_short()
        magic, version, length, text_length, kind = _HEADER.unpack(header)
        if (magic, version, kind) != (MAGIC, _VERSION, _JSON_CHUNK):
            raise self.refusal("not a GLB file of glTF 2.0")
        if text_length > _MOST_JSON_BYTES:
            raise self.refusal(f"its description has {text_length:,} bytes, {_MOST_JSON_BYTES:,} is the limit")
        text, chunk = file.read(text_length), file.read(_CHUNK.size)
        self._start = file.tell()
        if length > size or len(chunk) < _CHUNK.size:
            raise self.cut_short()
        self._length, kind = _CHUNK.unpack(chunk)
        if kind != _BINARY_CHUNK:
            raise self.refusal("it has no numbers beside its description")
        if self._length > size - self._start:
            raise self.cut_short()
        try:
            self._document = parse_json(text.decode())
        except ValueError as error:
            raise self.refusal(f"its description is not valid JSON ({error})") from None
        if not isinstance(self._document, dict):
            raise self.refusal("its description describes nothing")

    def refusal(self, what: str) -> InputError:
        return InputError(what, where=self._path, remedy=_USE_ANOTHER)

    def cut_short(self) -> InputError:
        return InputError("the file is cut short", where=self._path, remedy="copy or export it again")

    def primitives(self) -> dict[str, dict[str, Any]]:
        """The attributes of each primitive with Gaussians, by the name of its mesh.

        Raises:
            InputError: there are none, or what they are is not read.
        """
        needed = self._document.get("extensionsRequired", [])
        unknown = [name for name in needed if name != _EXTENSION] if isinstance(needed, list) else [needed]
        if unknown:
            raise self.refusal(f"it needs the glTF extension {unknown[0]}, which is not read")
        nodes = self._all("nodes")
        sizes = [node.get("scale", [1.0] * 3) for node in nodes]
        if any({"matrix", "translation"} & set(node) for node in nodes) or not all(map(_is_size, sizes)):
            raise self.refusal("its nodes move or stretch what they hold, which is not read")
        if any(size != sizes[0] for size in sizes):
            raise self.refusal("its nodes scale what they hold differently, which is not read")
        found: dict[str, dict[str, Any]] = {}
        for number, mesh in enumerate(self._all("meshes")):
            for primitive in _dictionaries(mesh.get("primitives")):
                splatting = _dictionary(primitive.get("extensions")).get(_EXTENSION)
                if not isinstance(splatting, dict):
                    continue
                kind = (splatting.get("kernel"), splatting.get("colorSpace"))
                if kind != (_KERNEL, _COLOR_SPACE) or splatting.get("extensions") or primitive.get("mode") != _POINTS:
                    raise self.refusal("its Gaussians are of another kind than display-referred sRGB ellipses")
                name = mesh.get("name")
                name = name if isinstance(name, str) and name else f"layer {number + 1}"
                if name in found:
                    raise self.refusal(f"two of its layers are called '{name}'")
                found[name] = _dictionary(primitive.get("attributes"))
        if not found:
            raise self.refusal("a glTF file without Gaussians")
        return found

    def count(self, number: object) -> int:
        """How many elements the accessor claims to have."""
        return self._natural(self._entry("accessors", number), "count")

    def floats(self, number: object, kind: str) -> NDArray[np.float32]:
        """(N, width) what the accessor refers to; allocates no more than the file holds."""
        accessor = self._entry("accessors", number)
        view = self._entry("bufferViews", accessor.get("bufferView"))
        size = 4 * _WIDTHS[kind]
        if (accessor.get("componentType"), accessor.get("type")) != (_FLOAT, kind) or "sparse" in accessor:
            raise self.refusal(f"an attribute is not plain float32 {kind}")
        if view.get("byteStride", size) != size or view.get("buffer") != 0:
            raise self.refusal("attributes are interleaved or in another file")
        count, offset = self._natural(accessor, "count"), self._natural(accessor, "byteOffset", 0)
        start, length = self._natural(view, "byteOffset", 0), self._natural(view, "byteLength")
        if offset + count * size > length or start + length > self._length:
            raise self.cut_short()
        self._file.seek(self._start + start + offset)
        values = np.fromfile(self._file, "<f4", count * _WIDTHS[kind])
        if len(values) < count * _WIDTHS[kind]:
            raise self.cut_short()
        return values.reshape(count, _WIDTHS[kind])

    def _all(self, kind: str) -> list[dict[str, Any]]:
        return _dictionaries(self._document.get(kind))

    def _entry(self, kind: str, number: object) -> dict[str, Any]:
        entries = self._document.get(kind)
        if isinstance(entries, list) and type(number) is int and 0 <= number < len(entries):
            return _dictionary(entries[number])
        raise self.refusal(f"its description refers to {kind} that are not there")

    def _natural(self, entry: dict[str, Any], key: str, default: int = -1) -> int:
        value = entry.get(key, default)
        if type(value) is not int or value < 0:
            raise self.refusal(f"its description has no usable {key}")
        return value


def _dictionary(value: object) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _dictionaries(value: object) -> list[dict[str, Any]]:
    return [entry for entry in value if isinstance(entry, dict)] if isinstance(value, list) else []


def _is_size(scale: object) -> bool:
    """Whether a node's scale is one positive number for all axes."""
    if not isinstance(scale, list) or len(scale) != 3 or any(number != scale[0] for number in scale):
        return False
    return isinstance(scale[0], int | float) and 0.0 < scale[0] < inf


def _read_layers(document: _Reader, primitives: dict[str, dict[str, Any]], path: Path) -> dict[str, Gaussians]:
    """The Gaussians of `primitives`, which share their geometry's accessors."""
    first = next(iter(primitives.values()))
    geometry = {semantic: first.get(semantic) for semantic in _GEOMETRY}
    if any({semantic: one.get(semantic) for semantic in _GEOMETRY} != geometry for one in primitives.values()):
        raise document.refusal("its meshes are different Gaussians, not layers of one scene")
    count = document.count(geometry[_POSITION])
    semantics = {name: _coefficients(_degree(one)) for name, one in primitives.items()}
    require_room(count, sum(map(len, semantics.values())) - 1, path)  # each can refer to the same numbers
    means, rotations, scales, opacities = (document.floats(geometry[name], kind) for name, kind in _GEOMETRY.items())
    if {len(values) for values in (means, rotations, scales, opacities)} != {count}:
        raise document.refusal("its attributes differ in length")
    quaternions = np.ascontiguousarray(rotations[:, [3, 0, 1, 2]])
    log_scales = logarithm(scales.astype(np.float64)).astype(np.float32)
    logits = _logits(opacities[:, 0])
    result = {}
    for name, one in primitives.items():
        sh = np.empty((count, len(semantics[name]), 3), np.float32)
        for term, semantic in enumerate(semantics[name]):
            values = document.floats(one.get(semantic), "VEC3")
            if len(values) != count:
                raise document.refusal("its attributes differ in length")
            sh[:, term] = values
        result[name] = Gaussians(means, log_scales, quaternions, logits, sh)
    return result


def _degree(attributes: dict[str, Any]) -> int:
    """The highest with a first coefficient; that the others are there is seen when they are read."""
    degrees = range(HIGHEST_SH_DEGREE, 0, -1)
    return next((n for n in degrees if f"{_EXTENSION}:SH_DEGREE_{n}_COEF_0" in attributes), 0)


def _logits(opacities: NDArray[np.float32]) -> NDArray[np.float32]:
    """Infinite for zero and one; NaN outside."""
    with np.errstate(divide="ignore", invalid="ignore"):
        precise = opacities.astype(np.float64)
        return (np.log(precise) - np.log1p(-precise)).astype(np.float32)
