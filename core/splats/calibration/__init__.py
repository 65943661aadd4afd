"""Corrections of a capture's cameras: poses, exposure and, with `training.lens`, focal length."""
