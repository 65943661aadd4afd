"""Colour: vision deficiencies, colour spaces, differences and metrics.

`arrangement`, `matrices`, `machado2009` and `srgb` need numpy only, the other modules torch. Nothing is imported here,
because Blender's Python does not have torch.
"""
