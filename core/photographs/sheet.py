"""sheet.html: every photograph before and after, as normal vision and as the observer see it, in one file."""

from __future__ import annotations

import base64
import html
import math
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import IO
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from ..capture.images import downscale_with_alpha, fit_size
from ..color.simulation import Observer, simulate
from ..color.spaces import image_to_tensor, tensor_to_image
from ..files.images import to_bytes, write_jpeg
from .scores import PhotographScores

_THUMBNAIL = 400  # pixels of the longer side; sharp at the column's width on common displays
_JPEG_QUALITY = 85  # about 25 kB a picture

_STYLE = """
:root { color-scheme: light dark; --line: #8884; --soft: #8881; }
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 1400px; padding: 0 1rem; }
h1 { font-size: 1.5rem; margin: 0; } p.lead { margin: .2rem 0 1rem; opacity: .75; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; margin: .6rem 0 2rem; }
th, td { text-align: right; padding: .25rem .7rem; border-bottom: 1px solid var(--line); }
th:first-child, td:first-child { text-align: left; } thead th { border-bottom-width: 2px; }
section { border-top: 1px solid var(--line); padding: 1rem 0 1.4rem; content-visibility: auto;
  contain-intrinsic-size: auto 360px; }
h2 { font-size: 1.05rem; margin: 0; overflow-wrap: anywhere; } section p { margin: .1rem 0 .7rem; font-size: .85rem;
  opacity: .8; }
.four { display: grid; grid-template-columns: repeat(4, 1fr); gap: .7rem; align-items: start; }
@media (max-width: 760px) { .four { grid-template-columns: repeat(2, 1fr); } }
figure { margin: 0; } figcaption { font-size: .82rem; opacity: .8; margin-top: .25rem; }
a { color: inherit; } img { width: 100%; height: auto; display: block; border-radius: 3px; background: var(--soft); }
"""


class Sheet:
    """Collects the photographs of a run and writes the page when it is complete.

    Pictures are embedded, so that the page can be moved and mailed; they wait in a temporary file, not in memory.

    Args:
        observer: for whom the photographs were enhanced.
        enhancer: its name, for the heading.
    """

    def __init__(self, observer: Observer, enhancer: str) -> None:
        self._observer, self._enhancer = observer, enhancer
        self._sections: IO[str] = tempfile.TemporaryFile("w+", encoding="utf-8")  # noqa: SIM115 - closed in __exit__

    def __enter__(self) -> Sheet:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._sections.close()

    def add(
        self,
        original: NDArray[np.uint8],
        enhanced: NDArray[np.uint8],
        alpha: NDArray[np.uint8] | None,
        scores: PhotographScores,
        scratch: Path,
    ) -> None:
        """Add a photograph.

        Args:
            original, enhanced: (H, W, 3).
            alpha: (H, W) coverage or None; thumbnails stand on white.
            scores: its figures.
            scratch: a file that may be written and is removed again.
        """
        before, after = _thumbnail(original, alpha), _thumbnail(enhanced, alpha)
        cvd = self._observer.cvd
        pictures = (
            ("before", before),
            ("after", after),
            (f"before, as {cvd} vision sees it", self._seen(before)),
            (f"after, as {cvd} vision sees it", self._seen(after)),
        )
        figures = "".join(_figure(_embed(image, scratch), image.shape, caption) for caption, image in pictures)
        values = scores.figures
        facts = (
            f"{scores.width} × {scores.height} · contrast kept (CCPR) {_number(values['ccpr_input'])} → "
            f"{_number(values['ccpr_enhanced'])} · change ΔE00 {_number(values['naturalness_delta_e_2000'], 1)}"
        )
        self._sections.write(
            f"<section><h2><a href='{quote(scores.output)}'>{_escape(scores.file)}</a></h2>"
            f"<p>{_escape(facts)}</p><div class='four'>{figures}</div></section>\n"
        )

    def write(self, path: Path, means: Mapping[str, float], count: int) -> None:
        """Write the page: a table of the means of `count` photographs, then all of them."""
        observer = self._observer
        lead = (
            f"{count} photographs for {observer.cvd} vision of severity {observer.severity:g} "
            f"({observer.simulation}), enhancer {self._enhancer}"
        )
        with open(path, "w", encoding="utf-8") as page:
            page.write(
                "<!doctype html><html lang='en'><head><meta charset='utf-8'>"
                "<meta name='viewport' content='width=device-width, initial-scale=1'>"
                f"<title>cvdgs: enhanced photographs</title><style>{_STYLE}</style></head><body>"
                f"<h1>Enhanced photographs</h1><p class='lead'>{_escape(lead)}</p>{_table(means)}\n"
            )
            self._sections.seek(0)
            shutil.copyfileobj(self._sections, page)
            page.write("</body></html>\n")

    def _seen(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        observer = self._observer
        seen = simulate(image_to_tensor(image), observer.cvd, observer.severity, observer.simulation)
        return to_bytes(tensor_to_image(seen))


def _thumbnail(image: NDArray[np.uint8], alpha: NDArray[np.uint8] | None) -> NDArray[np.uint8]:
    size = fit_size(image.shape[1], image.shape[0], _THUMBNAIL)
    image, alpha = downscale_with_alpha(image, alpha, *size)
    if alpha is None:
        return image
    coverage = alpha[..., None].astype(np.float32) / 255.0
    return to_bytes((image / np.float32(255.0)) * coverage + (1.0 - coverage))


def _embed(image: NDArray[np.uint8], scratch: Path) -> str:
    """The image as a data URI."""
    write_jpeg(scratch, image, _JPEG_QUALITY)
    data = base64.b64encode(scratch.read_bytes()).decode("ascii")
    scratch.unlink()
    return f"data:image/jpeg;base64,{data}"


def _figure(source: str, shape: tuple[int, ...], caption: str) -> str:
    text = _escape(caption)
    return (
        f"<figure><img alt='{text}' loading='lazy' decoding='async' width='{shape[1]}' height='{shape[0]}' "
        f"src='{source}'><figcaption>{text}</figcaption></figure>"
    )


def _table(means: Mapping[str, float]) -> str:
    rows = (
        ("contrast kept (CCPR, τ = 6)", "ccpr"),
        ("contrast kept, mean over τ", "ccpr_mean"),
        ("contrast kept between any two places", "ccpr_global"),
        ("contrast that was there before (CCFR)", "ccfr"),
        ("SSIM, photograph to simulated", "ssim_simulated"),
    )
    body = "".join(
        f"<tr><td>{name}</td><td>{_number(means[f'{key}_input'])}</td><td>{_number(means[f'{key}_enhanced'])}</td></tr>"
        for name, key in rows
    )
    natural = (
        ("closeness to the photograph: SSIM", _number(means["naturalness_ssim"])),
        ("PSNR in dB", _number(means["naturalness_psnr"], 1)),
        ("mean ΔE00", _number(means["naturalness_delta_e_2000"], 2)),
    )
    body += "".join(f"<tr><td>{name}</td><td>–</td><td>{value}</td></tr>" for name, value in natural)
    head = "<tr><th>mean of the photographs</th><th>before</th><th>after</th></tr>"
    return f"<table><thead>{head}</thead><tbody>{body}</tbody></table>"


def _number(value: float, digits: int = 3) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "–"


def _escape(text: str) -> str:
    # A file's name may hold bytes that are no UTF-8.
    return html.escape(text.encode("utf-8", "backslashreplace").decode("utf-8"))
