"""What an installed package offers as an enhancer, with its faults named after it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..runtime.protocol import Reporter
from .pairs import Alphas, Images

_ASK = "ask its authors, or use another enhancer"
_MOST_MEAN = 2.0  # of an image in [0, 1], however far some of it lies outside


class PluginEnhancer:
    """An `Enhancer` of a package: it gets copies of what we go on with, and what it gives is looked at.

    Args:
        name: what `--enhancer` calls it.
        make: of the enhancer, e.g. its class.
        who: the observer, strength and seed that it is made with.

    Raises (as do all calls):
        InputError: it cannot be made or fails, or what it gives is no image in [0, 1] of the photograph's size.
    """

    def __init__(self, name: str, make: Callable[[], Callable[..., Any]], **who: Any) -> None:
        self.name = name
        with self._blamed("cannot be loaded"):
            self._enhancer = make()(**who)

    def fit(self, images: Images, reporter: Reporter | None = None, *, alphas: Alphas = None) -> None:
        """See `Enhancer.fit`."""
        copies = None if alphas is None else [None if alpha is None else alpha.copy() for alpha in alphas]
        with self._blamed("cannot be fitted"):
            self._enhancer.fit([image.copy() for image in images], reporter, alphas=copies)

    def __call__(self, image: NDArray) -> NDArray[np.float32]:
        """See `Enhancer.__call__`; colours that are not finite stay so."""
        with self._blamed("fails"):
            enhanced = np.asarray(self._enhancer(image.copy()))
        if enhanced.shape != image.shape:
            raise self._fault(f"gives an image of the shape {enhanced.shape}, not {image.shape}")
        if enhanced.dtype.kind != "f":
            raise self._fault(f"gives colours of the type {enhanced.dtype}, not numbers from 0 to 1")
        finite = np.isfinite(enhanced)
        if finite.any() and enhanced.mean(where=finite) > _MOST_MEAN:
            raise self._fault("gives colours that are not from 0 to 1")
        return enhanced.astype(np.float32, copy=False)

    @contextmanager
    def _blamed(self, what: str) -> Iterator[None]:
        try:
            yield
        except InputError:
            raise
        except Exception as error:  # others' code may raise anything
            raise self._fault(f"{what} ({type(error).__name__}: {error})") from None

    def _fault(self, what: str) -> InputError:
        return InputError(f"{self.name!r} {what}", where="--enhancer", remedy=_ASK)
