"""Shapes of cloth: pleated drapes, folded stacks, rolls, cushions. Metres; u and v run along the cloth. numpy only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Surface:
    """A mesh with cloth coordinates.

    Attributes:
        vertices: (N, 3) positions in metres.
        faces: (F, 4) vertex indices, counter-clockwise from the front.
        uv: (N, 2) position on the flat cloth in metres.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    uv: NDArray[np.float64]

    def moved(self, rotation: NDArray[np.float64], translation: NDArray[np.float64]) -> Surface:
        """The surface after x -> R x + t."""
        return Surface(self.vertices @ rotation.T + translation, self.faces, self.uv)


def grid(positions: NDArray[np.float64], uv: NDArray[np.float64]) -> Surface:
    """The surface through (rows, columns, 3) positions with (rows, columns, 2) cloth coordinates."""
    rows, columns = positions.shape[:2]
    index = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    faces = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], axis=-1).reshape(-1, 4)
    return Surface(positions.reshape(-1, 3), faces, uv.reshape(-1, 2))


def flat_cloth(width: float, depth: float, spacing: float) -> Surface:
    """A flat rectangle in the xy plane about the origin, with vertices about `spacing` apart."""
    columns, rows = (max(2, round(length / spacing) + 1) for length in (width, depth))
    u, v = np.meshgrid(np.linspace(0, width, columns), np.linspace(0, depth, rows))
    return grid(np.stack([u - width / 2, v - depth / 2, np.zeros_like(u)], axis=-1), np.stack([u, v], axis=-1))


def hanging_drape(width: float, drop: float, fullness: float, pleats: float, seed: int, spacing: float) -> Surface:
    """Cloth that hangs in pleats from z = 0 down to z = -`drop`, centred on x = 0, with the cloth's length kept.

    The pleats are regular where they are gathered at the top and wander, merge and open out towards the hem, as gravity
    makes them: several frequencies whose weights change with the height.

    Args:
        width: of the hanging cloth in metres.
        fullness: length of the cloth over `width`, 1 is flat.
        pleats: number of main pleats.
        seed: of the irregularities.
        spacing: between vertices, along the flat cloth.
    """
    rng = np.random.default_rng(seed)
    columns, rows = max(16, round(width * fullness / spacing)), max(8, round(drop / spacing / 2))
    s = np.linspace(0, 1, columns)
    fall = np.linspace(0, 1, rows)[:, None]
    drift = sum(rng.uniform(0.25, 0.6) / k * np.sin(np.pi * k * s * 2 + rng.uniform(0, 2 * np.pi)) for k in (1, 2, 3))
    phase = 2 * np.pi * pleats * s + drift * (0.5 + 0.9 * fall)
    strength = 1 + 0.3 * np.sin(2 * np.pi * rng.uniform(1.5, 2.5) * s + rng.uniform(0, 6))
    profile = np.sin(phase) * strength * (1 - 0.12 * fall)
    profile = profile + (0.12 + 0.3 * fall**1.3) * np.sin(phase / 2 + rng.uniform(0, 6) + 1.2 * fall)
    profile = profile + 0.10 * (1 - fall) * np.sin(3 * phase + 1.0)
    step = width * fullness / (columns - 1)
    depth = _amplitude_of_span(profile, step, width) * profile
    sideways = _sideways(np.diff(depth, axis=1), step)
    x = np.concatenate([np.zeros((rows, 1)), np.cumsum(sideways, axis=1)], axis=1)
    x -= x[:, -1:] / 2
    z = -drop * fall + 0.006 * np.sin(2 * np.pi * pleats * s / 3 + 1.0) * fall
    positions = np.stack([x, depth, np.broadcast_to(z, x.shape)], axis=-1)
    u, v = np.meshgrid(s * width * fullness, drop * (1 - fall[:, 0]))
    return grid(positions, np.stack([u, v], axis=-1))


# A pleat never doubles back: it advances sideways by at least this share of its length.
_LEAST_ADVANCE = 0.15


def _sideways(rise: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """How far a piece of cloth of length `step` gets sideways that goes `rise` back or forth."""
    return np.sqrt(np.maximum(step**2 - rise**2, (_LEAST_ADVANCE * step) ** 2))


def _amplitude_of_span(profile: NDArray[np.float64], step: float, width: float) -> NDArray[np.float64]:
    """(rows, 1) factors at which the cloth pleated as `profile` (rows, N), N - 1 pieces of `step`, spans `width`."""
    rise = np.diff(profile, axis=1)
    low = np.zeros((len(profile), 1))
    high = np.full_like(low, width)
    for _ in range(50):
        middle = (low + high) / 2
        too_flat = _sideways(middle * rise, step).sum(axis=1, keepdims=True) > width
        low, high = np.where(too_flat, middle, low), np.where(too_flat, high, middle)
    return low


def folded_cloth(width: float, depth: float, layers: int, thickness: float, seed: int, spacing: float) -> Surface:
    """A cloth folded to and fro into `layers`, lying on z = 0; its rounded folds face -y and +y.

    Args:
        width: along x, metres.
        depth: along y, metres.
        thickness: from layer to layer, metres.
    """
    rng = np.random.default_rng(seed)
    radius = thickness / 2
    path = []
    for layer in range(layers):
        y = np.linspace(-depth / 2 + radius, depth / 2 - radius, max(6, round(depth / spacing / 2)))
        forward = layer % 2 == 0
        path.append(np.stack([y if forward else y[::-1], np.full_like(y, (layer + 0.5) * thickness)], axis=-1))
        if layer + 1 < layers:
            angle = np.linspace(-np.pi / 2, np.pi / 2, 10)[1:-1]
            bulge = 1 + rng.uniform(0.2, 1.0)
            end = (depth / 2 - radius) * (1 if forward else -1)
            turn = np.cos(angle) * radius * bulge * (1 if forward else -1)
            path.append(np.stack([end + turn, (layer + 1) * thickness + np.sin(angle) * radius], axis=-1))
    line = np.concatenate(path)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    x = np.linspace(-width / 2, width / 2, max(4, round(width / spacing / 2)))
    positions = np.empty((len(line), len(x), 3))
    positions[..., 0] = x
    # Each layer is a little out of line with the one below, and the pile sags towards its sides.
    wobble = 0.004 * np.interp(along, np.linspace(0, along[-1], 2 * layers), rng.standard_normal(2 * layers))
    positions[..., 0] += wobble[:, None]
    sag = 1 - 0.08 * np.abs(2 * x / width) ** 4
    positions[..., 1] = line[:, :1] + 0.002 * np.sin(x * 17 + rng.uniform(0, 6))
    positions[..., 2] = line[:, 1:] * sag
    u, v = np.meshgrid(x + width / 2, along)
    return grid(positions, np.stack([u, v], axis=-1))


def roll(length: float, core: float, radius: float, thickness: float, spacing: float, loose: float = 0.35) -> Surface:
    """Cloth rolled up along the x axis, a spiral from the `core` radius to `radius`, its free end hanging a little.

    Args:
        thickness: distance between turns in metres.
        loose: length of free cloth as a share of the radius.
    """
    turns = (radius - core) / thickness
    angle = np.linspace(0, 2 * np.pi * turns, max(48, round(48 * turns)))
    spiral = core + (radius - core) * angle / angle[-1]
    # The outer end leaves on the tangent, downwards at the front.
    start = -np.pi / 2 - angle[-1] + np.pi * 0.15
    line = np.stack([spiral * np.cos(angle + start), spiral * np.sin(angle + start)], axis=-1)
    tangent = line[-1] - line[-2]
    tail = line[-1] + np.linspace(0.1, 1, 6)[:, None] * tangent / np.linalg.norm(tangent) * radius * loose
    tail[:, 1] = np.maximum(tail[:, 1], -radius - 0.001)
    line = np.concatenate([line, tail])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    x = np.linspace(-length / 2, length / 2, max(3, round(length / spacing / 4)))
    positions = np.empty((len(line), len(x), 3))
    positions[..., 0] = x
    positions[..., 1:] = line[:, None]
    u, v = np.meshgrid(x + length / 2, along)
    return grid(positions, np.stack([u, v], axis=-1))


def cushion_cover(side: float, spacing: float) -> Surface:
    """Two square sheets sewn together at their edges, lying flat about z = 0: what gets inflated into a cushion.

    The vertices of the seam come first, in order round the edge.
    """
    n = max(9, round(side / spacing) + 1)
    u, v = np.meshgrid(np.linspace(0, side, n), np.linspace(0, side, n))
    rim = np.minimum(np.minimum(u, side - u), np.minimum(v, side - v)) / side
    front = np.stack([u - side / 2, v - side / 2, 0.06 * side * np.sqrt(rim)], axis=-1).reshape(-1, 3)
    flat = np.arange(n * n).reshape(n, n)
    edge = np.concatenate([flat[0, :-1], flat[:-1, -1], flat[-1, :0:-1], flat[:0:-1, 0]])
    inner = flat[1:-1, 1:-1].ravel()
    order = np.concatenate([edge, inner])
    position = np.empty(n * n, np.int32)
    position[order] = np.arange(n * n)
    back_position = position.copy()
    back_position[inner] += len(inner)
    mirrored = front * [1, 1, -1]
    vertices = np.concatenate([front[order], mirrored[inner]])
    coordinates = np.stack([u, v], axis=-1).reshape(-1, 2)
    quads = np.stack([flat[:-1, :-1], flat[:-1, 1:], flat[1:, 1:], flat[1:, :-1]], axis=-1).reshape(-1, 4)
    faces = np.concatenate([position[quads], back_position[quads][:, ::-1]])
    return Surface(vertices, faces.astype(np.int32), np.concatenate([coordinates[order], coordinates[inner]]))


def seam_length(surface_side: float, spacing: float) -> int:
    """Number of vertices of the seam of `cushion_cover` with the same arguments."""
    return 4 * (max(9, round(surface_side / spacing) + 1) - 1)


def tube(path: NDArray[np.float64], radius: float, sides: int = 8) -> Surface:
    """A closed tube round a closed (N, 3) path: the piping of a cushion; u runs along it, v round it."""
    tangent = np.roll(path, -1, 0) - np.roll(path, 1, 0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    outward = path - path.mean(axis=0)
    side = np.cross(tangent, outward)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    normal = np.cross(side, tangent)
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    ring = radius * (np.cos(angle)[None, :, None] * normal[:, None] + np.sin(angle)[None, :, None] * side[:, None])
    positions = np.concatenate([path[:, None] + ring, (path[:, None] + ring)[:1]])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.roll(path, -1, 0) - path, axis=1))])
    u, v = np.meshgrid(along, angle * radius, indexing="ij")
    return grid(positions, np.stack([u, v], axis=-1))


def rotation(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> NDArray[np.float64]:
    """(3, 3) rotation about x, then y, then z, in degrees."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(np.deg2rad([x, y, z])), np.sin(np.deg2rad([x, y, z]))
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x
