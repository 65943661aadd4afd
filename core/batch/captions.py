"""What pictures of turntables are called, on videos, contact sheets and the page. Standard library only."""

from __future__ import annotations

from ..run_files import ORIGINAL


def vision(observer: str) -> str:
    """An observer, by a layer's name, in words: ``deutan vision``, ``protan vision of severity 0.6``."""
    cvd, _, severity = observer.partition("-")
    return f"{cvd} vision" if severity == "1.0" else f"{cvd} vision of severity {severity}"


def seen_by(what: str, observer: str) -> str:
    """What the picture `what` is called where it shows what an observer sees of it."""
    return f"{what}, as {vision(observer)} sees it"


def beside_each_other(layer: str, observer: str) -> tuple[str, str]:
    """Captions of a layer's pictures and, beside them, of what an observer sees of them."""
    what = "Original" if layer == ORIGINAL else "Enhanced"
    return what, seen_by(what, observer)
