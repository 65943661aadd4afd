"""File formats of Gaussians. numpy only: Blender's Python imports this."""
