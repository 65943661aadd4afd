"""Colour: vision deficiencies, colour spaces, differences and metrics.

`matrices` and `machado2009` need numpy alone, the other modules torch. Nothing is imported here, because Blender's
Python has no torch.
"""
