"""Recolours photographs so that people with a colour vision deficiency can tell apart what others can."""

from .cgan import CganEnhancer
from .enhancer import Enhancer, IdentityEnhancer, LutEnhancer, SceneEnhancer
from .lut import ColorLut
from .registry import make_enhancer

__all__ = ["CganEnhancer", "ColorLut", "Enhancer", "IdentityEnhancer", "LutEnhancer", "SceneEnhancer", "make_enhancer"]
