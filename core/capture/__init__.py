"""Captures: photographs with known cameras, read from COLMAP, transforms.json or photographs alone."""

from ..pinhole import PinholeCamera
from .model import Capture, CaptureSummary, CaptureWarning, View
from .normalised import write_cameras, write_capture
from .reader import inspect_capture, read_capture

__all__ = [
    "Capture",
    "CaptureSummary",
    "CaptureWarning",
    "PinholeCamera",
    "View",
    "inspect_capture",
    "read_capture",
    "write_cameras",
    "write_capture",
]
