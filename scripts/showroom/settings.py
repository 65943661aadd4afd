"""What a showroom capture is made of: the values that the command line and stress tests vary. Standard library only."""

from __future__ import annotations

from dataclasses import dataclass, field

from ...core.errors import InputError

SCENES = ("showroom", "room")
"""What can be photographed: a set from outside, and a shop that one walks around in."""

VARIANTS = ("deutan", "protan", "tritan")
"""The showrooms: each has the colours that this vision confuses."""


ROOM_CAMERAS = {"views": 200, "width": 640, "height": 480, "focal_length": 22.0}
"""Of `CameraSettings`, what is usual in the room: a telephone's wide lens."""


@dataclass(frozen=True)
class SceneSettings:
    """The set and its fabrics.

    Attributes:
        scene: which set, one of `SCENES`; satin and organza are in the showroom alone.
        variant: which showroom, one of `VARIANTS`.
        satin_roughness: microfacet roughness of the satin; about 0.15 is a mirror-like sheen, 1 is matt.
        sheer_opacity: share of light that the organza stops at normal incidence, 0 to 1.
        yarn_scale: multiplies the yarn widths of all fabrics; below 1 they get finer than a pixel.
        light: multiplies all light; 1 exposes white plaster at about 80 % of the display's range.
        cloth_detail: multiplies the resolution of cloth meshes, for quick tests.
    """

    scene: str = "showroom"
    variant: str = "deutan"
    satin_roughness: float = 0.36
    sheer_opacity: float = 0.42
    yarn_scale: float = 1.0
    light: float = 1.0
    cloth_detail: float = 1.0


@dataclass(frozen=True)
class CameraSettings:
    """Two rings of cameras about one target, in metres and degrees; azimuth 0 looks along +y. A walk has its own path.

    Attributes:
        views: number of photographs, shared equally between the rings.
        focal_length: in millimetres of a 36 mm wide sensor.
        ring_radii: horizontal distance from the target, one value a ring.
        ring_heights: height over the floor.
        half_arc: the rings run from minus to plus this azimuth.
    """

    views: int = 40
    width: int = 480
    height: int = 360
    focal_length: float = 36.0
    target: tuple[float, float, float] = (0.0, 0.3, 0.74)
    ring_radii: tuple[float, float] = (3.45, 3.2)
    ring_heights: tuple[float, float] = (1.1, 1.9)
    half_arc: float = 52.0


@dataclass(frozen=True)
class CaptureSettings:
    """One capture: the set, its cameras, and how it is photographed.

    Attributes:
        samples: Cycles samples a pixel; the denoiser does the rest (soft light needs few).
        seed: of everything random: cloth irregularities, render noise and the sparse points.
        jpeg_quality: 0 to 100.
        points: sparse points in `points.ply`.
        point_noise: standard deviation of their error, as a share of their depth; about that of SfM.
        depth_views: views that come with a depth map.
    """

    scene: SceneSettings = field(default_factory=SceneSettings)
    cameras: CameraSettings = field(default_factory=CameraSettings)
    samples: int = 8
    seed: int = 0
    jpeg_quality: int = 91
    points: int = 9000
    point_noise: float = 0.001
    depth_views: int = 6

    def check(self) -> None:
        """Raise `InputError` for values that no showroom can have."""
        if self.scene.variant not in VARIANTS:
            raise InputError(
                f"there is no showroom {self.scene.variant!r}", where="--variant", remedy=f"use {' or '.join(VARIANTS)}"
            )
        limits = (
            ("--views", self.cameras.views, 2, 1000),
            ("--width", self.cameras.width, 8, 8192),
            ("--height", self.cameras.height, 8, 8192),
            ("--samples", self.samples, 1, 65536),
            ("--seed", self.seed, 0, 2**31 - 1),
            ("--points", self.points, 0, 1_000_000),
            ("--depth-views", self.depth_views, 0, 1000),
            ("--satin-roughness", self.scene.satin_roughness, 0.0, 1.0),
            ("--sheer-opacity", self.scene.sheer_opacity, 0.0, 1.0),
            ("--yarn-scale", self.scene.yarn_scale, 0.05, 20.0),
            ("--light", self.scene.light, 0.0, 100.0),
            ("--cloth-detail", self.scene.cloth_detail, 0.05, 4.0),
        )
        for option, value, low, high in limits:
            if not low <= value <= high:  # also refuses NaN
                raise InputError(f"{value:g} is out of range", where=option, remedy=f"give {low:g} to {high:g}")
