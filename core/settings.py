"""What a run is asked to do: one validated object for all front ends. Standard library only.

Each field of `Settings` carries an `Option`: what it means, its range, and where it may be given. The command lines,
``--resume``, batch files and the panel are made from these.
"""

from __future__ import annotations

import math
import typing
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from .errors import InputError, abbreviated
from .files.untrusted import explained
from .scale_reference import metres_of_points, tag_side_of

CVD_TYPES = ("protan", "deutan", "tritan", "achromat")
SIMULATIONS = ("machado", "vienot", "brettel")
MODES = ("layers", "joint", "post")
DEVICES = ("auto", "cpu", "cuda")
ENGINES = ("cycles", "eevee")  # Workbench draws no Gaussians
ENHANCERS = ("scene", "lut", "cgan", "none")
WEIGHTS_SUFFIX = ".safetensors"
PLUGIN_PREFIX = "plugin:"
"""Before the name of an enhancer that an installed package offers; see docs/extending.md."""
AUTO = "auto"
"""How front ends spell `None`, "decide automatically"."""
ESTIMATE, GIVEN = "estimate", "given"
"""Of `Settings.cameras`, besides `AUTO` and the path of a file."""
MIN_SIZE = 32  # pixels of the longer side; below that SSIM's 11-pixel window sees little else than its own border

_UPDATE = "update the program that sends them"
_MOST_EXACT = 2**53  # of whole numbers as floating-point ones
_TYPE_NAMES: Mapping[type, str] = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "text",
    type(None): f'"{AUTO}"',
}


@dataclass(frozen=True)
class Quality:
    """How fine a run becomes, by one word: in the panel, and for ``--quality``.

    Attributes:
        name: of the choice in Blender's data; in lower case that of the command line.
        label, description: as the user reads them.
        iterations: steps of the geometry stage.
        max_size: longer side of the training images in pixels.
    """

    name: str
    label: str
    description: str
    iterations: int
    max_size: int


QUALITIES = (
    Quality("DRAFT", "Draft", "A quick look: coarse, but the colours are right", 450, 320),
    Quality("STANDARD", "Standard", "For stills and turntables at the photographs' usual sizes", 3000, 640),
    Quality("FINE", "Fine", "Longer training on larger photographs", 7000, 960),
)


@dataclass(frozen=True)
class Option:
    """How a setting is asked for.

    Attributes:
        text: what it is, for the command line's help and the panel.
        label: its name in the panel; "" where the panel does not have it.
        metavar: what stands for its value in the command line's help; its choices where it has some.
        choices: the values it may have.
        low, high: the range of a number.
        in_batch: whether a batch file's ``[train]`` may hold it.
        fixed: whether it shaped a finished run, so that layers that ``--resume`` adds have to have the run's own value.
    """

    text: str
    label: str = ""
    metavar: str = ""
    choices: tuple[Any, ...] = ()
    low: float = -math.inf
    high: float = math.inf
    in_batch: bool = False
    fixed: bool = False


def _option(default: Any, text: str, *, trains: bool = False, fixed: bool = False, **others: Any) -> Any:
    """A field of `Settings`; `trains`: it may stand in a batch file."""
    return field(default=default, metadata={"option": Option(text, in_batch=trains, fixed=fixed, **others)})


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

    @classmethod
    def is_name(cls, text: str) -> bool:
        """Whether `text` is the name of a layer that a run can have, as the run writes it."""
        try:
            layer = cls.from_name(text)
        except ValueError:
            return False
        return layer.cvd in CVD_TYPES and 0.0 <= layer.severity <= 1.0 and layer.name == text


@dataclass(frozen=True)
class Settings:
    """The options of ``scripts/run.py`` (docs/command-line.md); `None` means "decide automatically".

    Raises (on construction):
        InputError: a value is out of range, or values do not go together.
    """

    capture: str
    out: str
    layers: tuple[Layer, ...] = (Layer("deutan", 1.0),)
    """The colour layers to make, in order, without repeats."""
    simulation: str = _option(
        "machado", "model behind the CVD simulation", label="Model", choices=SIMULATIONS, trains=True, fixed=True
    )
    strength: float = _option(
        1.0,
        "0 leaves the colours as they are, 1 enhances them fully",
        label="Strength",
        metavar="0..1",
        low=0.0,
        high=1.0,
        trains=True,
    )
    enhancer: str = _option(
        "scene", "|".join(ENHANCERS) + f"|FILE{WEIGHTS_SUFFIX}|{PLUGIN_PREFIX}NAME", metavar="NAME", trains=True
    )
    change_budget: float | None = _option(
        None,
        "mean ΔE00 that --enhancer scene and cgan may change colours by",
        metavar="DELTA_E",
        low=0.1,
        high=20.0,
        trains=True,
    )
    fit: int = _option(
        25,
        "steps that fit the network which --enhancer cgan predicts; 0 corrects the prediction by two quick steps",
        metavar="N",
        low=0,
        high=1000,
        trains=True,
    )
    mode: str = _option("layers", "how geometry and colours are fitted", choices=MODES, trains=True, fixed=True)
    iterations: int = _option(5000, "optimisation steps of the geometry", metavar="N", low=1, trains=True, fixed=True)
    gaussians: int | None = _option(None, "the most Gaussians to fit", metavar="N", low=1, trains=True, fixed=True)
    sh_degree: int | None = _option(
        None,
        "degree of the spherical harmonics of the original colours",
        metavar="0..3",
        low=0,
        high=3,
        trains=True,
        fixed=True,
    )
    max_size: int | None = _option(
        None, "longer side of the training images", metavar="PIXELS", low=MIN_SIZE, trains=True, fixed=True
    )
    holdout: int = _option(
        8, "keep every Nth view for testing; 0 keeps none", metavar="N", low=0, trains=True, fixed=True
    )
    device: str = _option("auto", "compute device of training", choices=DEVICES, trains=True)
    seed: int = _option(0, "random seed", metavar="N", low=0, high=2**31 - 1, trains=True, fixed=True)
    refine_poses: bool | None = _option(
        None,
        "correct camera poses and the focal length where they are off; good ones stay as given",
        label="Correct Cameras",
        trains=True,
        fixed=True,
    )
    turntable: int = _option(0, "frames of a turntable of each layer; 0 renders none", metavar="FRAMES", low=0)
    engine: str = _option("cycles", "render engine of the turntable", choices=ENGINES)
    blend: bool = _option(True, "write scene.blend and stills with Blender", label="Scene File and Stills")
    resume: bool = _option(
        False, "add the layers to the finished run in DIR, or go on with one that was broken off there"
    )
    scale: str = _option(
        "",
        'two points of the capture\'s world and the metres between them, "x,y,z x,y,z 2.4"; or the side in metres '
        "of printed tags that the photographs show, tag:0.15",
        metavar="REFERENCE",
        fixed=True,
    )
    clean: float = _option(
        0.0,
        "removes Gaussians that look like floaters: 0 none, 0.5 the clear cases, 1 every suspicion",
        metavar="0..1",
        low=0.0,
        high=1.0,
        trains=True,
        fixed=True,
    )
    cameras: str = _option(
        AUTO,
        "auto|estimate|given|FILE; FILE: a COLMAP model's folder or a transforms.json",
        metavar="CAMERAS",
        trains=True,
        fixed=True,
    )
    sfm: bool = _option(False, "the same as --cameras estimate", trains=True, fixed=True)

    def __post_init__(self) -> None:
        _check(bool(self.capture), "no capture is given", "CAPTURE", "name a folder of photographs or a video")
        _check(bool(self.out), "no output folder is given", "--out", "name a folder to write to")
        _check(len(self.layers) > 0, "no colour layer is asked for", "--cvd", "give at least one type")
        for layer in self.layers:
            check_layer(layer)
        names = [layer.name for layer in self.layers]
        distinct = len(set(names)) == len(names)
        _check(distinct, f"'{', '.join(names)}' names a layer twice", "--cvd", "ask for each layer once")
        for name in OPTIONS:
            check_option(name, getattr(self, name))
        _check(bool(self.cameras), "nothing is given", "--cameras", f"use {AUTO}, {ESTIMATE}, {GIVEN} or a file")
        _check(
            not self.sfm or self.cameras in (AUTO, ESTIMATE),
            "--cameras says something else",
            "--sfm",
            "leave one of them out",
        )
        _check(
            is_enhancer(self.enhancer),
            f"'{self.enhancer}' is not known",
            "--enhancer",
            f"use one of {', '.join(ENHANCERS)}, or a {WEIGHTS_SUFFIX} file of a run or of train_enhancer.py",
        )
        _check(
            self.mode != "joint" or not self.sh_degree,
            "mode joint has no view-dependent colours",
            "--sh-degree",
            "use degree 0, or --mode layers",
        )
        _check(
            self.mode != "joint" or not self.refine_poses,
            "mode joint does not correct cameras",
            "--refine-poses",
            "leave it out, or use --mode layers",
        )
        _check(
            self.holdout != 1,
            "1 would keep every view for testing",
            "--holdout",
            "give 0 for none, or 2 and more",
        )
        metres_of_points(self.scale)
        _check(self.turntable != 1, "one picture is no turn", "--turntable", "give 2 or more, or 0 for none")
        _check(self.blend or not self.turntable, "Blender renders it", "--turntable", "leave out --no-blend")

    @property
    def cameras_from(self) -> str:
        """Where the cameras come from, as `capture.reader.read_capture` takes it."""
        return ESTIMATE if self.sfm else self.cameras

    @property
    def metres_per_unit(self) -> float | None:
        """How long a unit of the capture's world is; None where it is not known before the capture is read."""
        return metres_of_points(self.scale)

    @property
    def tag_side(self) -> float | None:
        """Of printed tags in the photographs, in metres; None where the scale does not come from any."""
        return tag_side_of(self.scale)

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
        unknown = sorted(set(values) - {entry.name for entry in fields(cls)})
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
        raise InputError(f"{abbreviated(value)} is unusable", where=flag(name), remedy=remedy)
    return value


def is_enhancer(name: str) -> bool:
    """Whether `name` is one of `ENHANCERS` or names a file of weights or a plug-in, which may still be missing."""
    is_plugin = name.startswith(PLUGIN_PREFIX) and name.removeprefix(PLUGIN_PREFIX).isidentifier()
    return name in ENHANCERS or name.endswith(WEIGHTS_SUFFIX) or is_plugin


OPTIONS: Mapping[str, Option] = {
    entry.name: entry.metadata["option"] for entry in fields(Settings) if "option" in entry.metadata
}
"""How each setting is asked for, by its field's name; capture, output folder and layers have their own ways."""


def flag(name: str) -> str:
    """The command line's option of a setting, e.g. ``--sh-degree``."""
    return f"--{name.replace('_', '-')}"


def check_layer(layer: Layer) -> None:
    """Raise `InputError` where a layer is for no kind of colour vision."""
    _one_of(layer.cvd, CVD_TYPES, "--cvd")
    _within(layer.severity, 0.0, 1.0, "--severity")


def check_option(name: str, value: Any) -> None:
    """Raise `InputError` where `value` is none of the choices, or out of the range, of one of `OPTIONS`."""
    option, where = OPTIONS[name], flag(name)
    if value is None:
        return
    if option.choices:
        _one_of(value, option.choices, where)
    if isinstance(value, int | float) and (option.low, option.high) != (-math.inf, math.inf):
        _within(value, option.low, option.high, where)


def _check(condition: bool, what: str, where: str, remedy: str) -> None:
    if not condition:
        raise InputError(what, where=where, remedy=remedy)


def _one_of(value: Any, allowed: tuple[Any, ...], option: str) -> None:
    _check(value in allowed, f"'{value}' is not known", option, "use one of " + ", ".join(map(str, allowed)))


def _within(value: float, low: float, high: float, option: str) -> None:
    accepted = f"give {low:g} or more" if high == math.inf else f"give a number from {low:g} to {high:g}"
    try:
        shown = f"{value:g}"
    except OverflowError:  # of a whole number that no floating-point one comes up to
        raise InputError("the number has too many digits", where=option, remedy="give a shorter one") from None
    _check(math.isfinite(value) and low <= value <= high, f"{shown} is out of range", option, accepted)
