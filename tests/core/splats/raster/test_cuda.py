"""The CUDA kernels compile everywhere, and do on a GPU what the CPU does."""

from __future__ import annotations

import shutil
import subprocess
import sys

import numpy as np
import pytest
import warp as wp

from cvdgs.core.errors import InputError
from cvdgs.core.splats.raster import Adam, LearningRates, Mask, ParameterSet, Rasterizer, load
from cvdgs.core.splats.raster.runner import Runner

from . import reference as reference

RATES = LearningRates(means=1e-3, log_scales=2e-3, quaternions=3e-3, opacity_logits=4e-3, sh0=5e-3, sh_rest=6e-4)

ARCHITECTURES = (75, 86, 90)  # Turing, the oldest that Warp compiles for, Ampere and Hopper

COMPILE = """
import sys, warp as wp
wp.init()
supported = wp._src.context.runtime.nvrtc_supported_archs
if not supported.issuperset(map(int, sys.argv[2:])):
    sys.exit(77)
from cvdgs.core.splats.raster import kernels_cuda
for architecture in map(int, sys.argv[2:]):
    folder = f"{sys.argv[1]}/{architecture}"
    for path in wp.compile_aot_module(kernels_cuda, arch=architecture, module_dir=folder, use_ptx=False):
        print(path.stat().st_size)
"""


def cuda_device() -> str:
    wp.init()
    if not wp.is_cuda_available():
        pytest.skip("no CUDA device")
    return "cuda:0"


def test_the_kernels_compile_without_a_gpu(tmp_path):
    # In a process of its own: registering CUDA kernels here would have Warp hash them in every other test.
    arguments = [sys.executable, "-c", COMPILE, str(tmp_path), *map(str, ARCHITECTURES)]
    run = subprocess.run(arguments, capture_output=True, text=True, timeout=240)
    if run.returncode == 77:
        pytest.skip("this Warp wheel has no compiler for these architectures")
    assert run.returncode == 0, run.stderr
    sizes = [int(line) for line in run.stdout.splitlines() if line.isdigit()]
    assert len(sizes) == len(ARCHITECTURES)
    assert min(sizes) > 10_000


def test_a_device_that_is_not_there_is_named():
    with pytest.raises(InputError, match="cuda:7"):
        Rasterizer("cuda:7")
    with pytest.raises(InputError, match="abacus"):
        load("abacus")


def two_steps(
    scene: reference.Scene, device: str, mask: np.ndarray | None, runner: Runner | None = None
) -> dict[str, np.ndarray]:
    """Everything a step yields, twice in a row; `runner` takes the place of the device's own."""
    rasterizer = Rasterizer(device)
    if runner is not None:
        rasterizer.runner = runner
    params = ParameterSet.from_gaussians(scene.gaussians, device)
    optimizer = Adam(params)
    shape = (scene.camera.height, scene.camera.width)
    rng = np.random.default_rng(3)
    target = wp.array(rng.integers(0, 256, (*shape, 3), np.uint8), dtype=wp.uint8, device=device)
    given_mask = None if mask is None else Mask.of(mask.astype(np.float32), device)
    grad_depth = wp.array(rng.normal(size=shape).astype(np.float32) * 1e-3, dtype=wp.float32, device=device)
    results: dict[str, np.ndarray] = {}
    for step in range(2):
        frame = rasterizer.render(params, scene.camera, scene.background)
        loss = rasterizer.photometric_loss(frame, target, mask=given_mask)
        gradients = rasterizer.backward(frame, grad_depth=grad_depth, absolute=True)
        found = {
            "color": frame.color,
            "depth": frame.depth,
            "alpha": frame.alpha,
            "visible": frame.visible,
            "radii": frame.radii,
            "grad_color": frame.grad_color,
            "screen": gradients.screen,
            "screen_abs": gradients.screen_abs,
        }
        results |= {f"{name} {step}": array.numpy().copy() for name, array in found.items()}
        results |= {f"gradient {name} {step}": value.copy() for name, value in gradients.numpy().items()}
        results[f"loss {step}"] = np.array([loss.total, loss.l1, loss.ssim])
        optimizer.step(rasterizer, params, gradients, RATES)
    colors = rasterizer.backward(rasterizer.render(params, scene.camera), grad_color=frame.grad_color, colors_only=True)
    results["colours alone"] = colors.sh.numpy()[:, 0].copy()
    return results


def assert_agreement(found: dict[str, np.ndarray], expected: dict[str, np.ndarray]) -> None:
    for name, value in expected.items():
        error = np.linalg.norm(found[name].astype(np.float64) - value)
        # The second step starts from parameters that Adam moved by the sign of tiny gradients.
        tolerance = 1e-2 if name.endswith(" 1") or name == "colours alone" else 2e-5
        assert error <= tolerance * np.linalg.norm(value.astype(np.float64)) + 1e-7, name


def soft_mask(width: int, height: int) -> np.ndarray:
    return np.random.default_rng(5).uniform(size=(height, width)).astype(np.float32)


@pytest.mark.gpu
@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize(
    ("count", "width", "height", "sh_degree"), [(400, 75, 53, 3), (5000, 130, 97, 0), (0, 9, 9, 0)]
)
def test_cuda_and_cpu_agree(count, width, height, sh_degree, masked):
    device = cuda_device()
    scene = reference.random_scene(count, width, height, sh_degree=sh_degree, seed=count)
    mask = soft_mask(width, height) if masked else None
    assert_agreement(two_steps(scene, device, mask), two_steps(scene, "cpu", mask))


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("g++") is None, reason="needs g++")
def test_the_cuda_kernels_emulated_without_a_gpu_agree_with_the_cpu(tmp_path):
    from . import cuda_emulation as emulation

    kernels = emulation.compile_kernels(tmp_path)
    for count, width, height, sh_degree, masked in [
        (150, 35, 21, 3, False),
        (60, 17, 33, 1, True),
        (0, 9, 9, 0, False),
    ]:
        scene = reference.random_scene(count, width, height, sh_degree=sh_degree, seed=count)
        mask = soft_mask(width, height) if masked else None
        found = two_steps(scene, "cpu", mask, emulation.EmulatedCudaRunner(kernels))
        assert_agreement(found, two_steps(scene, "cpu", mask))


@pytest.mark.gpu
def test_the_bits_on_cuda_do_not_depend_on_the_run():
    device = cuda_device()
    scene = reference.random_scene(3000, 120, 90, sh_degree=1, seed=2)
    first, second = two_steps(scene, device, None), two_steps(scene, device, None)
    for name, value in first.items():
        assert value.tobytes() == second[name].tobytes(), name
