"""How a run's viewer.html compares with its pictures: python scripts/measure_viewer.py RUN [--picture FILE.png].

Opens the page in Chromium (or Chrome) without a window and says its size, when it is open, what it asked other
computers for, PSNR of each layer against the run's own rasteriser from the held-out cameras, and the mean ΔE00 of the
simulation against core/color. Needs playwright, which `make venv` installs.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "core"))
import bootstrap

bootstrap.load(modules=("torch", "OpenImageIO", "playwright"))
import numpy as np

from cvdgs.core.color.matrices import check_simulation
from cvdgs.core.color.spaces import delta_e_2000, image_to_tensor
from cvdgs.core.color.srgb import simulate_bytes
from cvdgs.core.errors import InputError
from cvdgs.core.files.images import read_png
from cvdgs.core.runs.layout import RENDERS_FOLDER, VIEWER_PAGE
from cvdgs.core.runs.report import read_report
from cvdgs.core.runtime.cli import OneLineParser, exit_code
from cvdgs.core.settings import CVD_TYPES
from cvdgs.scripts.benchmarks.browser import browser, open_viewer, picture_of, write_screenshot

_SEVERITIES = (1.0, 0.55)
_SETTLING = 1000.0  # milliseconds after a change


def measure(run: Path, picture: Path | None = None) -> list[str]:
    """Lines on the viewer of the run in `run`; a screenshot goes to `picture`.

    Raises:
        InputError: no finished run, no viewer, no rendering to compare with, or no browser.
    """
    report, path = read_report(run), run / VIEWER_PAGE
    if not path.is_file():
        raise InputError("the run has no web page", where=path, remedy="make the run again, or use scripts/convert.py")
    with browser() as running:
        page = running.new_page(viewport={"width": 1080, "height": 640})
        asked: list[str] = []
        page.on("request", lambda request: asked.append(request.url))
        seconds = open_viewer(page, path)
        scene = page.evaluate("({cameras: cvdgs.scene.cameras, layers: cvdgs.scene.layers.map((layer) => layer.name)})")
        if picture is not None:
            _draw(page, picture)
        lines = [f"{path.stat().st_size / 1e6:.2f} MB, open after {seconds:.2f} s"]
        cameras = rendered_cameras(run, scene)
        for number, layer in enumerate(scene["layers"]):
            pictures = [_pixels(page, camera, layer=number) for camera in cameras]
            rendered = [read_png(_rendered(run, layer, camera)) for camera in cameras]
            found = [_psnr(*pair) for pair in zip(pictures, rendered, strict=True)]
            lines.append(f"{layer}: {min(found):.1f} to {max(found):.1f} dB against the rasteriser, {len(found)} views")
        model = report["settings"]["simulation"]
        for cvd in described_by(model):
            for severity in _SEVERITIES:
                seen = _pixels(page, cameras[0], layer=0, observer=cvd, severity=severity)
                expected = simulate_bytes(_pixels(page, cameras[0], layer=0), cvd, severity, model)
                lines.append(f"{cvd} {severity:g}: mean ΔE00 {_difference(seen, expected):.3f} against core/color")
        away = [url for url in asked if not url.startswith(("file:", "blob:", "data:"))]
        lines.append(f"{len(away)} requests to other computers")
    return lines


def rendered_cameras(run: Path, scene: dict[str, Any]) -> list[dict[str, Any]]:
    """The cameras of a viewer's scene that the run has a rendering of every layer from.

    Raises:
        InputError: there is none.
    """
    layers = scene["layers"]
    found = [one for one in scene["cameras"] if all(_rendered(run, layer, one).is_file() for layer in layers)]
    if not found:
        reason = "there are no renderings of the page's cameras"
        raise InputError(reason, where=run / RENDERS_FOLDER, remedy="make the run again, with views held out")
    return found


def described_by(model: str) -> list[str]:
    """The types of colour vision deficiency that a model of the simulation describes."""

    def describes(cvd: str) -> bool:
        try:
            check_simulation(cvd, 1.0, model)
        except InputError:
            return False
        return True

    return [cvd for cvd in CVD_TYPES if describes(cvd)]


def _draw(page: Any, picture: Path) -> None:
    """A screenshot with original and enhanced colours beside each other."""
    page.check("#wipes")
    page.wait_for_timeout(_SETTLING)
    with tempfile.TemporaryDirectory() as folder:
        page.screenshot(path=Path(folder, "page.png"))
        pixels = read_png(Path(folder, "page.png"))[..., :3]
    write_screenshot(picture, pixels)
    page.uncheck("#wipes")


def _rendered(run: Path, layer: str, camera: dict[str, Any]) -> Path:
    return run / RENDERS_FOLDER / layer / f"{camera['name']}.png"


def _pixels(page: Any, camera: dict[str, Any], **look: Any) -> np.ndarray:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "picture.png")
        file.write_bytes(picture_of(page, camera, **look))
        return read_png(file)[..., :3]


def _psnr(first: np.ndarray, second: np.ndarray) -> float:
    return float(10.0 * np.log10(255.0**2 / np.mean((first.astype(np.float64) - second) ** 2)))


def _difference(first: np.ndarray, second: np.ndarray) -> float:
    return float(delta_e_2000(image_to_tensor(first), image_to_tensor(second)).mean())


def main(arguments: list[str]) -> int:
    """Parse the command line and measure; returns the exit code."""
    parser = OneLineParser(prog="measure_viewer.py", description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, metavar="RUN", help="output folder of scripts/run.py")
    parser.add_argument("--picture", type=Path, metavar="FILE.png", help="a screenshot of the page")

    def work() -> None:
        options = parser.parse_args(arguments)
        print("\n".join(measure(options.run, options.picture)))

    return exit_code("measure_viewer.py", work)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
