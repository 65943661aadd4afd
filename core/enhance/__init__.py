"""Recolours photographs so that people with a colour vision deficiency can tell apart what others can."""

from .cgan import CganEnhancer
from .enhancer import (
    Enhancer,
    IdentityEnhancer,
    LutEnhancer,
    SceneEnhancer,
    enhance_bytes,
    enhance_finite,
    learns,
    warn_not_finite,
)
from .lut import ColorLut
from .registry import make_enhancer
from .scene.enhancer import SceneNetworkEnhancer

__all__ = [
    "CganEnhancer",
    "ColorLut",
    "Enhancer",
    "IdentityEnhancer",
    "LutEnhancer",
    "SceneEnhancer",
    "SceneNetworkEnhancer",
    "enhance_bytes",
    "enhance_finite",
    "learns",
    "make_enhancer",
    "warn_not_finite",
]
