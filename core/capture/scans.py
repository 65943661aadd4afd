"""What scanners, cameras and datasets put beside photographs: depth maps, previews, textures of a mesh."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence
from contextlib import suppress
from pathlib import Path, PurePosixPath

from ..errors import InputError
from ..files.untrusted import read_bytes
from .files import list_images
from .images import has_one_float_channel

# Words in the names of folders (lowres_depth), and the last ones in those of files (depth_00001.png, IMG_1_depth.TIF).
_DEPTHS = frozenset(("depth", "depths", "depthmap", "depthmaps", "confidence"))
_IN_FOLDERS = frozenset((*_DEPTHS, "normals"))
_IN_FILES = frozenset((*_DEPTHS, "conf"))
_OF_FLOATS = (".exr", ".tif", ".tiff")
_LOSSLESS = (".png", *_OF_FLOATS)  # distances are kept so

# Polycam's raw export has these beside the folder of its photographs, both rendered of its mesh.
_KEYFRAMES = "keyframes"
_RENDERED = frozenset(("polycam.mp4", "thumbnail.jpg"))
# 3D Scanner App's thumb_00000.jpg is a small frame_00000.jpg.
_SMALL, _WHOLE = "thumb_", "frame_"
# On the cards of Sony's cameras, pictures and small copies of the clips in M4ROOT/CLIP.
_OF_CLIPS = re.compile(r"(^|/)M4ROOT/(THMBNL|SUB)/", re.IGNORECASE)

# Wavefront's materials of a mesh (OBJ) and the lines in them that name pictures, which options may precede.
_MATERIALS = (".mtl",)
_MOST_MATERIAL_BYTES = 1 << 20
_TEXTURE = re.compile(r"^\s*(?:map_\w+|bump|disp|norm|refl)\s+(.*\S)", re.MULTILINE | re.IGNORECASE)


def depth_maps_among(folder: Path, names: Iterable[str]) -> set[str]:
    """Which of the pictures `names` in `folder` hold depths, how certain these are, or normals."""
    return {name for name in names if _is_called_depth(name) or _is_made_of_depths(folder / name)}


def _is_called_depth(name: str) -> bool:
    path = PurePosixPath(name.lower())
    last = _words(path.stem)[-1:] if path.suffix in _LOSSLESS else []
    in_folders = (word for part in path.parent.parts for word in _words(part))
    return not (_IN_FILES.isdisjoint(last) and _IN_FOLDERS.isdisjoint(in_folders))


def _words(name: str) -> list[str]:
    return re.findall(r"[a-z]+", name)


def _is_made_of_depths(path: Path) -> bool:
    return path.suffix.lower() in _OF_FLOATS and has_one_float_channel(path)


def previews_among(names: Sequence[str]) -> set[str]:
    """Which of the pictures and videos `names` show the scan as an app has rendered it, or another one once more."""
    paths = {name: PurePosixPath(name) for name in names}
    scanned = {above.parent for path in paths.values() for above in path.parents if above.name == _KEYFRAMES}
    return {
        name
        for name, path in paths.items()
        if _OF_CLIPS.search(name)
        or (path.parent in scanned and path.name in _RENDERED)
        or (path.name.startswith(_SMALL) and str(path.with_name(path.name.replace(_SMALL, _WHOLE, 1))) in paths)
    }


def textures_among(folder: Path, names: Collection[str]) -> set[str]:
    """Which of the pictures `names` in `folder` are textures of a mesh that lies there, by its materials."""
    named: set[str] = set()
    for material in list_images(folder, _MATERIALS):
        with suppress(InputError):  # one that cannot be read names none
            text = read_bytes(folder / material, most_bytes=_MOST_MATERIAL_BYTES).decode("utf-8", "replace")
            for texture in _TEXTURE.findall(text.replace("\\", "/")):
                possible = (texture, texture.split()[-1])  # a name may have spaces, too
                named.update((PurePosixPath(material).parent / name).as_posix() for name in possible)
    return named.intersection(names)
