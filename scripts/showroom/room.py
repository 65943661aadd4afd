"""A shop that one walks around in: plain walls, windows, a mirror, and racks of clothes. bpy and numpy.

Metres; the room is 9 x 6 m about the origin, z is up, the floor is z = 0. What is made of cloth stands where the walk
(`cameras.walk`) does not pass.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import bpy
import numpy as np
from numpy.typing import NDArray

from . import cloth, materials, meshes
from .fabrics import Fabrics
from .scene import add_light, boards, start_scene
from .settings import SceneSettings

Corner: TypeAlias = tuple[float, float, float]
Box: TypeAlias = tuple[Corner, Corner]
"""Lowest and highest corner."""

HALF_LENGTH, HALF_WIDTH, HEIGHT = 4.5, 3.0, 2.9
_WALL = 0.2  # thickness
_SILL, _LINTEL = 0.85, 2.35
# (from, to) along the wall at y = HALF_WIDTH, and along that at x = -HALF_LENGTH
_NORTH_WINDOWS, _WEST_WINDOWS = ((-3.1, -1.3), (1.1, 2.9)), ((-0.9, 0.9),)
_MIRROR = ((-0.3, 0.25), (1.1, 2.15))  # on the wall at y = -HALF_WIDTH: (x, z) of two corners
_SKY = 3.0  # radiance of what is seen through the windows, against white = 1: overexposed, as it is in photographs
_SHELVES = (0.12, 0.56, 1.0, 1.44, 1.92)  # heights of the boards
_GARMENTS = ("tartan", "green", "orange", "jacquard", "pink", "stripe", "blue", "herringbone")


def build(settings: SceneSettings, seed: int, progress: Callable[[str], None] = lambda message: None) -> None:
    """Replace whatever the Blender session holds by the room, without cameras."""
    start_scene(settings.light)
    room = _Room(settings, seed)
    progress("walls, windows and floor")
    room.shell()
    progress("furniture")
    room.furniture()
    progress("racks")
    room.racks()
    progress("shelves and table")
    room.goods()
    room.light()


class _Room:
    """Puts things into the room; one method a group of things."""

    def __init__(self, settings: SceneSettings, seed: int) -> None:
        self._settings, self._seed = settings, seed
        self._fabrics = Fabrics(settings, seed)
        self._oak = materials.wood("shop oak", np.array([0.36, 0.235, 0.14]), (9.0, 9.0, 0.6))
        self._steel = materials.plain("shop steel", np.array([0.055, 0.045, 0.038]), roughness=0.55)

    def shell(self) -> None:
        """Plain walls and a ceiling, windows with a bright sky behind them, a mirror, and oak boards."""
        plaster = materials.plaster("white wall", np.array([0.76, 0.75, 0.72]), mottling=0.015)
        x, y = HALF_LENGTH, HALF_WIDTH
        boxes: list[Box] = [
            ((-x - _WALL, -y - _WALL, HEIGHT), (x + _WALL, y + _WALL, HEIGHT + _WALL)),
            ((-x - _WALL, -y - _WALL, 0.0), (x + _WALL, -y, HEIGHT)),
            ((x, -y, 0.0), (x + _WALL, y, HEIGHT)),
        ]
        boxes += [((a, y, b), (c, y + _WALL, d)) for a, c, b, d in _around(_NORTH_WINDOWS, -x - _WALL, x + _WALL)]
        boxes += [((-x - _WALL, a, b), (-x, c, d)) for a, c, b, d in _around(_WEST_WINDOWS, -y, y)]
        for low, high in boxes:
            meshes.add_box("wall", low, high, bevel=0.003).data.materials.append(plaster)
        sky = materials.glowing("sky", np.array([0.86, 0.93, 1.0]), _SKY * self._settings.light)
        behind = (
            ((-x, y + 0.6, 0.0), (x, y + 0.62, HEIGHT)),
            ((-x - 0.62, -y, 0.0), (-x - 0.6, y, HEIGHT)),
        )
        for low, high in behind:
            meshes.add_box("sky", low, high, bevel=0.0).data.materials.append(sky)
        for left, right in _NORTH_WINDOWS:
            middle = (left + right) / 2
            bars = (((middle - 0.03, y + 0.08, _SILL), (middle + 0.03, y + 0.14, _LINTEL)),)
            self._boxes("window bar", bars, self._steel)
        boards(HALF_LENGTH, HALF_WIDTH, self._seed)
        (left, bottom), (right, top) = _MIRROR
        frame = ((left - 0.05, -y, bottom - 0.05), (right + 0.05, -y + 0.03, top + 0.05))
        self._boxes("mirror frame", (frame,), self._oak)
        glass = ((left, -y + 0.02, bottom), (right, -y + 0.034, top))
        self._boxes("mirror", (glass,), materials.mirror("silvered glass"), bevel=0.0)

    def furniture(self) -> None:
        """A table in the middle on a rug, shelves along a wall, a bench under the windows."""
        legs = [((x, y, 0.0), (x + 0.06, y + 0.06, 0.76)) for x in (-0.7, 0.64) for y in (-0.35, 0.29)]
        self._boxes("table", [((-0.75, -0.4, 0.76), (0.75, 0.4, 0.8)), *legs], self._oak)
        rug = meshes.add_box("rug", (-1.35, -0.75, 0.0), (1.35, 0.75, 0.012), bevel=0.004)
        rug.data.materials.append(self._fabrics.material("jacquard"))
        x = HALF_LENGTH
        shelves = [((x - 0.42, -2.2, z), (x - 0.01, 1.6, z + 0.03)) for z in _SHELVES]
        sides = [((x - 0.42, y, 0.0), (x - 0.01, y + 0.03, 1.95)) for y in (-2.2, -0.93, 0.34, 1.57)]
        self._boxes("shelves", [*shelves, *sides], self._oak)
        seat = meshes.add_box("bench", (-2.9, 2.42, 0.14), (-0.6, 2.92, 0.46), bevel=0.04)
        seat.data.materials.append(self._fabrics.material("green"))
        foot = ((-2.8, 2.5, 0.0), (-0.7, 2.88, 0.14))
        self._boxes("bench foot", (foot,), self._oak)
        stone = materials.plaster("limestone", np.array([0.62, 0.59, 0.54]), mottling=0.10, scale=9.0)
        self._boxes("plinth", [((2.4, -2.75, 0.0), (3.5, -2.2, 0.5)), ((3.2, 2.2, 0.0), (4.1, 2.8, 0.55))], stone)

    def racks(self) -> None:
        """Two rails of clothes whose colours some observers confuse, and a curtain beside the mirror."""
        self._rack(np.array([-3.95, -1.15]), 2.5, along_x=False, first=0)
        self._rack(np.array([-2.2, -2.5]), 2.3, along_x=True, first=3)
        shape = cloth.hanging_drape(1.1, 2.3, 1.6, 7.0, self._seed + 70, self._spacing(0.014))
        self._hang("stripe", shape.moved(np.eye(3), np.array([1.65, -HALF_WIDTH + 0.12, 2.45])))

    def goods(self) -> None:
        """Folded cloths in the shelves and on the table, rolls on the plinths and the bench."""
        rng = np.random.default_rng(self._seed + 50)
        number = 0
        for z in _SHELVES[:-1]:
            for y in np.arange(-1.95, 1.5, 0.43):
                piled = [_GARMENTS[(number * 3 + k) % len(_GARMENTS)] for k in range(1 + number % 3)]
                self._pile(piled, (HALF_LENGTH - 0.22, y, z + 0.03), 90.0, rng)
                number += 1
        for x in (-0.45, 0.05, 0.5):
            piled = [_GARMENTS[(number * 5 + k) % len(_GARMENTS)] for k in range(2)]
            self._pile(piled, (x, 0.0, 0.8), 0.0, rng)
            number += 1
        for index, (x, y, z) in enumerate(
            ((2.7, -2.48, 0.5), (3.2, -2.48, 0.5), (3.65, 2.5, 0.55), (-2.4, 2.67, 0.46))
        ):
            fabric = _GARMENTS[(index * 3 + 1) % len(_GARMENTS)]
            shape = cloth.roll(0.55, 0.022, 0.1, 0.008, self._spacing(0.014))
            shape = shape.moved(cloth.rotation(z=80 + 9 * index), np.array([x, y, z + 0.1]))
            self._hang(fabric, shape)

    def light(self) -> None:
        """Daylight from the windows, and soft light from the ceiling; no lamp is seen."""
        level = self._settings.light
        for left, right in _NORTH_WINDOWS:
            x = (left + right) / 2
            add_light("daylight", (x, HALF_WIDTH + 0.1, 1.6), (x, 0.0, 0.7), 1.6, 48.0 * level)
        add_light("daylight", (-HALF_LENGTH - 0.1, 0.0, 1.6), (0.0, 0.0, 0.7), 1.6, 40.0 * level)
        for x in (-2.5, 0.0, 2.5):
            add_light("ceiling light", (x, -0.4, HEIGHT - 0.05), (x, -0.4, 0.0), 1.8, 27.0 * level)

    def _spacing(self, finest: float) -> float:
        return finest / self._settings.cloth_detail

    def _boxes(self, name: str, boxes: Sequence[Box], finish: bpy.types.Material, bevel: float = 0.004) -> None:
        for low, high in boxes:
            meshes.add_box(name, low, high, bevel=bevel).data.materials.append(finish)

    def _hang(self, fabric: str, shape: cloth.Surface) -> None:
        obj = meshes.add_surface(fabric, shape)
        obj.data.materials.append(self._fabrics.material(fabric))
        solid = obj.modifiers.new("thickness", "SOLIDIFY")
        solid.thickness, solid.offset = 0.004, 1.0

    def _rack(self, middle: NDArray[np.float64], length: float, *, along_x: bool, first: int) -> None:
        """A rail 1.6 m high with a garment every 18 cm, seen from its side and its ends."""
        along = np.array([1.0, 0.0]) if along_x else np.array([0.0, 1.0])
        turn = cloth.rotation(z=90.0 if along_x else 0.0)
        ends = [middle - along * length / 2, middle + along * length / 2]
        rail = cloth.rotation(y=90) if along_x else cloth.rotation(x=-90)
        poles = [meshes.add_cylinder("rail", (*ends[0], 1.6), 0.014, length, 0.0, rotation=rail)]
        poles += [meshes.add_cylinder("post", (*end, 0.0), 0.014, 1.6, 0.0) for end in ends]
        for pole in poles:
            pole.data.materials.append(self._steel)
        rng = np.random.default_rng(self._seed + 60 + first)
        for number, offset in enumerate(np.arange(0.15 - length / 2, length / 2 - 0.1, 0.18)):
            x, y = middle + along * offset
            width, drop = rng.uniform(0.42, 0.54), rng.uniform(0.8, 1.2)
            shape = cloth.hanging_drape(width, drop, 1.25, 2.0, self._seed + number, self._spacing(0.016))
            lean = turn @ cloth.rotation(z=rng.uniform(-12, 12))
            self._hang(_GARMENTS[(first + number) % len(_GARMENTS)], shape.moved(lean, np.array([x, y, 1.56])))

    def _pile(
        self, fabrics: Sequence[str], place: tuple[float, float, float], heading: float, rng: np.random.Generator
    ) -> None:
        x, y, z = place
        for fabric in fabrics:
            shape = cloth.folded_cloth(0.34, 0.28, 4, 0.02, int(rng.integers(1 << 30)), self._spacing(0.014))
            turn = cloth.rotation(z=heading + rng.uniform(-4, 4))
            self._hang(fabric, shape.moved(turn, np.array([x, y, z + 0.003])))
            z += 0.084


def _around(
    windows: Sequence[tuple[float, float]], start: float, end: float
) -> list[tuple[float, float, float, float]]:
    """(from, to, bottom, top) of the pieces of a wall from `start` to `end` that `windows` leave."""
    edges = [start, *(edge for window in windows for edge in window), end]
    pieces = [(edges[i], edges[i + 1], 0.0, HEIGHT) for i in range(0, len(edges), 2)]
    for left, right in windows:
        pieces += [(left, right, 0.0, _SILL), (left, right, _LINTEL, HEIGHT)]
    return pieces
