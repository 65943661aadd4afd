"""Renders Gaussians, measures a photometric loss and propagates its gradient back."""

from __future__ import annotations

from dataclasses import replace

import warp as wp

from .frame import Frame, Loss, Mask, RasterCamera
from .parameters import FIELDS, Gradients, ParameterSet
from .runner import TILE_HEIGHT, TILE_WIDTH, make_runner, resolve_device

_SSIM_C2 = 0.03**2  # (K2 · range)²
_SIZES_KEPT = 16  # image sizes whose buffers are kept; captures have few


class Rasterizer:
    """A device, its threads and buffers that grow as needed and are reused; for one caller at a time.

    Args:
        device: "cpu" or "cuda[:n]".
        threads: on the CPU; None takes all processors that this process may use.

    Raises:
        InputError: there is no such device.

    Example:
        >>> import numpy as np
        >>> from cvdgs.core import Gaussians, ParameterSet, RasterCamera, Rasterizer, read_gaussians, write_gaussians
        >>> arrays = {"means": [[0, 0, 3]], "log_scales": [[-2, -2, -2]], "quaternions": [[1, 0, 0, 0]]}
        >>> arrays |= {"opacity_logits": [4], "sh": [[[1, 0, -1]]]}
        >>> write_gaussians("red.ply", Gaussians(**{name: np.float32(value) for name, value in arrays.items()}))
        >>> scene = read_gaussians("red.ply")  # or a .spz or .splat file
        >>> camera = RasterCamera(64, 48, fx=60.0, fy=60.0, cx=32.0, cy=24.0, world_to_camera=np.eye(4))
        >>> frame = Rasterizer().render(ParameterSet.from_gaussians(scene), camera)
        >>> print(*frame.color.numpy()[24, 32].round(1))  # in the middle; sRGB
        0.7 0.5 0.2
    """

    def __init__(self, device: str = "cpu", threads: int | None = None) -> None:
        self.device = resolve_device(device)
        self.runner = make_runner(self.device, threads)
        self._images: dict[tuple[int, int], dict[str, wp.array]] = {}
        self._gradients: Gradients | None = None
        self._count = -1
        self._number = 0

    def render(
        self, params: ParameterSet, camera: RasterCamera, background: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> Frame:
        """Render `params` over `background` (sRGB). The frame is valid until the next render."""
        self._bind_parameters(params)
        images = self._bind_images(camera)
        self.runner.set_camera(camera.packed(background))
        intersections = self.runner.render()
        self._number += 1
        return Frame(
            camera=camera,
            parameters=params,
            visible=self.runner.array("visible"),
            radii=self.runner.array("radii"),
            intersections=intersections,
            number=self._number,
            **images,
        )

    def photometric_loss(
        self,
        frame: Frame,
        target: wp.array,
        ssim_weight: float = 0.2,
        mask: Mask | None = None,
        *,
        noise: float = 0.0,
    ) -> Loss:
        """(1 - w) L1 + w (1 - SSIM) of the frame's colour against a photograph; fills `frame.grad_color`.

        SSIM has a Gaussian window of 11 pixels, sigma 1.5, zero padding and K = (0.01, 0.03), over the three channels.

        Args:
            target: (H, W, 3) uint8 or float32, display-referred sRGB.
            ssim_weight: w.
            mask: multiplies both images, so that SSIM treats what the photograph does not cover like what lies outside
                the image; the means are weighted by it.
            noise: standard deviation of the target's noise, in [0, 1]. What two noisy pixels differ by, twice its
                variance, is added to SSIM's stabiliser of contrast and structure, (K2)²: flat parts need not match
                noise, and textured ones count as before.
        """
        self._require_current(frame)
        runner, state = self.runner, self.runner.state
        shape = (frame.camera.height, frame.camera.width)
        if target.shape != (*shape, 3):
            raise ValueError(f"target has shape {target.shape}, the frame {(*shape, 3)}")
        state.target_is_bytes = int(target.dtype == wp.uint8)
        runner.bind("target_bytes" if state.target_is_bytes else "target_floats", target)
        runner.bind("grad_color", frame.grad_color)
        weight = float(shape[0] * shape[1])
        state.mask_kind = 0
        if mask is not None:
            if mask.pixels.shape != shape:
                raise ValueError(f"mask has shape {mask.pixels.shape}, the frame {shape}")
            is_bytes = mask.pixels.dtype == wp.uint8
            state.mask_kind = 2 if is_bytes else 1
            runner.bind("mask_bytes" if is_bytes else "mask_floats", mask.pixels)
            weight = mask.total
        scale = 1.0 / (3.0 * weight) if weight > 0.0 else 0.0
        state.l1_scale = (1.0 - ssim_weight) * scale
        state.ssim_scale = ssim_weight * scale
        state.ssim_c2 = _SSIM_C2 + 2.0 * noise**2
        sums = runner.loss()

        def read() -> tuple[float, float]:
            l1, ssim = (float(part) * scale for part in sums())
            return l1, ssim if weight > 0.0 else 1.0  # nothing was compared, so nothing differs

        return Loss(read, ssim_weight)

    def backward(
        self,
        frame: Frame,
        *,
        grad_color: wp.array | None = None,
        grad_depth: wp.array | None = None,
        grad_alpha: wp.array | None = None,
        colors_only: bool = False,
        absolute: bool = False,
    ) -> Gradients:
        """Gradients of the parameters from those of the images; valid until the next call.

        The same input gives the same bits, whatever the number of threads.

        Args:
            grad_color: (H, W, 3) float32; `frame.grad_color` when None.
            grad_depth, grad_alpha: (H, W) float32, zero when None.
            colors_only: compute `sh[:, 0]` only, for fitting colours to fixed geometry.
            absolute: fill `screen_abs` too, which takes about 30 % longer on the CPU.
        """
        self._require_current(frame)
        runner, state = self.runner, self.runner.state
        params = frame.parameters
        gradients = self._bind_gradients(len(params), params.sh_count)
        runner.bind("grad_color", frame.grad_color if grad_color is None else grad_color)
        state.with_depth = int(not (grad_depth is None and grad_alpha is None))
        if state.with_depth:
            zeros = wp.zeros(frame.depth.shape, dtype=wp.float32, device=self.device)
            runner.bind("grad_depth", zeros if grad_depth is None else grad_depth)
            runner.bind("grad_alpha", zeros if grad_alpha is None else grad_alpha)
        state.colors_only = int(colors_only)
        state.absolute = int(absolute)
        runner.backward()
        return replace(gradients, colors_only=colors_only)

    def _bind_parameters(self, params: ParameterSet) -> None:
        if params.device != self.device:
            raise ValueError(f"the Gaussians are on {params.device}, the rasteriser on {self.device}")
        runner, count = self.runner, len(params)
        for name in FIELDS:
            runner.bind(name, getattr(params, name))
        runner.state.gaussians = count
        runner.state.sh_count = params.sh_count
        if count != self._count:
            self._count = count
            runner.allocate("visible", (count,), wp.uint8)
            runner.allocate("radii", (count,), wp.float32)
            runner.reserve_gaussians(count)

    def _bind_images(self, camera: RasterCamera) -> dict[str, wp.array]:
        runner, state = self.runner, self.runner.state
        width, height = camera.width, camera.height
        if (width, height) not in self._images:
            if len(self._images) >= _SIZES_KEPT:
                self._images.pop(next(iter(self._images)))
            shapes = {"color": (height, width, 3), "depth": (height, width), "alpha": (height, width)}
            shapes["grad_color"] = shapes["color"]
            self._images[width, height] = {
                name: wp.zeros(shape, dtype=wp.float32, device=self.device) for name, shape in shapes.items()
            }
        images = self._images[width, height]
        for name, array in images.items():
            runner.bind(name, array)
        state.width, state.height = width, height
        state.tiles_x = -(-width // TILE_WIDTH)
        state.tiles = state.tiles_x * -(-height // TILE_HEIGHT)
        return images

    def _bind_gradients(self, count: int, sh_count: int) -> Gradients:
        if self._gradients is None or self._gradients.sh.shape[:2] != (count, sh_count):
            self._gradients = Gradients.zeros(count, sh_count, self.device)
        gradients = self._gradients
        for name in (*FIELDS, "screen", "screen_abs"):
            self.runner.bind(f"grad_{name}", getattr(gradients, name))
        self.runner.bind("touched", gradients.touched)
        return gradients

    def _require_current(self, frame: Frame) -> None:
        if frame.number != self._number:
            raise ValueError("the frame is not the rasteriser's latest: its arrays have been overwritten")
