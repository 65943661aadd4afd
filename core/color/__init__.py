"""Colour: vision deficiencies, colour spaces, differences and metrics.

`matrices`, `machado2009` and `srgb` need numpy alone, the other modules torch. Nothing is imported here, because
Blender's Python has no torch.
"""
