"""The files that a finished run leaves in its folder, as documented for the command line. Standard library only."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ..settings import Layer

ORIGINAL = "original"  # the layer of the photographs' own colours

CAPTURE_FOLDER = "capture"  # the photographs and cameras that the run used
ENHANCED_FOLDER = "enhanced"
AGAIN_FOLDER = "again"  # in a layer's folder of enhanced photographs: the second photographs
RENDERS_FOLDER = "renders"
STILLS_FOLDER = "stills"
TURNTABLE_FOLDER = "turntable"
GAUSSIANS_FILE = "splats.ply"
BLEND_FILE = "scene.blend"
# Pictures of a layer's folder, in folders of their own: the scene and the photograph as the observer sees them.
SIMULATED_FOLDER, SIMULATED_INPUT_FOLDER = "simulated", "simulated_input"
REPORT_FILE = "report.json"
REPORT_PAGE = "report.html"
VIEWER_PAGE = "viewer.html"
LOG_FILE = "run.log"

# Of a capture in the normalised form, which the capture folder has (core/capture/normalised.py).
CAMERAS_FILE = "transforms.json"
POINTS_FILE = "points.ply"
IMAGES_FOLDER = "images"
MASKS_FOLDER = "masks"
PLACED_FILE = "placed.png"  # which photographs have estimated cameras, where some have not
MOVING_FILE = "moving.png"  # what of photographs was left out of training because it moves, where something was

# What a run that was broken off leaves, in a folder of its own: about the run, and from then on either is enough to go
# on from: the photographs with the cameras that were estimated for them, and the trainer's state.
CHECKPOINT_FOLDER = ".checkpoint"
CHECKPOINT_RUN_FILE = "run.json"
CHECKPOINT_CAPTURE_FILE, CHECKPOINT_STATE_FILE = "capture.safetensors", "state.safetensors"

_LAYER_PREFIX, _LAYER_SUFFIX = "splats.", ".ply"

# Everything that a run may have written, beside the files of layers (`files_by_layer`).
NAMES = (
    CAPTURE_FOLDER,
    ENHANCED_FOLDER,
    RENDERS_FOLDER,
    STILLS_FOLDER,
    TURNTABLE_FOLDER,
    BLEND_FILE,
    GAUSSIANS_FILE,
    REPORT_FILE,
    REPORT_PAGE,
    VIEWER_PAGE,
    LOG_FILE,
)


def layer_gaussians_file(layer: str) -> str:
    """File of the Gaussians in the colours of `layer`."""
    return f"{_LAYER_PREFIX}{layer}{_LAYER_SUFFIX}"


def layer_of(name: str) -> str:
    """The layer whose `layer_gaussians_file` is called `name`."""
    return name.removeprefix(_LAYER_PREFIX).removesuffix(_LAYER_SUFFIX)


def layer_cube_file(layer: str) -> str:
    """File of the LUT that makes the colours of `layer`."""
    return f"layer.{layer}.cube"


def layer_network_file(layer: str) -> str:
    """File of the scene network that makes the colours of `layer`."""
    return f"layer.{layer}.safetensors"


LAYER_FILES = (layer_gaussians_file, layer_cube_file, layer_network_file)


def files_by_layer(folder: Path, name_of: Callable[[str], str]) -> dict[str, Path]:
    """The files that runs call by `name_of`, one of `LAYER_FILES`, in `folder`, by layer.

    What users call alike, e.g. ``splats.subject.ply``, is no layer's and theirs.
    """
    prefix, suffix = name_of("*").split("*")
    found = {path.name.removeprefix(prefix).removesuffix(suffix): path for path in folder.glob(name_of("*"))}
    return {layer: found[layer] for layer in sorted(found) if Layer.is_name(layer)}


def layer_still_file(layer: str) -> str:
    """File of the still that Blender renders of `layer`."""
    return f"{STILLS_FOLDER}/{layer}.png"


DIGITS = 4  # of a picture's number in its file name


def picture_name(number: int) -> str:
    """File name of a sequence's picture; the first one has the number 1."""
    return f"{number:0{DIGITS}d}.png"


def spread_over_turn(frames: int, count: int) -> list[int]:
    """Numbers of `count` pictures of a turn of `frames`, as far apart as can be; fewer where the turn has fewer."""
    count = min(count, frames)
    return [1 + place * frames // count for place in range(count)]


def pictures(folder: str, first: int, last: int) -> str:
    """The pictures of a sequence from `first` to `last`, as a task's inputs and outputs name them."""
    return f"{folder}/{{{first:0{DIGITS}d}..{last:0{DIGITS}d}}}.png"
