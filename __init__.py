"""cvdgs: CVD-friendly 3D content from multi-view images, as a Blender extension and a headless pipeline.

The repository root is both the Blender extension package and the Python package ``cvdgs``. Importing it must stay free
of side effects and of bpy, torch and Warp: the worker, Blender and the command line all start here.
"""

__version__ = "0.1.0"


def register() -> None:
    """Register the Blender extension (called by Blender)."""
    from . import cvdgs_addon

    cvdgs_addon.register()


def unregister() -> None:
    """Undo `register` (called by Blender)."""
    from . import cvdgs_addon

    cvdgs_addon.unregister()
