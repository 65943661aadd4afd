"""The fabrics of a showroom: which pairs of colours, in which weaves, and where each hangs, lies or is rolled up."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from . import materials, weaves
from .palette import palette
from .settings import SceneSettings
from .weaves import Weave, sequence, weave

Color = NDArray[np.float64]


@dataclass(frozen=True)
class Arrangement:
    """Fabric names (see `Fabrics`) by place, from left to right as the cameras see it, piles from below.

    Attributes:
        drapes: the two opaque cloths on the rail.
        cushions: (fabric, piping) of the three that lean on the block and the small one before them.
        piles: the two piles of folded cloths on the block.
        rolls: three rolls on the floor, two on them, one on top.
        throw: over the plinth's front.
        cube: over the cube.
    """

    drapes: tuple[str, str] = ("tartan", "stripe")
    cushions: tuple[tuple[str, str], ...] = (
        ("jacquard", "cream"),
        ("green", "orange"),
        ("stripe", "cream"),
        ("tartan", "green"),
    )
    piles: tuple[tuple[str, ...], tuple[str, ...]] = (
        ("pink", "herringbone", "cream", "tartan"),
        ("stripe", "green", "basket"),
    )
    rolls: tuple[str, ...] = ("green", "tartan", "pink", "orange", "blue", "herringbone")
    throw: str = "basket"
    cube: str = "herringbone"


ARRANGEMENTS = {
    "deutan": Arrangement(),
    "protan": Arrangement(
        drapes=("stripe", "jacquard"),
        cushions=(("tartan", "cream"), ("orange", "green"), ("herringbone", "cream"), ("basket", "orange")),
        piles=(("blue", "stripe", "tartan"), ("green", "cream", "jacquard", "pink")),
        rolls=("orange", "stripe", "blue", "pink", "green", "tartan"),
        throw="herringbone",
        cube="tartan",
    ),
    "tritan": Arrangement(
        drapes=("jacquard", "tartan"),
        cushions=(("stripe", "cream"), ("pink", "blue"), ("tartan", "cream"), ("herringbone", "pink")),
        piles=(("green", "tartan", "orange", "cream"), ("jacquard", "blue", "stripe")),
        rolls=("blue", "herringbone", "green", "pink", "stripe", "orange"),
        throw="tartan",
        cube="basket",
    ),
}
"""The arrangement of each of `settings.VARIANTS`."""


class Fabrics:
    """Makes each fabric's material when it is first used.

    Args:
        settings: yarn scale, satin and sheer are taken from here.
        seed: of the yarns' irregularities.
    """

    def __init__(self, settings: SceneSettings, seed: int) -> None:
        self._settings = settings
        self._seed = seed
        self._colors = palette(settings.variant)
        self._made: dict[tuple[str, float], bpy.types.Material] = {}

    def material(self, name: str, turn: float = 0.0) -> bpy.types.Material:
        """The material of a fabric, its weave turned by `turn` radians."""
        key = (name, turn)
        if key not in self._made:
            self._made[key] = self._make(name, turn)
        return self._made[key]

    def _make(self, name: str, turn: float) -> bpy.types.Material:
        if name == "satin":
            return materials.satin(name, self._colors.satin, self._settings.satin_roughness)
        if name == "organza":
            return materials.organza(name, self._colors.sheer, self._settings.sheer_opacity)
        return materials.woven(name, self.weave(name), turn=turn)

    def weave(self, name: str) -> Weave:
        """The woven pattern of a fabric."""
        c, scale, seed = self._colors, self._settings.yarn_scale, self._seed

        def cloth(warp: Color, weft: Color, lift: NDArray[np.bool_], yarn: float, resolution: int = 6) -> Weave:
            return weave(np.atleast_2d(warp), np.atleast_2d(weft), lift, yarn * scale, seed, resolution)

        if name == "tartan":
            red, green = c.tartan.first, c.tartan.second
            sett = sequence((red, 16), (green, 16), (c.cream, 2), (c.dark, 4), (green, 4), mirrored=True)
            return cloth(sett, sett, weaves.twill(), 0.0052)
        if name == "stripe":
            orange, green = c.stripe.first, c.stripe.second
            warp = sequence((orange, 14), (c.cream, 2), (green, 14), (c.cream, 2))
            return cloth(warp, (orange + green) / 2, weaves.twill(3, 1), 0.0045)
        if name == "herringbone":
            return cloth(c.herringbone.first, c.herringbone.second, weaves.herringbone(band=8), 0.011, 10)
        if name == "basket":
            return cloth(c.stripe.first, c.stripe.second, weaves.basket_weave(), 0.014, 24)
        if name == "jacquard":
            motif = weaves.ogee_motif(48, 72)
            return cloth(
                c.jacquard.first,
                c.jacquard.second,
                weaves.figured(motif, weaves.twill(3, 1), weaves.twill(1, 3)),
                0.0042,
                6,
            )
        plain = {
            "pink": c.herringbone.first,
            "blue": c.herringbone.second,
            "orange": c.stripe.first,
            "green": c.tartan.second,
            "cream": c.cream,
        }
        return cloth(plain[name], plain[name], weaves.plain_weave(), 0.006, 12)
