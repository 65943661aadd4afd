"""Runs inside the Blender under test: writes what goes on there to /share/state.json, and runs code that it is given.

Options, from /share/options.json: ``python``, the worker's interpreter; ``sidebar``, whether to open the tab "CVD";
``scale`` of the interface.
"""

import json
import os
import time
import traceback
from pathlib import Path

import bpy

SHARE = Path("/share")
INTERVAL = 0.02  # seconds between two looks; what comes later was held up
options = json.loads((SHARE / "options.json").read_text())
ADDON = "bl_ext.user_default.cvdgs"
seen = {"last": time.monotonic(), "longest": 0.0, "ready": False}


def activity():
    import importlib

    return importlib.import_module(ADDON + ".cvdgs_addon.activity").ACTIVITY


def set_up() -> None:
    """The tab "CVD" in the side bar, and the worker's interpreter; the tab exists only once the region was drawn."""
    if ADDON in bpy.context.preferences.addons and options.get("python"):
        bpy.context.preferences.addons[ADDON].preferences.python = options["python"]
    if not options.get("sidebar"):
        seen["ready"] = True
        return
    for area in bpy.context.window_manager.windows[0].screen.areas:
        if area.type == "VIEW_3D":
            area.spaces.active.show_region_ui = True
            for region in area.regions:
                if region.type == "UI":
                    try:
                        region.active_panel_category = "CVD"
                        region.tag_redraw()
                        seen["ready"] = True
                    except (AttributeError, TypeError):
                        region.tag_redraw()


def places() -> dict:
    """Where the regions are, in pixels from the upper left corner of the window, at a scale of 1."""
    window = bpy.context.window_manager.windows[0]
    found = {}
    for area in window.screen.areas:
        for region in area.regions:
            if region.width > 1:
                pixels = (region.x, window.height - region.y - region.height, region.width, region.height)
                found[f"{area.type} {region.type}"] = [pixel / options["scale"] for pixel in pixels]
    return found


def jobs() -> dict:
    """State and progress of every background job."""
    if ADDON not in bpy.context.preferences.addons:
        return {}
    found = {}
    for name in ("inspect", "import", "run", "environment", "check"):
        job = activity().job(name)
        if job is not None:
            progress = job.progress
            found[name] = {
                "state": job.state.value,
                "stage": progress.stage,
                "fraction": progress.fraction,
                "message": progress.message,
                "left": progress.seconds_left,
                "previews": job.previews,
                "problem": job.problem,
            }
    return found


def run_code() -> None:
    path = SHARE / "code.py"
    if path.exists():
        code = path.read_text()
        try:
            with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
                exec(compile(code, str(path), "exec"), {"bpy": bpy, "seen": seen})
        except Exception:
            traceback.print_exc()
        path.unlink(missing_ok=True)
        seen["last"] = time.monotonic()  # what it took is not the add-on's


def look() -> float:
    now = time.monotonic()
    seen["longest"] = max(seen["longest"], now - seen["last"] - INTERVAL)
    if not seen["ready"]:
        set_up()
    scene = bpy.context.window_manager.windows[0].scene
    properties = getattr(scene, "cvdgs", None)
    state = {
        "ready": seen["ready"],
        "time": time.time(),
        "longest": seen["longest"],
        "places": places(),
        "jobs": jobs(),
        "objects": [found.name for found in scene.objects],
        "layers": [
            attribute.name
            for found in scene.objects
            if found.type == "MESH"
            for attribute in found.data.attributes
            if attribute.name.startswith("color_")
        ],
        "is_rendering": bpy.app.is_job_running("RENDER"),
        "engine": scene.render.engine,
        "camera": scene.camera.name if scene.camera else "",
        "processor": time.process_time(),
        "scene": {} if properties is None else {
            "folder": properties.capture.folder,
            "inspected": properties.capture.inspected,
            "views": properties.capture.views,
            "problem": properties.capture.problem,
            "cvd": properties.viewer.cvd,
            "severity": properties.viewer.severity,
            "quality": properties.run.quality,
            "run": next((found["cvdgs_run"] for found in scene.objects if "cvdgs_run" in found), ""),
            "test_is_open": properties.viewer.test_is_open,
            "caps_arranged": sum(cap > 0 for cap in properties.viewer.test_arranged),
        },
    }  # fmt: skip
    (SHARE / "state.partial").write_text(json.dumps(state))
    os.replace(SHARE / "state.partial", SHARE / "state.json")
    run_code()
    seen["last"] = time.monotonic()
    return INTERVAL


(SHARE / "blender.pid").write_text(str(os.getpid()))
bpy.context.preferences.view.show_splash = False
bpy.context.preferences.view.ui_scale = options["scale"]
bpy.context.preferences.use_preferences_save = False  # the next Blender is as new
# Windows of their own come to lie anywhere, and keep the keys to themselves, where nothing manages windows.
bpy.context.preferences.view.filebrowser_display_type = "SCREEN"
bpy.context.preferences.view.render_display_type = "NONE"
bpy.app.timers.register(look, first_interval=0.5, persistent=True)
