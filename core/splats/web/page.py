"""Writes layers of Gaussians as one HTML page that draws them, and needs no server and no network. numpy only."""

from __future__ import annotations

import base64
import html
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...capture.folder import CaptureView, mean_up
from ...color.machado2009 import MATRICES, SEVERITY_STEP
from ...color.matrices import linear_simulation
from ...errors import InputError
from ...files.untrusted import writing_whole
from ...runs.layout import ORIGINAL
from ...settings import CVD_TYPES, Layer
from ..gaussians import Gaussians, core_bounds
from ..io.layers import direction_of, first_of
from ..scene_frame import near_depth
from .streams import pack

SUFFIX = ".html"
_PARTS = Path(__file__).parent
_MARK = re.compile(r"\{\{ (\w+) \}\}")
_ENOUGH_TO_SORT = 1 << 24  # more Gaussians than any graphics card's texture of 4096 texels a row holds
_SEVERITIES = len(next(iter(MATRICES.values())))
_UPRIGHT_TOLERANCE = np.radians(25.0)  # +Z within this angle of the cameras' mean is up
_USUAL_UP = "-y"  # of scenes from structure from motion
_MOST_CAMERAS = 500  # in a page: those of more photographs are thinned out
_ORIGINAL_TITLE = "Original"  # as viewer.js knows it
_FIELD_OF_VIEW = 0.9  # radians, where no camera is known


@dataclass(frozen=True)
class Still:
    """A picture for browsers that cannot draw the scene.

    Attributes:
        path: of a PNG file.
        caption: what it shows.
    """

    path: Path
    caption: str


@dataclass(frozen=True)
class Surroundings:
    """What a page says and shows beside the Gaussians.

    Attributes:
        title: of the page.
        lead: how the Gaussians were made; may be "".
        captions: by layer, a sentence on what it gained.
        names: by layer, whom it is for; otherwise it is called as it is.
        credit: whose the scene is and how it was made; "" leaves that out.
        views: the capture's cameras; none: the scene is looked at from one side.
        start: the view in which the page begins.
        up: (3,) unit vector that points up in the scene; None where only the cameras tell.
        background: behind the Gaussians, display-referred sRGB.
        model: of the simulations, one of `settings.SIMULATIONS`.
        stills: what is shown where the scene cannot be.
    """

    title: str = "A scene"
    lead: str = ""
    captions: Mapping[str, str] = field(default_factory=dict)
    names: Mapping[str, str] = field(default_factory=dict)
    credit: str = ""
    views: Sequence[CaptureView] = ()
    start: str = ""
    up: NDArray[np.float64] | None = None
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)
    model: str = "machado"
    stills: Sequence[Still] = ()


def write_web_page(
    path: str | Path, layers: Mapping[str, Gaussians], up: str = "", surroundings: Surroundings = Surroundings()
) -> None:
    """Write `layers`, whose geometry is the first one's, to `path`, completely or not at all.

    Args:
        up: the axis of the scene that points up, one of `io.layers.TO_Y_UP`; without it, what the cameras say.

    Raises:
        InputError: no Gaussians, more than a browser can draw, or the file cannot be written.
    """
    path = Path(path)
    first = first_of(layers, path)
    if len(first) > _ENOUGH_TO_SORT:
        raise InputError(
            f"{len(first):,} Gaussians are more than a browser can draw",
            where=path,
            remedy="remove some first: crop, Remove Floaters, or scripts/convert.py --gaussians 1000000",
        )
    if ORIGINAL in layers:  # the slider begins with it
        layers = {ORIGINAL: layers[ORIGINAL], **layers}
    center, radius = core_bounds(first.means)
    streams = pack(layers, center)
    scene = {
        **streams.description,
        "captions": [surroundings.captions.get(name, "") for name in layers],
        "names": [surroundings.names.get(name, name) for name in layers],
        "first": _first_title(next(iter(layers)), surroundings.names),
        "radius": radius,
        "background": surroundings.background,
        "simulation": _simulations(surroundings.model),
        **_cameras(surroundings, up, first.means, center, radius),
    }
    texts = {
        "title": html.escape(surroundings.title),
        "lead": html.escape(f"{len(first):,} Gaussians" + f", {surroundings.lead}" * bool(surroundings.lead)),
        "credit": html.escape(surroundings.credit),
        "stills": "".join(map(_figure, surroundings.stills)),
        "style": _part("viewer.css"),
        "sorter": _part("sorter.js"),
        "renderer": _part("renderer.js"),
        "navigation": _part("navigation.js"),
        "viewer": _part("viewer.js"),
        "scene": json.dumps(scene, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"),
    }
    before, after = _part("viewer.html").split("{{ data }}")
    with writing_whole(path) as file:
        file.write(_filled(before, texts))
        for name, data in streams.data.items():
            file.write(f'<script type="text/plain" id="data-{name}">{data}</script>\n'.encode())
        file.write(_filled(after, texts))


def _first_title(name: str, names: Mapping[str, str]) -> str:
    """What the colours of the first layer are called: enhanced ones only where it has the name of a run's layer."""
    if name == ORIGINAL:
        return _ORIGINAL_TITLE
    try:
        is_enhanced = name in names or Layer.from_name(name).cvd in CVD_TYPES
    except ValueError:
        is_enhanced = False
    return f"Enhanced for {names.get(name, name)}" if is_enhanced else name


def up_of(views: Sequence[CaptureView]) -> NDArray[np.float64]:
    """(3,) which direction is up: the mean of the cameras' up directions, unless +Z is near it already."""
    mean = mean_up(views)
    return mean if mean[2] < np.cos(_UPRIGHT_TOLERANCE) else np.array([0.0, 0.0, 1.0])


def _cameras(
    around: Surroundings, up: str, means: NDArray[np.float32], center: NDArray[np.float64], radius: float
) -> dict[str, Any]:
    """The page's cameras, their positions from `center`, and what they say of the scene."""
    if not around.views:
        return {
            "up": list(direction_of(up or _USUAL_UP)),
            "cameras": [],
            "start": 0,
            "near": 1e-3 * radius,
            "fieldOfView": _FIELD_OF_VIEW,
        }
    every = -(-len(around.views) // _MOST_CAMERAS)
    shown = [view for n, view in enumerate(around.views) if n % every == 0 or view.key == around.start]
    names = [view.key for view in shown]
    return {
        "up": list(direction_of(up) if up else up_of(around.views) if around.up is None else around.up),
        "cameras": [_camera(view, center) for view in shown],
        "start": names.index(around.start) if around.start in names else 0,
        "near": near_depth(around.views, means),
        "fieldOfView": _FIELD_OF_VIEW,
    }


def _camera(view: CaptureView, center: NDArray[np.float64]) -> dict[str, Any]:
    """World to camera in OpenCV axes, and intrinsics."""
    pose, camera = view.world_to_camera, view.camera
    return {
        "name": view.key,
        "rotation": pose[:3, :3].ravel().tolist(),
        "translation": (pose[:3, :3] @ center + pose[:3, 3]).tolist(),
        **{name: getattr(camera, name) for name in ("width", "height", "fx", "fy", "cx", "cy")},
    }


def _simulations(model: str) -> dict[str, Any]:
    """By type, the matrices of severities 0, 0.1 ... 1, between which the page interpolates as `core.color` does."""
    result = {}
    for cvd in CVD_TYPES:
        able = "brettel" if (model, cvd) == ("vienot", "tritan") else model
        steps = [linear_simulation(cvd, min(SEVERITY_STEP * step, 1.0), able) for step in range(_SEVERITIES)]
        below = [step.matrix if step.matrix_below is None else step.matrix_below for step in steps]
        normal = steps[-1].separator
        result[cvd] = {
            "above": [step.matrix.ravel().tolist() for step in steps],
            "below": [matrix.ravel().tolist() for matrix in below],
            "separator": [0.0, 0.0, 0.0] if normal is None else normal.tolist(),
        }
    return result


def _figure(still: Still) -> str:
    caption = html.escape(still.caption)
    picture = base64.b64encode(still.path.read_bytes()).decode("ascii")
    image = f'<img alt="{caption}" src="data:image/png;base64,{picture}">'
    return f"<figure>{image}<figcaption>{caption}</figcaption></figure>\n"


def _part(name: str) -> str:
    return (_PARTS / name).read_text(encoding="utf-8")


def _filled(skeleton: str, texts: Mapping[str, str]) -> bytes:
    """`skeleton` with `texts` in the place of its marks, in one pass: what is put in is not looked at again."""
    return _MARK.sub(lambda mark: texts[mark[1]], skeleton).encode("utf-8", "backslashreplace")
