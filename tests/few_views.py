"""A capture that trains in seconds: a few of the demo's views, as large as they are or as thumbnails."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

from PIL import Image

_DEMO = Path(__file__).resolve().parents[1] / "core" / "demo" / "showroom"
_OF_LENGTH = ("fl_x", "fl_y", "cx", "cy", "w", "h")


def write_few_views(folder: Path, views: int, scale: float = 1.0) -> Path:
    """Write `views` of the demo, evenly spread, into `folder`, which it makes; returns the folder."""
    (folder / "images").mkdir(parents=True, exist_ok=True)
    document = json.loads((_DEMO / "transforms.json").read_text(encoding="utf-8"))
    document["frames"] = document["frames"][:: len(document["frames"]) // views][:views]
    for frame in document["frames"]:
        photograph = frame["file_path"]
        if scale == 1.0:
            shutil.copy(_DEMO / photograph, folder / photograph)
        else:
            image = Image.open(_DEMO / photograph)
            size = (round(image.width * scale), round(image.height * scale))
            image.resize(size, Image.Resampling.LANCZOS).save(folder / photograph, quality=92)
    if scale != 1.0:
        for camera in (document, *document["frames"]):
            camera.update({name: type(camera[name])(camera[name] * scale) for name in _OF_LENGTH if name in camera})
    shutil.copy(_DEMO / "points.ply", folder)
    (folder / "transforms.json").write_text(json.dumps(document), encoding="utf-8")
    return folder
