"""A capture that trains in seconds: a few of the demo's views, as thumbnails."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

from PIL import Image

DEMO = Path(__file__).resolve().parents[2] / "core" / "demo" / "showroom"
_EVERY, _SCALE = 2, 0.25


def make_small_capture(folder: Path) -> None:
    """Write it into `folder`, in place of what is there."""
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "images").mkdir(parents=True)
    document = json.loads((DEMO / "transforms.json").read_text(encoding="utf-8"))
    document["frames"] = document["frames"][::_EVERY]
    for camera in (document, *document["frames"]):
        for name in ("fl_x", "fl_y", "cx", "cy", "w", "h"):
            if name in camera:
                camera[name] = type(camera[name])(camera[name] * _SCALE)
    for frame in document["frames"]:
        image = Image.open(DEMO / frame["file_path"])
        size = (round(image.width * _SCALE), round(image.height * _SCALE))
        image.resize(size, Image.Resampling.LANCZOS).save(folder / frame["file_path"], quality=92)
    shutil.copy(DEMO / "points.ply", folder)
    (folder / "transforms.json").write_text(json.dumps(document), encoding="utf-8")
