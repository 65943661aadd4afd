"""Small pictures that the panels show: thumbnails, previews of a run, coloured caps. Freed with the add-on."""

from __future__ import annotations

from pathlib import Path

import bpy
import bpy.utils.previews
import numpy as np
from numpy.typing import ArrayLike

_CAP_SIZE = 32  # pixels of a cap's icon, the size of Blender's own


class Pictures:
    """Pictures by key, between `register` and `unregister`."""

    def __init__(self) -> None:
        self._previews: bpy.utils.previews.ImagePreviewCollection | None = None

    def __contains__(self, key: str) -> bool:
        return self._previews is not None and key in self._previews

    def load(self, key: str, path: Path, *, square: bool = False) -> None:
        """Load a file under `key`, in place of what was there; a missing file leaves nothing.

        Args:
            key: by which it is known.
            path: of a picture.
            square: take the middle alone, so that pictures of any format fill the squares that panels have for them.
        """
        if self._previews is None:
            return
        self.forget(key)
        if path.is_file():
            picture = self._previews.load(key, str(path), "IMAGE")
            picture.image_size[0]  # read now: the file may be gone when the panel is drawn
            if square:
                _crop(picture)

    def paint(self, key: str, color: ArrayLike) -> None:
        """A cap of one sRGB colour, (3,) in [0, 1], under `key`."""
        if self._previews is None or key in self:
            return
        pixels = np.ones((_CAP_SIZE, _CAP_SIZE, 4), np.float32)
        pixels[..., :3] = color
        picture = self._previews.new(key)
        for size, values in (("icon_size", "icon_pixels_float"), ("image_size", "image_pixels_float")):
            setattr(picture, size, (_CAP_SIZE, _CAP_SIZE))
            getattr(picture, values).foreach_set(pixels.ravel())

    def icon(self, key: str) -> int:
        """For ``icon_value`` and ``template_icon``; 0, an empty icon, where there is no such picture."""
        return self._previews[key].icon_id if self._previews is not None and key in self else 0

    def forget(self, key: str) -> None:
        """Free the picture of `key`, if there is one."""
        if self._previews is not None and key in self:
            del self._previews[key]

    def register(self) -> None:
        """Be ready."""
        self._previews = bpy.utils.previews.new()

    def unregister(self) -> None:
        """Free all pictures."""
        if self._previews is not None:
            bpy.utils.previews.remove(self._previews)
            self._previews = None


def _crop(picture: bpy.types.ImagePreview) -> None:
    """Leave the square in the middle."""
    width, height = picture.image_size
    side = min(width, height)
    pixels = np.empty(width * height * 4, np.float32)
    picture.image_pixels_float.foreach_get(pixels)
    left, low = (width - side) // 2, (height - side) // 2
    middle = pixels.reshape(height, width, 4)[low : low + side, left : left + side]
    picture.image_size = (side, side)
    picture.image_pixels_float.foreach_set(np.ascontiguousarray(middle).ravel())


PICTURES = Pictures()
