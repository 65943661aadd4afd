"""What a run is asked to do: one validated object for all front ends. Standard library only."""

from __future__ import annotations

import math
import typing
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from .errors import InputError
from .untrusted import explained

CVD_TYPES = ("protan", "deutan", "tritan", "achromat")
SIMULATIONS = ("machado", "vienot", "brettel")
MODES = ("layers", "joint", "post")
DEVICES = ("auto", "cpu", "cuda")
ENGINES = ("cycles", "eevee")  # Workbench draws no Gaussians
ENHANCERS = ("cgan", "lut", "none")
WEIGHTS_SUFFIX = ".safetensors"
PLUGIN_PREFIX = "plugin:"
"""Before the name of an enhancer that an installed package offers; see docs/extending.md."""
_UPDATE = "update the program that sends them"
_MOST_EXACT = 2**53  # of whole numbers as floating-point ones
_TYPE_NAMES: Mapping[type, str] = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "text",
    type(None): '"auto"',
}

MIN_SIZE = 32  # pixels of the longer side; below that SSIM's 11-pixel window sees little else than its own border


@dataclass(frozen=True)
class Layer:
    """A colour layer: the scene enhanced for one kind of colour vision.

    Attributes:
        cvd: one of `CVD_TYPES`.
        severity: 0 (normal vision) to 1 (dichromat).
    """

    cvd: str
    severity: float

    @property
    def name(self) -> str:
        """The layer's name in files and reports, e.g. ``deutan-1.0`` or ``protan-0.65``."""
        text = f"{self.severity:g}"
        return f"{self.cvd}-{text if '.' in text or 'e' in text else text + '.0'}"

    @classmethod
    def from_name(cls, name: str) -> Layer:
        """The layer that is called `name`, with the severity as it is written there.

        Raises:
            ValueError: the severity is no number.
        """
        cvd, _, severity = name.partition("-")  # the first one: the exponent of 1e-05 has another
        return cls(cvd, float(severity))


@dataclass(frozen=True)
class Settings:
    """The options of ``scripts/run.py`` (design: "Command line"); `None` means "decide automatically".

    Attributes:
        capture: the capture folder.
        out: the output folder.
        layers: the colour layers to make, in order, without repeats.
        simulation: model behind the CVD simulation.
        strength: 0 (leave as is) to 1 (full enhancement).
        enhancer: one of `ENHANCERS`, the path of a .safetensors file, or `PLUGIN_PREFIX` and a name.
        mode: how colour and geometry are fitted.
        iterations: optimisation steps of the geometry stage.
        gaussians: upper bound of their number.
        sh_degree: degree of the spherical harmonics of the original colours.
        max_size: longer side of the training images in pixels.
        holdout: every Nth view is kept for testing; 0 keeps none.
        device: "auto", "cpu" or "cuda".
        seed: of everything random.
        refine_poses: whether to correct cameras that are a little off; those that are good stay as given. None does it
            where the mode can.
        turntable: pictures of a turn around the subject, of each layer; 0 renders none.
        engine: Blender's render engine for the turntable; stills are by Cycles.
        blend: whether to build scene.blend and render stills.
        resume: whether to add to a finished run.
        sfm: whether to estimate cameras when the folder has none.
    """

    capture: str
    out: str
    layers: tuple[Layer, ...] = (Layer("deutan", 1.0),)
    simulation: str = "machado"
    strength: float = 1.0
    enhancer: str = "lut"
    mode: str = "layers"
    iterations: int = 5000
    gaussians: int | None = None
    sh_degree: int | None = None
    max_size: int | None = None
    holdout: int = 8
    device: str = "auto"
    seed: int = 0
    refine_poses: bool | None = None
    turntable: int = 0
    engine: str = "cycles"
    blend: bool = True
    resume: bool = False
    sfm: bool = False

    def __post_init__(self) -> None:
        _check(bool(self.capture), "no capture folder is given", "CAPTURE", "name a folder of photographs with cameras")
        _check(bool(self.out), "no output folder is given", "--out", "name a folder to write to")
        _check(len(self.layers) > 0, "no colour layer is asked for", "--cvd", "give at least one type")
        for layer in self.layers:
            _one_of(layer.cvd, CVD_TYPES, "--cvd")
            _within(layer.severity, 0.0, 1.0, "--severity")
        names = [layer.name for layer in self.layers]
        _check(
            len(set(names)) == len(names),
            f"'{', '.join(names)}' names a layer twice",
            "--cvd",
            "ask for each layer once",
        )
        _one_of(self.simulation, SIMULATIONS, "--simulation")
        _within(self.strength, 0.0, 1.0, "--strength")
        _check(
            is_enhancer(self.enhancer),
            f"'{self.enhancer}' is not known",
            "--enhancer",
            f"use one of {', '.join(ENHANCERS)}, or a {WEIGHTS_SUFFIX} file that train_enhancer.py made",
        )
        _one_of(self.mode, MODES, "--mode")
        _at_least(self.iterations, 1, "--iterations")
        _at_least(self.gaussians, 1, "--gaussians")
        if self.sh_degree is not None:
            _one_of(self.sh_degree, (0, 1, 2, 3), "--sh-degree")
        _check(
            self.mode != "joint" or not self.sh_degree,
            "colours that enhanced views are fitted to jointly are the same from every side",
            "--sh-degree",
            "use degree 0, or --mode layers",
        )
        _check(
            self.mode != "joint" or not self.refine_poses,
            "cameras are not corrected when geometry and colours are fitted together",
            "--refine-poses",
            "leave it out, or use --mode layers",
        )
        _at_least(self.max_size, MIN_SIZE, "--max-size")
        _check(
            self.holdout == 0 or self.holdout >= 2,
            f"{self.holdout} would keep every view for testing",
            "--holdout",
            "give 0 for none, or 2 and more",
        )
        _at_least(self.holdout, 0, "--holdout")
        _one_of(self.device, DEVICES, "--device")
        _within(self.seed, 0, 2**31 - 1, "--seed")
        _at_least(self.turntable, 0, "--turntable")
        _one_of(self.engine, ENGINES, "--engine")
        _check(self.turntable != 1, "one picture is no turn", "--turntable", "give 2 or more, or 0 for none")
        _check(self.blend or not self.turntable, "Blender renders it", "--turntable", "leave out --no-blend")

    @property
    def corrects_poses(self) -> bool:
        """Whether cameras that are off will be corrected."""
        return self.mode != "joint" if self.refine_poses is None else self.refine_poses

    @property
    def checks_lens(self) -> bool:
        """Whether it will be looked at, and corrected, if the cameras' focal length is off; every mode can do that."""
        return self.refine_poses is not False

    def to_dict(self) -> dict[str, Any]:
        """A JSON-ready dictionary; `from_dict` reads it back."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Settings:
        """The settings of `to_dict`.

        Raises:
            InputError: an unknown key or an unusable value.
        """
        unknown = sorted(set(values) - {field.name for field in fields(cls)})
        _check(not unknown, f"unknown settings {', '.join(unknown)}", "settings", _UPDATE)
        typed: dict[str, Any] = {
            name: typed_value(cls, name, value) for name, value in values.items() if name != "layers"
        }
        try:
            layers = tuple(Layer(str(layer["cvd"]), float(layer["severity"])) for layer in values.get("layers", ()))
            return cls(**{**typed, "layers": layers} if "layers" in values else typed)
        except (TypeError, KeyError, ValueError, OverflowError) as error:
            raise InputError(f"unusable settings{explained(error)}", remedy=_UPDATE) from None


def typed_value(owner: type, name: str, value: Any) -> Any:
    """`value` as the field `name` of the dataclass `owner` wants it; whole numbers also stand for others.

    Raises:
        InputError: it is of another type.
    """
    hint = typing.get_type_hints(owner)[name]
    allowed = typing.get_args(hint) or (hint,)
    if float in allowed and type(value) is int and abs(value) <= _MOST_EXACT:
        return float(value)
    if type(value) not in allowed:
        remedy = f"give {' or '.join(_TYPE_NAMES[one] for one in allowed)}"
        raise InputError(f"{repr(value)[:40]} is unusable", where=f"--{name.replace('_', '-')}", remedy=remedy)
    return value


def is_enhancer(name: str) -> bool:
    """Whether `name` is one of `ENHANCERS` or names a file of weights or a plug-in, which may still be missing."""
    is_plugin = name.startswith(PLUGIN_PREFIX) and name.removeprefix(PLUGIN_PREFIX).isidentifier()
    return name in ENHANCERS or name.endswith(WEIGHTS_SUFFIX) or is_plugin


def _check(condition: bool, what: str, where: str, remedy: str) -> None:
    if not condition:
        raise InputError(what, where=where, remedy=remedy)


def _one_of(value: Any, allowed: tuple[Any, ...], option: str) -> None:
    _check(value in allowed, f"'{value}' is not known", option, "use one of " + ", ".join(map(str, allowed)))


def _within(value: float, low: float, high: float, option: str) -> None:
    _check(
        math.isfinite(value) and low <= value <= high,
        f"{value:g} is out of range",
        option,
        f"give a number from {low:g} to {high:g}",
    )


def _at_least(value: int | None, low: int, option: str) -> None:
    _check(value is None or value >= low, f"{value} is too small", option, f"give {low} or more")
