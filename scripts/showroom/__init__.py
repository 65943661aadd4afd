"""The embedded demo capture: a textile showroom, built and photographed by Blender. numpy and bpy only.

`settings` says what can be varied, `palette` chooses colours that one kind of colour vision confuses, `weaves` weaves
them, `cloth` shapes cloth, `scene` arranges the set and `photograph` writes the capture. Only `cloth.simulate`,
`materials`, `scene` and `photograph` need bpy.
"""
