"""Captures: photographs with known cameras, read from COLMAP, transforms.json or photographs alone.

Nothing is imported here, because Blender's Python has no pycolmap; `model` needs numpy alone.
"""
