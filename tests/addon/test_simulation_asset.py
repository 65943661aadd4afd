"""The node group as an asset: usable in files and Blenders without the add-on."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from cvdgs.core.color.matrices import linear_simulation
from cvdgs.core.errors import InputError
from cvdgs.cvdgs_addon.compositor.scene_tree import output_socket
from cvdgs.cvdgs_addon.compositor.simulation_group import GROUP_NAME, Socket, choose, save_asset

from .pictures import composited, feed_picture, random_picture
from .test_simulation_node import standard_scene


def test_the_asset_works_in_another_file(tmp_path):
    scene = standard_scene()
    path = save_asset(tmp_path / "library")
    assert not bpy.data.node_groups, "the open file is left as it was"

    scene = standard_scene()
    with bpy.data.libraries.load(str(path), assets_only=True) as (offered, taken):
        assert offered.node_groups == [GROUP_NAME]
        taken.node_groups = [GROUP_NAME]
    group = taken.node_groups[0]
    assert group.asset_data.description
    picture = random_picture()
    image = feed_picture(scene, picture)
    tree = image.id_data
    node = tree.nodes.new("CompositorNodeGroup")
    node.node_tree = group
    choose(node, Socket.TYPE, "protan")
    node.inputs[Socket.SEVERITY].default_value = 0.6
    tree.links.new(image.outputs["Image"], node.inputs[Socket.IMAGE])
    tree.links.new(node.outputs["Image"], output_socket(tree))
    expected = picture[..., :3] @ linear_simulation("protan", 0.6).matrix.T
    assert np.abs(composited(scene, tmp_path)[..., :3] - expected).max() < 1e-5


def test_a_library_that_cannot_be_written_is_refused_in_one_line(tmp_path):
    standard_scene()
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(InputError, match="cannot be written"):
        save_asset(tmp_path / "file")
    assert not bpy.data.node_groups
