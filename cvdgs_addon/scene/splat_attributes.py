"""What the mesh of Gaussians carries: attributes of its points, and of the layers of colour. No nodes, no numbers."""

from __future__ import annotations

from enum import IntEnum, StrEnum


class Attribute(StrEnum):
    """Attributes of the mesh's points, and of what is drawn. Colour layers are called ``color_<layer>``."""

    SCALE = "scale"  # FLOAT_VECTOR, standard deviations along the local axes
    ROTATION = "rotation"  # QUATERNION, wxyz, local to object
    OPACITY = "opacity"  # FLOAT
    FRAME = "frame"  # INT, 0 for a Gaussian, else which point of the frame (see `Frame`)
    RANK = "rank"  # INT, 0 for the most important Gaussian, then 1, ...: those that a budget leaves come first
    DRAWN_COLOR = "drawn_color"  # FLOAT_COLOR, of what is drawn only: what the material shows
    ON_DISC = "on_disc"  # FLOAT_VECTOR, of discs only: place in units of the radius at which they end


class Frame(IntEnum):
    """Values of `Attribute.FRAME`.

    Apply Transform moves a mesh's points but not its attributes. Four extra points follow it, and the group takes the
    linear map that they went through and applies it to every Gaussian's axes.
    """

    ORIGIN = 1
    X = 2
    Y = 3
    Z = 4


def color_attribute(layer: str) -> str:
    """Name of the colour attribute of `layer`, e.g. ``color_deutan-1.0``."""
    return f"color_{layer}"
