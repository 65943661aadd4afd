"""Recolours photographs so that people with a colour vision deficiency can tell apart what others can."""

from .enhancer import ENHANCERS, Enhancer, IdentityEnhancer, LutEnhancer, make_enhancer
from .lut import ColorLut

__all__ = ["ENHANCERS", "ColorLut", "Enhancer", "IdentityEnhancer", "LutEnhancer", "make_enhancer"]
