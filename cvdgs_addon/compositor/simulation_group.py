"""The compositor node group "CVD simulation": the simulation S of `core.color` as nodes, also as an asset.

The matrices act on linear light with Rec.709 primaries. What comes in is either

* **scene-linear**: light in the file's working space (Rec.709, Rec.2020 or ACEScg), converted there and back, clipped
  neither below nor above, because the view transform does that; or
* **display-referred**: sRGB values as they go to the screen, clipped as a screen clips, decoded and encoded.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import StrEnum
from pathlib import Path

import bpy

from ...core.errors import InputError
from ..scene.nodes import NodeWriter, Value, add_input, new_group
from ..scene.remembered_settings import is_offered
from .part_groups import (
    ACHROMAT,
    BRETTEL,
    DICHROMATIC_TYPES,
    ROWS,
    ROWS_BELOW,
    SEPARATOR,
    SEVERITY,
    VIENOT,
    decoding_group,
    dichromat_group,
    encoding_group,
    machado_group,
)

GROUP_NAME = "CVD simulation"
DESCRIPTION = "What a picture looks like with a colour vision deficiency (Machado 2009, Viénot 1999, Brettel 1997)"

TYPE_NAMES = {"protan": "Protan", "deutan": "Deutan", "tritan": "Tritan", "achromat": "Achromat"}
MODEL_NAMES = {"machado": "Machado", "vienot": "Viénot", "brettel": "Brettel"}

_HAS_MENUS = bpy.app.version >= (5, 0)  # before, a whole number chooses
# Names in OpenColorIO configurations: Blender's, those of ACES 2.0 and of ACES 1.2.
_REC709 = ("Linear Rec.709", "Linear Rec.709 (sRGB)", "Utility - Linear - sRGB")
_OPAQUE = 1e-6  # the colour of a pixel with less alpha is emission, not premultiplied

Channels = tuple[Value, ...]
FILE_NAME = "CVD simulation.blend"
_TAGS = ("CVD", "colour blindness", "accessibility")


class Socket(StrEnum):
    """Inputs of the group."""

    IMAGE = "Image"
    TYPE = "Type"
    SEVERITY = "Severity"
    MODEL = "Model"
    DISPLAY_REFERRED = "Display Referred"
    WIPE = "Wipe"


def simulation_group() -> bpy.types.NodeTree:
    """The node group of this file, made when there is none."""
    existing = next((tree for tree in bpy.data.node_groups if is_simulation_group(tree)), None)
    return existing or build_simulation_group()


def is_simulation_group(tree: bpy.types.NodeTree | None) -> bool:
    """Whether `tree` is what `build_simulation_group` makes."""
    if tree is None or tree.bl_idname != "CompositorNodeTree" or not tree.name.startswith(GROUP_NAME):
        return False
    return {item.name for item in tree.interface.items_tree if item.in_out == "INPUT"} == set(Socket)


def build_simulation_group() -> bpy.types.NodeTree:
    """Make the node group, and those that it consists of.

    Raises:
        InputError: the colour configuration (the variable OCIO) has no linear Rec.709.
    """
    rec709 = _rec709()
    machado = {cvd: machado_group(cvd) for cvd in DICHROMATIC_TYPES}
    dichromats, decoding, encoding = dichromat_group(), decoding_group(), encoding_group()
    tree = new_group("CompositorNodeTree", GROUP_NAME)
    tree.description = DESCRIPTION
    _declare_sockets(tree)
    write = NodeWriter(tree)
    inputs = {socket.name: socket for socket in write.node("NodeGroupInput").outputs}
    types = _weights(write, inputs[Socket.TYPE], TYPE_NAMES)
    models = _weights(write, inputs[Socket.MODEL], MODEL_NAMES)
    matrices = _Matrices(write, types, models, inputs[Socket.SEVERITY], machado, dichromats)

    image, is_display = inputs[Socket.IMAGE], inputs[Socket.DISPLAY_REFERRED]
    *channels, alpha = _separated(write, image)
    # What colours were multiplied by: alpha, or 1 where there is none.
    coverage = write.sum(alpha, write.math("LESS_THAN", alpha, _OPAQUE))
    # A new node's spaces are the working space, which has a name of its own from 5.0 on only.
    scene_light = write.output("CompositorNodeConvertColorSpace", image, to_color_space=rec709)
    straight = (write.math("DIVIDE", channel, coverage) for channel in channels)
    display_light = _combined(write, _each(write, decoding, straight), alpha)
    light = write.output("CompositorNodeSwitch", is_display, scene_light, display_light)

    seen = matrices.applied(_separated(write, light)[:3])
    scene_seen = write.output("CompositorNodeConvertColorSpace", _combined(write, seen, alpha), from_color_space=rec709)
    encoded = (write.math("MULTIPLY", channel, coverage) for channel in _each(write, encoding, seen))
    result = write.output("CompositorNodeSwitch", is_display, scene_seen, _combined(write, encoded, alpha))
    write.node("NodeGroupOutput", _wiped(write, image, result, inputs[Socket.WIPE]))
    write.arrange()
    return tree


def _rec709() -> str:
    """What the colour configuration calls linear light with Rec.709 primaries."""
    for name in _REC709:
        if is_offered(bpy.data.scenes[0], "sequencer_colorspace_settings.name", name):
            return name
    remedy = "start Blender without the environment variable OCIO"
    raise InputError(f"the colour configuration has no {_REC709[0]}, which the simulation needs", remedy=remedy)


def choose(node: bpy.types.Node, socket: Socket, key: str) -> None:
    """Set `Socket.TYPE` or `Socket.MODEL` of a node that uses the group, e.g. to "deutan" or "machado"."""
    names = _names(socket)
    node.inputs[socket].default_value = names[key] if _HAS_MENUS else list(names).index(key)


def chosen(node: bpy.types.Node, socket: Socket) -> str:
    """The key that `choose` set."""
    value = node.inputs[socket].default_value
    return next(key for index, (key, name) in enumerate(_names(socket).items()) if value in (name, index))


def _names(socket: Socket) -> Mapping[str, str]:
    return TYPE_NAMES if socket is Socket.TYPE else MODEL_NAMES


def _declare_sockets(tree: bpy.types.NodeTree) -> None:
    tree.interface.new_socket(Socket.IMAGE, in_out="OUTPUT", socket_type="NodeSocketColor")
    add_input(tree, Socket.IMAGE, "NodeSocketColor", "The original picture")
    _declare_choice(tree, Socket.TYPE, "Which type of cones is missing or shifted")
    add_input(tree, Socket.SEVERITY, "NodeSocketFloat", "0 is normal vision, 1 is dichromacy",
              subtype="FACTOR", min_value=0.0, max_value=1.0, default_value=1.0)  # fmt: skip
    _declare_choice(tree, Socket.MODEL, "Published model; Viénot's has no tritan, so Brettel's is used there")
    add_input(
        tree,
        Socket.DISPLAY_REFERRED,
        "NodeSocketBool",
        "The picture holds display-referred sRGB values (view transform Raw); off: scene-linear light",
    )
    add_input(tree, Socket.WIPE, "NodeSocketFloat",
              "Fraction of the picture's width, from the left, that stays unchanged",
              subtype="FACTOR", min_value=0.0, max_value=1.0, default_value=0.0)  # fmt: skip


def _declare_choice(tree: bpy.types.NodeTree, socket: Socket, description: str) -> None:
    if _HAS_MENUS:
        add_input(tree, socket, "NodeSocketMenu", description)
        return
    names = _names(socket)
    numbers = ", ".join(f"{index} {name}" for index, name in enumerate(names.values()))
    add_input(tree, socket, "NodeSocketInt", f"{description}: {numbers}", min_value=0, max_value=len(names) - 1)


def _weights(write: NodeWriter, choice: bpy.types.NodeSocket, names: Mapping[str, str]) -> dict[str, Value]:
    """For each key 1 where it is chosen, else 0."""
    if not _HAS_MENUS:
        return {key: write.math("COMPARE", choice, float(index), 0.5) for index, key in enumerate(names)}
    switch = write.node("GeometryNodeMenuSwitch", data_type="FLOAT")
    switch.enum_items.clear()
    for name in names.values():
        switch.enum_items.new(name)
    write.feed(switch.inputs["Menu"], choice)
    declared = next(item for item in write.tree.interface.items_tree if item.name == choice.name)
    declared.default_value = next(iter(names.values()))  # only what feeds a menu switch knows its items
    return {key: switch.outputs[name] for key, name in names.items()}


class _Matrices:
    """The matrix for the chosen type, model and severity, and the one below Brettel's separator."""

    def __init__(
        self,
        write: NodeWriter,
        types: Mapping[str, Value],
        models: Mapping[str, Value],
        severity: Value,
        machado: Mapping[str, bpy.types.NodeTree],
        dichromats: bpy.types.NodeTree,
    ) -> None:
        self._write = write
        weights = {
            SEVERITY: severity,
            **{cvd: types[cvd] for cvd in DICHROMATIC_TYPES},
            ACHROMAT: types["achromat"],
            VIENOT: models["vienot"],
            BRETTEL: models["brettel"],
        }
        other = write.group(dichromats, **weights)
        # Machado et al. describe no achromatopsia.
        is_machado = write.math("MULTIPLY", models["machado"], write.math("SUBTRACT", 1.0, types["achromat"]))
        is_other = write.math("SUBTRACT", 1.0, is_machado)
        self._above: list[Value] = [write.vector_math("MULTIPLY", other[row], is_other) for row in ROWS]
        self._below: list[Value] = [write.vector_math("MULTIPLY", other[row], is_other) for row in ROWS_BELOW]
        self._separator = other[SEPARATOR]
        for cvd, tree in machado.items():
            rows, weight = write.group(tree, **{SEVERITY: severity}), write.math("MULTIPLY", is_machado, types[cvd])
            for sums in (self._above, self._below):
                sums[:] = [
                    write.vector_math("MULTIPLY_ADD", rows[name], weight, total)
                    for name, total in zip(ROWS, sums, strict=True)
                ]

    def applied(self, light: Channels) -> Channels:
        """The light that is seen."""
        write = self._write
        vector = write.combine(*light)
        is_below = write.math("LESS_THAN", write.vector_math("DOT_PRODUCT", self._separator, vector), 0.0)
        return tuple(
            write.mix("FLOAT", is_below, *(write.vector_math("DOT_PRODUCT", row, vector) for row in rows))
            for rows in zip(self._above, self._below, strict=True)
        )


def _each(write: NodeWriter, group: bpy.types.NodeTree, values: Iterable[Value]) -> Channels:
    return tuple(write.group(group, Value=value)["Value"] for value in values)


def _separated(write: NodeWriter, image: Value) -> Channels:
    """Red, green, blue and alpha."""
    return tuple(write.node("CompositorNodeSeparateColor", image, mode="RGB").outputs)


def _combined(write: NodeWriter, channels: Iterable[Value], alpha: Value) -> Value:
    return write.output("CompositorNodeCombineColor", *channels, alpha, mode="RGB")


def _wiped(write: NodeWriter, image: Value, simulated: Value, wipe: Value) -> Value:
    """`image` in the left part of the picture, `simulated` in the right one."""
    coordinates = write.output("CompositorNodeImageCoordinates", image, name="Normalized")
    is_right = write.math("GREATER_THAN", write.separate(coordinates)[0], wipe)
    return write.mix("RGBA", is_right, image, simulated)


def save_asset(folder: str | Path) -> Path:
    """Write the node group as an asset into `folder`; the open file stays as it is.

    Raises:
        InputError: the folder cannot be written.
    """
    folder = Path(folder)
    had_group = GROUP_NAME in bpy.data.node_groups
    group = simulation_group()
    had_asset = group.asset_data is not None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not had_asset:
            group.asset_mark()
        group.asset_data.description = DESCRIPTION
        for tag in _TAGS:
            group.asset_data.tags.new(tag, skip_if_exists=True)
        bpy.data.libraries.write(str(folder / FILE_NAME), {group}, fake_user=True, compress=True)
    except (OSError, RuntimeError) as error:
        reason = getattr(error, "strerror", None) or str(error).strip().splitlines()[-1]
        raise InputError(f"cannot be written ({reason})", where=folder, remedy="choose another folder") from error
    finally:
        if not had_asset and group.asset_data is not None:
            group.asset_clear()
        if not had_group:
            _remove_with_parts(group)
    return folder / FILE_NAME


def library_folder() -> str:
    """Folder of the first asset library of the preferences; empty where there is none."""
    libraries = bpy.context.preferences.filepaths.asset_libraries
    return next((library.path for library in libraries if library.path), "")


def _remove_with_parts(group: bpy.types.NodeTree) -> None:
    """Remove a node group and those that only it uses."""
    parts = {node.node_tree for node in group.nodes if getattr(node, "node_tree", None) is not None}
    bpy.data.node_groups.remove(group)
    for part in parts:
        if part.users == 0:
            bpy.data.node_groups.remove(part)
