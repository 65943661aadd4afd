"""Recolours photographs so that people with a colour vision deficiency can tell apart what others can."""

from .cgan import CganEnhancer
from .enhancer import Enhancer, IdentityEnhancer, LutEnhancer
from .lut import ColorLut
from .registry import ENHANCERS, is_enhancer, make_enhancer

__all__ = [
    "ENHANCERS",
    "CganEnhancer",
    "ColorLut",
    "Enhancer",
    "IdentityEnhancer",
    "LutEnhancer",
    "is_enhancer",
    "make_enhancer",
]
