"""The embedded demo capture: a textile showroom, built and photographed by Blender. numpy and bpy only.

`settings` says what can be varied, `palette` chooses colours that one kind of colour vision confuses, `weaves` weaves
them, `fabrics` combines both, `cloth` shapes cloth, `scene` arranges the set, `photograph` photographs it and `capture`
writes the folder. `settings`, `palette`, `weaves`, `cloth` and `cameras` do not need bpy.
"""
