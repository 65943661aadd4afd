"""Depth order and tile lists against brute force."""

from __future__ import annotations

from functools import cache

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cvdgs.core.splats.gaussians import Gaussians
from cvdgs.core.splats.raster import ParameterSet, RasterCamera, Rasterizer
from cvdgs.core.splats.raster.runner import TILE_HEIGHT, TILE_WIDTH

from . import reference as reference


@cache
def rasterizers() -> tuple[Rasterizer, ...]:
    return Rasterizer(threads=1), Rasterizer(threads=3)


def gaussians_at_depths(depths: np.ndarray) -> Gaussians:
    """On the optical axis of the identity camera, in colour and shape alike."""
    count = len(depths)
    return Gaussians(
        means=np.stack([np.zeros(count), np.zeros(count), depths], 1).astype(np.float32),
        log_scales=np.full((count, 3), -2.0, np.float32),
        quaternions=np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
        opacity_logits=np.zeros(count, np.float32),
        sh=np.zeros((count, 1, 3), np.float32),
    )


@settings(deadline=None, max_examples=40)
@given(
    depths=st.lists(
        st.one_of(st.floats(0.0625, 1e6, width=32), st.sampled_from([1.0, 2.0, 0.0, -3.0, 1e30])), max_size=300
    ),
    repeat=st.sampled_from([1, 40]),  # beyond 4096 Gaussians all threads take part
)
def test_gaussians_are_ordered_by_depth_stably_and_culled_ones_come_last(depths, repeat):
    depths = np.array(depths * repeat, np.float32)
    camera = RasterCamera(9, 9, 10.0, 10.0, 4.5, 4.5, np.eye(4))
    orders = []
    for rasterizer in rasterizers():
        frame = rasterizer.render(ParameterSet.from_gaussians(gaussians_at_depths(depths)), camera)
        visible = frame.visible.numpy().astype(bool)
        order = rasterizer.runner.array("order").numpy()[: len(depths)]
        keys = np.where(visible, depths, np.inf)
        np.testing.assert_array_equal(order, np.argsort(keys, kind="stable"))
        assert not visible[depths < camera.near].any()
        orders.append(order.tobytes())
    assert len(set(orders)) == 1


def tile_rows(rasterizer: Rasterizer, tiles: int) -> dict[tuple[int, int], tuple[int, int]]:
    """(tile, gaussian) -> first and last listed row of the tile, and checks that every list is in depth order."""
    get = rasterizer.runner.array
    start = get("tile_start").numpy()[: tiles + 1]
    rank = np.argsort(get("order").numpy())
    listed = {}
    slots = []
    for tile in range(tiles):
        part = slice(start[tile], start[tile + 1])
        members = get("list_gaussian").numpy()[part]
        assert (np.diff(rank[members]) > 0).all()
        slots.extend(get("list_slot").numpy()[part])
        for gaussian, rows in zip(members, get("list_rows").numpy()[part], strict=True):
            listed[tile, int(gaussian)] = (int(rows) & 15, int(rows) >> 4)
    assert sorted(slots) == list(range(start[tiles]))
    return listed


@settings(deadline=None, max_examples=25)
@given(
    seed=st.integers(0, 2**31),
    width=st.integers(1, 60),
    height=st.integers(1, 60),
    spread=st.sampled_from([0.2, 1.0, 5.0]),
)
def test_the_lists_hold_every_pixel_that_a_gaussian_reaches_and_few_others(seed, width, height, spread):
    scene = reference.random_scene(30, width, height, seed=seed, spread=spread, beside=0.5)
    projected = {name: value.detach() for name, value in reference.project(scene).items()}
    reached = reference.alphas(scene.camera, projected).numpy().reshape(height, width, -1) > 0
    tiles_x, tiles_y = -(-width // TILE_WIDTH), -(-height // TILE_HEIGHT)
    for rasterizer in rasterizers():
        rasterizer.render(ParameterSet.from_gaussians(scene.gaussians), scene.camera)
        listed = tile_rows(rasterizer, tiles_x * tiles_y)
        for gaussian in range(30):
            for row, column in zip(*np.nonzero(reached[..., gaussian]), strict=True):
                tile = (row // TILE_HEIGHT) * tiles_x + column // TILE_WIDTH
                first, last = listed.get((tile, gaussian), (16, -1))
                assert first <= row % TILE_HEIGHT <= last
        # Exact up to the margin: all but some rows at an ellipse's rim hold a pixel that it reaches.
        empty = total = 0
        for (tile, gaussian), (first, last) in listed.items():
            top, left = tile // tiles_x * TILE_HEIGHT, tile % tiles_x * TILE_WIDTH
            rows = reached[top + first : top + last + 1, left : left + TILE_WIDTH, gaussian].any(axis=1)
            empty += (~rows).sum()
            total += len(rows)
        assert empty <= 0.05 * total + 8
