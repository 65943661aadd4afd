"""What a training run has to say at its end."""

from __future__ import annotations

from ...runtime.protocol import Reporter
from ..calibration.corrections import ViewCorrections


def warn(reporter: Reporter, steps: int, skipped: int, corrections: ViewCorrections) -> None:
    """Report steps that were skipped, of so many, and cameras that were corrected."""
    if skipped:
        reporter.warning(
            "skipped-steps",
            f"{skipped} of {steps} steps gave numbers that are not finite and were skipped, entirely or for the "
            "Gaussians concerned",
        )
    if corrections.poses_were_off:
        reporter.warning(
            "cameras-corrected",
            f"the camera poses were about {corrections.pose_motion:.1f} pixels off and were corrected along with the "
            "scene; a better calibration may make it sharper",
        )
