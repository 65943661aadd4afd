"""The set: what stands where, in which fabric, under which light. bpy and numpy.

Metres; the cameras look along +y from the front, z is up, the floor is z = 0.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import bpy
import mathutils
import numpy as np
from numpy.typing import NDArray

from . import cloth, materials, meshes
from .cloth import Surface
from .fabrics import ARRANGEMENTS, Fabrics
from .meshes import ClothPhysics
from .settings import SceneSettings

Progress = Callable[[str], None]

# Boxes are (lowest corner, highest corner); the set is about 3.3 m wide, what a 36 mm lens frames at 3.4 m.
LOW_PLINTH = ((-1.15, -0.35, 0.0), (0.95, 0.52, 0.38))
BACK_BLOCK = ((-1.15, 0.12, 0.38), (0.02, 0.52, 0.78))
CUBE = ((0.42, 0.10, 0.38), (0.78, 0.46, 0.70))
PEDESTAL = (1.42, -0.05, 0.0)
PEDESTAL_RADIUS, PEDESTAL_HEIGHT = 0.19, 0.84
RAIL_Y, RAIL_Z, RAIL_HALF = 1.05, 1.92, 1.66


@dataclass(frozen=True)
class Light:
    """A soft box: a square area light of `size` metres at `position` that shines at `target`, in watts."""

    position: tuple[float, float, float]
    target: tuple[float, float, float]
    size: float
    power: float


LIGHTS = (
    Light((-2.6, -2.4, 3.2), (0.0, 0.2, 0.6), 1.8, 215.0),
    Light((2.8, -2.0, 2.8), (0.0, 0.3, 0.7), 2.0, 65.0),
    Light((0.0, 0.2, 3.6), (0.0, 0.3, 0.0), 2.6, 55.0),
)
# Radiance of the sky above the open room, against white = 1: fills the shadows.
AMBIENT = 0.24


def build(settings: SceneSettings, seed: int, progress: Progress = lambda message: None) -> None:
    """Replace whatever the Blender session holds by the showroom, without cameras."""
    start_scene(settings.light)
    fabrics = Fabrics(settings, seed)
    stage = _Stage(settings, seed, fabrics)
    progress("walls, floor and furniture")
    stage.room()
    plinth, cube, pedestal, floor = stage.furniture()
    progress("hanging cloths")
    stage.hangings()
    progress("folded cloths and rolls")
    stage.stacks()
    stage.rolls()
    progress("cushions")
    stage.cushions()
    progress("throw over the plinth")
    stage.throw([plinth, floor])
    progress("cloth over the cube")
    stage.draped_cube([cube, plinth, floor])
    progress("satin over the pedestal")
    stage.satin([pedestal, floor])
    bpy.data.objects.remove(floor)
    light(settings.light)


def light(level: float) -> None:
    """Soft studio light."""
    for index, box in enumerate(LIGHTS):
        add_light(f"soft box {index}", box.position, box.target, box.size, box.power * level)


def add_light(name: str, position: Sequence[float], target: Sequence[float], size: float, power: float) -> None:
    """A square area light of `size` metres and `power` watts, which is not seen by the camera."""
    lamp = bpy.data.lights.new(name, "AREA")
    lamp.shape, lamp.size, lamp.energy = "SQUARE", size, power
    obj = bpy.data.objects.new(lamp.name, lamp)
    obj.location = position
    direction = mathutils.Vector(target) - mathutils.Vector(position)
    obj.rotation_euler = direction.to_track_quat("-Z", "Y").to_euler()
    obj.visible_camera = False
    bpy.context.scene.collection.objects.link(obj)


def start_scene(level: float) -> None:
    """An empty scene under an even sky."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    world = bpy.data.worlds.new("studio")
    bpy.context.scene.world = world
    if bpy.app.version < (5, 0):
        world.use_nodes = True
    background = world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (1.0, 0.985, 0.96, 1.0)
    background.inputs["Strength"].default_value = AMBIENT * level


def boards(half_length: float, half_width: float, seed: int) -> None:
    """A floor about the origin of oak boards 18 cm wide of four tones, which run along y."""
    rng = np.random.default_rng(seed)
    tones = [np.array([0.46, 0.345, 0.235]) * gain for gain in (0.9, 0.97, 1.03, 1.1)]
    finishes = [materials.wood(f"oak board {i}", tone, (9.0, 0.7, 4.0)) for i, tone in enumerate(tones)]
    width, joint = 0.18, 0.004
    for row, x in enumerate(np.arange(-half_length, half_length, width)):
        start = -half_width - rng.uniform(0, 2.0)
        while start < half_width:
            length = rng.uniform(1.4, 2.4)
            board = meshes.add_box(
                f"board {row}", (x, start, -0.03), (x + width - joint, start + length - joint, 0.0), bevel=0.002
            )
            board.data.materials.append(finishes[rng.integers(len(finishes))])
            start += length
    ground = meshes.add_surface("ground", cloth.flat_cloth(2 * half_length, 2 * half_width, half_width))
    ground.location.z = -0.02
    ground.data.materials.append(materials.plain("joint", np.array([0.12, 0.09, 0.06])))


class _Stage:
    """Puts things on the set; one method a group of things."""

    def __init__(self, settings: SceneSettings, seed: int, fabrics: Fabrics) -> None:
        self._settings = settings
        self._seed = seed
        self._fabrics = fabrics
        self._arrangement = ARRANGEMENTS[settings.variant]

    def _spacing(self, finest: float) -> float:
        return finest / self._settings.cloth_detail

    def _dress(self, obj: bpy.types.Object, fabric: str, turn: float = 0.0) -> bpy.types.Object:
        obj.data.materials.append(self._fabrics.material(fabric, turn))
        return obj

    @staticmethod
    def _thicken(obj: bpy.types.Object, thickness: float, offset: float = 1.0) -> None:
        """Give cloth a thickness in metres, outwards (`offset` 1) or to both sides (0)."""
        solid = obj.modifiers.new("thickness", "SOLIDIFY")
        solid.thickness, solid.offset = thickness, offset

    @staticmethod
    def _smooth(obj: bpy.types.Object, levels: int = 1) -> None:
        subdivision = obj.modifiers.new("smooth", "SUBSURF")
        subdivision.levels = subdivision.render_levels = levels

    def room(self) -> None:
        """A round plaster wall with a coved foot, open above, and a floor of pale oak boards."""
        angle = np.linspace(-np.pi, np.pi, 181)
        radius, height, cove = 4.6, 3.6, 0.5
        bend = np.linspace(0, np.pi / 2, 12)
        profile = np.concatenate(
            [
                np.stack([radius - cove + cove * np.sin(bend), cove - cove * np.cos(bend)], axis=-1),
                np.array([[radius, 1.2], [radius, 2.4], [radius, height]]),
            ]
        )
        positions = np.stack(
            [
                profile[:, :1] * np.sin(angle),
                profile[:, :1] * np.cos(angle),
                np.repeat(profile[:, 1:], len(angle), axis=1),
            ],
            axis=-1,
        )
        along = np.stack(np.meshgrid(angle * radius, profile[:, 1]), axis=-1)
        wall = meshes.add_surface("wall", cloth.grid(positions, along))
        wall.data.materials.append(materials.plaster("lime plaster", np.array([0.74, 0.715, 0.675])))
        boards(radius, radius, self._seed)

    def furniture(self) -> tuple[bpy.types.Object, ...]:
        """Stone plinth, oak block behind the cushions, cube, pedestal; returns what cloth falls on, with a floor."""
        stone = materials.plaster("limestone", np.array([0.62, 0.59, 0.54]), mottling=0.10, scale=9.0)
        oak = materials.wood("oak", np.array([0.36, 0.235, 0.14]), (9.0, 9.0, 0.6))
        plinth = meshes.add_box("plinth", *LOW_PLINTH)
        block = meshes.add_box("block", *BACK_BLOCK)
        cube = meshes.add_box("cube", *CUBE)
        pedestal = meshes.add_cylinder("pedestal", PEDESTAL, PEDESTAL_RADIUS, PEDESTAL_HEIGHT)
        for obj, finish in ((plinth, stone), (block, oak), (cube, oak), (pedestal, stone)):
            obj.data.materials.append(finish)
        floor = meshes.add_box("collision floor", (-3.0, -3.0, -0.3), (3.0, 3.0, 0.0))
        return plinth, cube, pedestal, floor

    def hangings(self) -> None:
        """A rail with two pleated cloths, and organza in front of a part of the second."""
        steel = materials.plain("bronzed steel", np.array([0.055, 0.045, 0.038]), roughness=0.55)
        rail = meshes.add_cylinder(
            "rail", (-RAIL_HALF, RAIL_Y, RAIL_Z), 0.014, 2 * RAIL_HALF, 0.0, rotation=cloth.rotation(y=90)
        )
        posts = [meshes.add_cylinder("post", (x, RAIL_Y, 0.0), 0.014, RAIL_Z, 0.0) for x in (-RAIL_HALF, RAIL_HALF)]
        feet = [meshes.add_cylinder("foot", (x, RAIL_Y, 0.0), 0.13, 0.014, 0.004) for x in (-RAIL_HALF, RAIL_HALF)]
        for obj in (rail, *posts, *feet):
            obj.data.materials.append(steel)
        left, right = self._arrangement.drapes
        drapes = (
            (left, -0.92, 0.0, 1.20, 1.60, 1.5, 6.0),
            (right, 0.36, 0.0, 1.15, 1.70, 1.5, 7.0),
            ("organza", 1.02, -0.14, 1.10, 1.78, 1.6, 9.0),
        )
        for index, (fabric, x, y, width, drop, fullness, pleats) in enumerate(drapes):
            shape = cloth.hanging_drape(width, drop, fullness, pleats, self._seed + index, self._spacing(0.012))
            shape = shape.moved(np.eye(3), np.array([x, RAIL_Y + y, RAIL_Z - 0.03]))
            obj = self._dress(meshes.add_surface(fabric, shape), fabric)
            if fabric != "organza":
                self._thicken(obj, 0.003)

    def stacks(self) -> None:
        """Folded cloths on the oak block."""
        rng = np.random.default_rng(self._seed + 10)
        (left, front, _), (_, back, top) = BACK_BLOCK
        for x, fabrics in zip((left + 0.27, left + 0.80), self._arrangement.piles, strict=True):
            z = top + 0.001
            for fabric in fabrics:
                width, depth = 0.40 + rng.uniform(-0.02, 0.02), 0.30 + rng.uniform(-0.02, 0.02)
                layers, thickness = (4, 0.015) if fabric != "basket" else (4, 0.02)
                shape = cloth.folded_cloth(
                    width, depth, layers, thickness, int(rng.integers(1 << 30)), self._spacing(0.012)
                )
                turn = cloth.rotation(z=rng.uniform(-5, 5))
                middle = np.array([x, (front + back) / 2 + rng.uniform(-0.01, 0.01), z])
                obj = self._dress(meshes.add_surface(f"folded {fabric}", shape.moved(turn, middle)), fabric)
                self._thicken(obj, 0.8 * thickness, offset=0.0)
                z += layers * thickness + 0.001

    def rolls(self) -> None:
        """A pyramid of rolled cloth on the floor, its ends towards the cameras."""
        radius, core = 0.085, 0.022
        places = ((0, 0), (1, 0), (2, 0), (0.5, 1), (1.5, 1), (1, 2))  # column, row
        card = materials.plain("card", np.array([0.36, 0.26, 0.17]))
        for (column, row), fabric in zip(places, self._arrangement.rolls, strict=True):
            shape = cloth.roll(
                0.62 + 0.04 * ((column * 7 + row * 3) % 3 - 1), core, radius, 0.008, self._spacing(0.012)
            )
            x = -1.70 + 2 * radius * column * 1.01
            z = radius + row * radius * np.sqrt(3) * 1.01
            turn = cloth.rotation(z=97 + 3 * ((column * 5 + row) % 3 - 1))
            middle = np.array([x, 0.05, z + 0.002])
            obj = self._dress(meshes.add_surface(f"roll {fabric}", shape.moved(turn, middle)), fabric)
            self._thicken(obj, 0.004)
            start = turn @ np.array([-0.33, 0, 0]) + middle
            tube = meshes.add_cylinder(
                "card tube", start, core - 0.003, 0.66, 0.0, rotation=turn @ cloth.rotation(y=90)
            )
            tube.data.materials.append(card)

    def cushions(self) -> None:
        """Cushions with piping that lean on the block, and a small one before them."""
        top = LOW_PLINTH[1][2]
        front = BACK_BLOCK[0][1]
        places = (
            # side, x, distance of the foot from the block, tilt, turn about z, roll in its plane
            (0.50, -0.90, 0.18, 70, 5, 3),
            (0.46, -0.45, 0.17, 69, -4, -4),
            (0.48, -0.06, 0.19, 67, -7, 3),
            (0.40, -0.60, 0.36, 60, 7, -3),
        )
        for index, (side, x, away, tilt, heading, roll) in enumerate(places):
            fabric, piping = self._arrangement.cushions[index]
            shape, seam = self._cushion(side, index)
            turn = cloth.rotation(z=heading) @ cloth.rotation(x=tilt) @ cloth.rotation(z=roll)
            turned = shape.vertices @ turn.T
            drop = np.array([x, front - away, top - turned[:, 2].min() + 0.002])
            drop[1] += -turned[:, 1][turned[:, 2] < turned[:, 2].min() + 0.02].mean()
            obj = self._dress(meshes.add_surface(f"cushion {fabric}", shape.moved(turn, drop)), fabric)
            self._smooth(obj)
            cord = cloth.tube(shape.vertices[:seam], 0.0055).moved(turn, drop)
            self._dress(meshes.add_surface(f"piping {fabric}", cord), piping)

    def _cushion(self, side: float, index: int) -> tuple[Surface, int]:
        """An inflated cover and its number of seam vertices."""
        spacing = self._spacing(0.02)
        cover = cloth.cushion_cover(side, spacing)
        seam = cloth.seam_length(side, spacing)
        rng = np.random.default_rng(self._seed + 20 + index)
        uneven = cover.vertices + rng.normal(0, 0.0008, cover.vertices.shape)
        physics = ClothPhysics(
            frames=26, mass=0.2, bending=0.6, pressure=4.0, shrink=0.02, gravity=0.0, self_collision=False
        )
        return meshes.simulate(replace(cover, vertices=uneven), physics), seam

    def throw(self, obstacles: Sequence[bpy.types.Object]) -> None:
        """A thick throw that lies on the plinth and falls over its front to the floor."""
        sheet = cloth.flat_cloth(0.66, 1.05, self._spacing(0.022))
        front, top = LOW_PLINTH[0][1], LOW_PLINTH[1][2]
        rng = np.random.default_rng(self._seed + 30)
        # Ripples along its width become folds that run down over the edge.
        waves = replace(sheet, vertices=sheet.vertices + _ripples(sheet, rng, 0.055, across=3.0, along=0.4))
        start = waves.moved(cloth.rotation(z=9), np.array([0.34, front - 0.10, top + 0.03]))
        held = sheet.uv[:, 1] > sheet.uv[:, 1].max() - 0.12
        physics = ClothPhysics(frames=70, mass=0.3, bending=1.0, distance=0.008)
        obj = meshes.add_surface("throw", meshes.simulate(start, physics, obstacles, held))
        self._dress(obj, self._arrangement.throw)
        self._smooth(obj)
        self._thicken(obj, 0.010)

    def draped_cube(self, obstacles: Sequence[bpy.types.Object]) -> None:
        """Cloth over the cube, its corners on the plinth."""
        sheet = cloth.flat_cloth(0.92, 0.92, self._spacing(0.022))
        (left, front, _), (right, back, top) = CUBE
        start = sheet.moved(cloth.rotation(z=24), np.array([(left + right) / 2, (front + back) / 2, top + 0.02]))
        physics = ClothPhysics(frames=60, mass=0.2, bending=0.8, distance=0.007)
        obj = meshes.add_surface("draped cube", meshes.simulate(start, physics, obstacles))
        self._dress(obj, self._arrangement.cube)
        self._smooth(obj)
        self._thicken(obj, 0.004)

    def satin(self, obstacles: Sequence[bpy.types.Object]) -> None:
        """Satin that falls over the pedestal to the floor."""
        sheet = cloth.flat_cloth(1.55, 1.55, self._spacing(0.025))
        x, y, _ = PEDESTAL
        start = sheet.moved(cloth.rotation(z=30), np.array([x, y, PEDESTAL_HEIGHT + 0.03]))
        shape = meshes.simulate(start, ClothPhysics(frames=64, mass=0.12, bending=0.15, distance=0.008), obstacles)
        obj = self._dress(meshes.add_surface("satin", shape), "satin")
        self._smooth(obj, 2)


def _ripples(
    surface: Surface, rng: np.random.Generator, amplitude: float, across: float, along: float
) -> NDArray[np.float64]:
    """(N, 3) upward waves of up to `across` and `along` cycles a metre in u and v, so that a sheet folds unevenly."""
    u, v = surface.uv.T
    height = sum(
        np.sin(2 * np.pi * (rng.uniform(0.5, 1) * across * u + rng.uniform(-1, 1) * along * v) + rng.uniform(0, 6))
        for _ in range(4)
    )
    return np.stack([np.zeros_like(u), np.zeros_like(u), amplitude * (1 + np.asarray(height) / 4)], axis=-1)
