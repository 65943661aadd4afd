"""The pipeline without Blender: capture, colour, enhancement, Gaussian training, evaluation. Never imports bpy."""
