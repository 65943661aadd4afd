"""Independent oracle: the rasteriser's image model in float64 torch, all pixels against all Gaussians, by autograd."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from cvdgs.core.splats.gaussians import Gaussians
from cvdgs.core.splats.raster import RasterCamera

ALPHA_MIN, ALPHA_MAX, TRANSMITTANCE_MIN, DILATION = 1.0 / 255.0, 0.999, 1e-4, 0.3
FIELDS = ("means", "log_scales", "quaternions", "opacity_logits", "sh")


@dataclass(frozen=True)
class Scene:
    """Parameters as float64 leaves, rounded to float32 before so that both sides start from the same numbers."""

    camera: RasterCamera
    leaves: dict[str, torch.Tensor]
    background: tuple[float, float, float] = (0.2, 0.7, 0.4)

    @property
    def gaussians(self) -> Gaussians:
        return Gaussians(**{k: v.detach().numpy().astype(np.float32) for k, v in self.leaves.items()})


def random_scene(
    count: int, width: int, height: int, *, sh_degree: int = 0, seed: int = 0, spread: float = 1.0, beside: float = 0.1
) -> Scene:
    """Gaussians over the field of view of an oblique, off-centre camera with unequal focal lengths.

    Args:
        spread: standard deviation in units of the mean distance between Gaussians on the screen.
        beside: how far beyond the image, as a fraction of its size, centres lie.
    """
    rng = np.random.default_rng(seed)
    fx, fy = 0.9 * width, 1.1 * width
    cx, cy = 0.43 * width, 0.56 * height
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.random(random_state=int(rng.integers(1 << 30))).as_matrix()
    matrix[:3, 3] = rng.normal(size=3)
    camera = RasterCamera(width, height, fx, fy, cx, cy, matrix)
    depth = rng.uniform(2.0, 8.0, count)
    u = rng.uniform(-beside, 1.0 + beside, count) * width
    v = rng.uniform(-beside, 1.0 + beside, count) * height
    view = np.stack([(u - cx) / fx * depth, (v - cy) / fy * depth, depth], 1)
    pixels = spread * np.sqrt(width * height / max(count, 1))
    values = {
        "means": (view - matrix[:3, 3]) @ matrix[:3, :3],
        "log_scales": np.log(pixels * 4.0 / fx) + 0.6 * rng.normal(size=(count, 3)),
        "quaternions": rng.normal(size=(count, 4)),
        "opacity_logits": 1.5 * rng.normal(size=count),
        "sh": rng.normal(size=(count, (sh_degree + 1) ** 2, 3)) * 0.6,
    }
    leaves = {k: torch.from_numpy(v.astype(np.float32).astype(np.float64)).requires_grad_() for k, v in values.items()}
    return Scene(camera, leaves)


def harmonics(direction: torch.Tensor, count: int) -> torch.Tensor:
    """(N, count) real spherical harmonics from associated Legendre functions: m < 0 sine, m > 0 cosine, with the
    Condon-Shortley phase, which are the signs of the 3DGS PLY."""
    x, y, z = direction.unbind(1)
    around = torch.complex(x, y)  # sin(theta) e^(i phi)
    legendre = {  # P_l^m / sin^m(theta), without the phase
        (0, 0): torch.ones_like(z),
        (1, 0): z,
        (1, 1): torch.ones_like(z),
        (2, 0): (3 * z**2 - 1) / 2,
        (2, 1): 3 * z,
        (2, 2): 3 * torch.ones_like(z),
        (3, 0): (5 * z**3 - 3 * z) / 2,
        (3, 1): (15 * z**2 - 3) / 2,
        (3, 2): 15 * z,
        (3, 3): 15 * torch.ones_like(z),
    }
    columns = []
    for degree in range(4):
        for order in range(-degree, degree + 1):
            m = abs(order)
            ratio = np.prod([1.0 / k for k in range(degree - m + 1, degree + m + 1)])
            norm = np.sqrt((2 * degree + 1) / (4 * np.pi) * ratio) * (np.sqrt(2) if m else 1.0) * (-1) ** m
            turn = (around**m).imag if order < 0 else (around**m).real
            columns.append(norm * legendre[degree, m] * turn)
    return torch.stack(columns[:count], 1)


def rotations(quaternions: torch.Tensor) -> torch.Tensor:
    """(N, 3, 3) of (N, 4) wxyz, of any length: v -> v + 2 w (u x v) + 2 u x (u x v)."""
    unit = quaternions / quaternions.norm(dim=1, keepdim=True)
    w, u = unit[:, :1, None], unit[:, 1:]
    zero = torch.zeros_like(u[:, 0])
    cross = torch.stack([zero, -u[:, 2], u[:, 1], u[:, 2], zero, -u[:, 0], -u[:, 1], u[:, 0], zero], 1).view(-1, 3, 3)
    return torch.eye(3, dtype=unit.dtype) + 2 * w * cross + 2 * cross @ cross


def project(scene: Scene, pose: torch.Tensor | None = None) -> dict[str, torch.Tensor]:
    """Centres (N, 2), covariances (N, 2, 2), depths (N,), opacities (N,) and colours (N, 3), differentiable.

    With a (4, 4) `pose` in place of the camera's also with respect to that.
    """
    camera, leaves = scene.camera, scene.leaves
    matrix = torch.from_numpy(np.asarray(camera.world_to_camera)) if pose is None else pose
    view = leaves["means"] @ matrix[:3, :3].T + matrix[:3, 3]
    x, y, z = view.unbind(1)
    centers = torch.stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy], 1)
    margin_x, margin_y = 0.15 * camera.width / camera.fx, 0.15 * camera.height / camera.fy
    slope_x = (x / z).clamp(-camera.cx / camera.fx - margin_x, (camera.width - camera.cx) / camera.fx + margin_x)
    slope_y = (y / z).clamp(-camera.cy / camera.fy - margin_y, (camera.height - camera.cy) / camera.fy + margin_y)
    zero = torch.zeros_like(z)
    jacobian = torch.stack(
        [camera.fx / z, zero, -camera.fx * slope_x / z, zero, camera.fy / z, -camera.fy * slope_y / z], 1
    ).view(-1, 2, 3)
    factor = jacobian @ matrix[:3, :3] @ rotations(leaves["quaternions"]) * leaves["log_scales"].exp()[:, None, :]
    covariances = factor @ factor.transpose(1, 2) + DILATION * torch.eye(2, dtype=z.dtype)
    direction = leaves["means"] + matrix[:3, :3].T @ matrix[:3, 3]
    direction = direction / direction.norm(dim=1, keepdim=True)
    basis = harmonics(direction, leaves["sh"].shape[1])
    colors = (0.5 + torch.einsum("nk,nkc->nc", basis, leaves["sh"])).clamp(min=0.0)
    opacities = torch.sigmoid(leaves["opacity_logits"])
    return {"centers": centers, "covariances": covariances, "depths": z, "opacities": opacities, "colors": colors}


def alphas(camera: RasterCamera, projected: dict[str, torch.Tensor]) -> torch.Tensor:
    """(H W, N) alpha of every Gaussian at every pixel before blending, zero below the threshold."""
    rows, columns = torch.meshgrid(torch.arange(camera.height), torch.arange(camera.width), indexing="ij")
    pixels = torch.stack([columns.reshape(-1), rows.reshape(-1)], 1).to(torch.float64) + 0.5
    offset = pixels[:, None, :] - projected["centers"][None]
    conic = torch.linalg.inv(projected["covariances"])
    power = -0.5 * torch.einsum("pni,nij,pnj->pn", offset, conic, offset)
    alpha = projected["opacities"] * power.exp()
    drawn = (alpha >= ALPHA_MIN) & (projected["depths"] >= camera.near)
    return torch.where(drawn, alpha.clamp(max=ALPHA_MAX), torch.zeros_like(alpha))


def blend(
    camera: RasterCamera, projected: dict[str, torch.Tensor], background: tuple[float, float, float]
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Colour (H, W, 3) over the background, depth (H, W) and alpha (H, W)."""
    order = torch.argsort(projected["depths"].detach(), stable=True)
    projected = {name: value[order] for name, value in projected.items()}
    alpha = alphas(camera, projected)
    after = torch.cumprod(1 - alpha, 1)
    before = torch.cat([torch.ones_like(after[:, :1]), after[:, :-1]], 1)
    weights = torch.where(before.detach() >= TRANSMITTANCE_MIN, alpha * before, torch.zeros_like(alpha))
    total = weights.sum(1)
    color = weights @ projected["colors"] + (1 - total)[:, None] * torch.tensor(background, dtype=torch.float64)
    shape = (camera.height, camera.width)
    return color.view(*shape, 3), (weights @ projected["depths"]).view(shape), total.view(shape)


def render(scene: Scene) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """As `blend`."""
    return blend(scene.camera, project(scene), scene.background)


def gradients(scene: Scene, cotangents: list[NDArray | None]) -> dict[str, NDArray[np.float64]]:
    """dL/dparameter for given dL/dcolor, dL/ddepth and dL/dalpha (None: zero)."""
    images = render(scene)
    pairs = [(image, c) for image, c in zip(images, cotangents, strict=True) if c is not None]
    total = sum((image * torch.from_numpy(np.asarray(c, np.float64))).sum() for image, c in pairs)
    values = torch.autograd.grad(total, [scene.leaves[name] for name in FIELDS], allow_unused=True)
    return {
        name: np.zeros(scene.leaves[name].shape) if value is None else value.numpy()
        for name, value in zip(FIELDS, values, strict=True)
    }
