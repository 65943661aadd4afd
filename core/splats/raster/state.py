"""The state that kernels read and write, one Warp structure whose fields native code sees by name."""

from __future__ import annotations

from importlib import resources

import warp as wp

from ..gaussians import LOW_PASS

# No `from __future__ import annotations`: Warp evaluates the annotations of a structure, which are not Python's.
# mypy: disable-error-code="valid-type"

# Set before Warp starts: its banner would end up among the events on stdout.
wp.config.log_level = wp.LOG_WARNING


@wp.struct
class State:
    """One structure for all stages; Python keeps a single instance and changes its fields between launches."""

    # camera and image
    camera: wp.array(dtype=wp.float32)  # `Camera` of projection.h
    width: wp.int32
    height: wp.int32
    tiles_x: wp.int32
    tiles: wp.int32

    # parameters
    gaussians: wp.int32
    sh_count: wp.int32
    means: wp.array2d(dtype=wp.float32)
    log_scales: wp.array2d(dtype=wp.float32)
    quaternions: wp.array2d(dtype=wp.float32)
    opacity_logits: wp.array(dtype=wp.float32)
    sh: wp.array3d(dtype=wp.float32)

    # per Gaussian
    splats: wp.array2d(dtype=wp.float32)  # `Splat` of projection.h
    keys: wp.array(dtype=wp.uint32)  # depth as a sortable integer, all ones where culled
    order: wp.array(dtype=wp.int32)  # front to back, culled ones last
    visible: wp.array(dtype=wp.uint8)
    radii: wp.array(dtype=wp.float32)
    first_slot: wp.array(dtype=wp.int32)  # per rank in `order`, and the total; a slot is one intersection with a tile
    touched: wp.array(dtype=wp.uint8)

    # sorting and binning
    counters: wp.array(dtype=wp.int32)  # the next chunk of each stage
    sort_histogram: wp.array(dtype=wp.int32)
    sort_scratch: wp.array(dtype=wp.int32)
    segments: wp.int32
    tile_histogram: wp.array(dtype=wp.int32)  # segments x tiles
    tile_start: wp.array(dtype=wp.int32)  # tiles + 1

    # per intersection; a list is what one tile blends, front to back
    list_gaussian: wp.array(dtype=wp.int32)
    list_slot: wp.array(dtype=wp.int32)
    list_rows: wp.array(dtype=wp.uint8)  # first and last row of the tile, four bits each
    moments: wp.array2d(dtype=wp.float32)  # per slot
    slot_count: wp.array(dtype=wp.int32)  # CUDA: per rank
    slot_tile: wp.array(dtype=wp.int32)  # CUDA: what the slots are sorted by
    slot_owner: wp.array(dtype=wp.int32)  # CUDA: the Gaussian of each slot

    # images
    color: wp.array3d(dtype=wp.float32)
    depth: wp.array2d(dtype=wp.float32)
    alpha: wp.array2d(dtype=wp.float32)
    grad_color: wp.array3d(dtype=wp.float32)
    grad_depth: wp.array2d(dtype=wp.float32)
    grad_alpha: wp.array2d(dtype=wp.float32)

    # loss
    target_is_bytes: wp.int32
    target_bytes: wp.array3d(dtype=wp.uint8)
    target_floats: wp.array3d(dtype=wp.float32)
    mask_kind: wp.int32  # 0 none, 1 floats, 2 bytes
    mask_floats: wp.array2d(dtype=wp.float32)
    mask_bytes: wp.array2d(dtype=wp.uint8)
    l1_scale: wp.float32
    ssim_scale: wp.float32
    ssim_c2: wp.float32  # SSIM's stabiliser of contrast and structure
    loss_scratch: wp.array(dtype=wp.float32)
    loss_partial: wp.array2d(dtype=wp.float64)  # per strip or block: sums of |x - y| and of SSIM
    ssim_maps: wp.array(dtype=wp.float32)  # CUDA: three derivatives, (3, H, W, 3)

    # contrast hinge; its formula is at the head of contrast.h
    contrast_observer: wp.array(dtype=wp.float32)  # S and linear sRGB to XYZ
    contrast_lab: wp.array(dtype=wp.float32)  # six planes
    contrast_pairs: wp.array2d(dtype=wp.uint8)
    contrast_targets_only: wp.int32
    contrast_listed: wp.float32  # the difference from which a pair is listed
    contrast_threshold: wp.float32
    contrast_cap: wp.float32
    contrast_invented: wp.float32
    contrast_floor: wp.float32
    contrast_scale: wp.float32

    # gradients
    with_depth: wp.int32
    absolute: wp.int32
    colors_only: wp.int32
    grad_means: wp.array2d(dtype=wp.float32)
    grad_log_scales: wp.array2d(dtype=wp.float32)
    grad_quaternions: wp.array2d(dtype=wp.float32)
    grad_opacity_logits: wp.array(dtype=wp.float32)
    grad_sh: wp.array3d(dtype=wp.float32)
    grad_screen: wp.array(dtype=wp.float32)
    grad_screen_abs: wp.array(dtype=wp.float32)

    # Adam
    m_means: wp.array2d(dtype=wp.float32)
    m_log_scales: wp.array2d(dtype=wp.float32)
    m_quaternions: wp.array2d(dtype=wp.float32)
    m_opacity_logits: wp.array(dtype=wp.float32)
    m_sh: wp.array3d(dtype=wp.float32)
    v_means: wp.array2d(dtype=wp.float32)
    v_log_scales: wp.array2d(dtype=wp.float32)
    v_quaternions: wp.array2d(dtype=wp.float32)
    v_opacity_logits: wp.array(dtype=wp.float32)
    v_sh: wp.array3d(dtype=wp.float32)
    adam_steps: wp.array(dtype=wp.int32)  # how often the Gaussian has been moved
    adam_bias: wp.array2d(dtype=wp.float32)  # per step t: 1 / (1 - beta1^t), 1 / sqrt(1 - beta2^t)
    adam_table_size: wp.int32
    rate_means: wp.float32
    rate_log_scales: wp.float32
    rate_quaternions: wp.float32
    rate_opacity_logits: wp.float32
    rate_sh0: wp.float32
    rate_sh_rest: wp.float32
    beta1: wp.float32
    beta2: wp.float32
    epsilon: wp.float32


def read_headers(names: tuple[str, ...]) -> str:
    """The headers concatenated: Warp takes a preamble, not files that include each other."""
    constants = f"#define RASTER_LOW_PASS {LOW_PASS}f"
    folder = resources.files(__package__)
    texts = (folder.joinpath(name).read_text(encoding="utf-8") for name in names)
    return "\n".join((constants, *(text.replace("#pragma once", "") for text in texts)))
