"""How long the stages of a run take on a reference machine, by its photographs and steps. Standard library only."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class TimeModel:
    """Seconds on the reference machine by stage, fitted to short runs on 20 and 40 small views, and loosely to one on
    292 photographs of a room and to the demo's, both of a slower machine.

    "A view" is a megapixel of one, at the size that is trained on; "views" are how many there are.

    Attributes:
        start: of the processes.
        open, read: of looking at the capture, and a megapixel of photographs, at their full size, besides.
        cameras: of estimating cameras, whatever they are.
        cameras_view, cameras_pixels: each of the photographs, and a megapixel of all of them, at the size in which
            features are sought.
        cameras_pair, cameras_pair_pixels: each pair that is matched, and a megapixel of one of its photographs.
        check, check_view: of looking whether the cameras' focal length is right, and a view besides.
        enhance, enhance_views, enhance_pixels: of fitting the colours of a layer, and each of the views and a megapixel
            of all of them besides.
        train_views, train_pixels: of training, each of the views and a megapixel of all of them, whatever the steps.
        step_view: of a training step, a view.
        layer, layer_view: of fitting a layer to the geometry, and a view besides.
        layer_few: views; with more of them the layer's steps grow in proportion.
        evaluate_views, evaluate_pixels: of measuring, each of the views and a megapixel of all.
        blender: of the scene file and stills.
    """

    start: float = 3.8
    open: float = 0.25
    read: float = 0.2
    cameras: float = 1.5
    cameras_view: float = 0.1
    cameras_pixels: float = 0.55
    cameras_pair: float = 0.005
    cameras_pair_pixels: float = 0.04
    check: float = 2.55
    check_view: float = 88.0
    enhance: float = 6.2
    enhance_views: float = 0.11
    enhance_pixels: float = 0.63
    train_views: float = 0.05
    train_pixels: float = 2.4
    step_view: float = 0.305
    layer: float = 0.2
    layer_view: float = 112.0
    layer_few: float = 110.0
    evaluate_views: float = 0.066
    evaluate_pixels: float = 0.67
    blender: float = 24.0

    def estimation(self, photographs: int, megapixels: float, pairs: int) -> float:
        """Of estimating the cameras of photographs of so many megapixels each, of which so many pairs are matched."""
        found = self.cameras_view + self.cameras_pixels * megapixels
        matched = self.cameras_pair + self.cameras_pair_pixels * megapixels
        return self.cameras + photographs * found + pairs * matched

    def stages(
        self,
        iterations: int,
        max_size: int,
        views: int,
        width: int,
        height: int,
        *,
        adds_layer: bool,
        scene_file: bool = False,
        layers: int = 1,
    ) -> dict[str, float]:
        """Of a run on `views` photographs of `width` × `height` pixels.

        Args:
            iterations: steps of the geometry.
            max_size: longer side in pixels that is trained on.
            adds_layer: to a finished run, whose size of views is not known here and taken to be `max_size`.
            scene_file: whether Blender writes a scene file and stills.
            layers: how many observers there are.
        """
        scale = min(1.0, max_size / max(width, height, 1))
        full = width * height / 1e6
        view = full * scale * scale
        pixels = view * views
        check = 0.0 if adds_layer else self.check + self.check_view * view
        seconds = {
            "start": self.start,
            "capture": self.open + self.read * full * views + check,
            "enhance": self.enhance + self.enhance_views * views + self.enhance_pixels * pixels,
            "geometry": self.train_views * views + self.train_pixels * pixels + iterations * self.step_view * view,
            "layers": self.layer + self.layer_view * view * max(1.0, views / self.layer_few),
            "evaluate": self.evaluate_views * views + self.evaluate_pixels * pixels,
            "blender": self.blender,
        }
        seconds |= {stage: layers * seconds[stage] for stage in ("enhance", "layers", "evaluate")}
        left_out = {"geometry": adds_layer, "blender": not scene_file}
        return {stage: value for stage, value in seconds.items() if not left_out.get(stage)}


TIME_MODEL = TimeModel()
