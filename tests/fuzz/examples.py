"""A small valid file for every reader, made by the product's own writers and by the libraries of the formats."""

from __future__ import annotations

import json
import zipfile
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import OpenImageIO as oiio
import pillow_heif
import pycolmap
from PIL import Image
from scipy.ndimage import rotate

from cvdgs.core.batch.records import fingerprint
from cvdgs.core.batch.task import Task
from cvdgs.core.capture.points import write_point_cloud
from cvdgs.core.capture.tags import pattern
from cvdgs.core.color.profiles import DISPLAY_P3
from cvdgs.core.photographs.front import EnhanceRequest
from cvdgs.core.runtime.protocol import JsonReporter
from cvdgs.core.settings import Settings
from cvdgs.core.splats.gaussians import Gaussians
from cvdgs.core.splats.io.gltf import write_glb
from cvdgs.core.splats.io.ply import write_ply
from cvdgs.core.splats.io.splat_file import write_splat
from cvdgs.core.splats.io.spz import write_spz

from ..core.intake.dng import write_dng
from ..core.intake.films import wall, write_video

NAMES = ("a.png", "b.png", "c.png")
SIDE = 20  # pixels of a picture


def gaussians(count: int, degree: int) -> Gaussians:
    rng = np.random.default_rng(degree)
    return Gaussians(
        rng.normal(size=(count, 3)).astype(np.float32),
        rng.normal(size=(count, 3)).astype(np.float32) - 3.0,
        rng.normal(size=(count, 4)).astype(np.float32),
        rng.normal(size=count).astype(np.float32),
        rng.normal(size=(count, (degree + 1) ** 2, 3)).astype(np.float32),
    )


def written(name: str, write) -> bytes:
    """What `write(path)` writes."""
    with TemporaryDirectory() as folder:
        path = Path(folder, name)
        write(path)
        return path.read_bytes()


def gaussian_plys() -> list[bytes]:
    text = written("s.ply", lambda path: write_ply(path, gaussians(2, 0)))
    header, _, _ = text.partition(b"end_header\n")
    numbers = b" ".join(b"0.5" for _ in range(17))
    as_text = header.replace(b"binary_little_endian", b"ascii") + b"end_header\n" + numbers + b"\n" + numbers + b"\n"
    return [text, written("s.ply", lambda path: write_ply(path, gaussians(3, 1))), as_text]


def spzs() -> list[bytes]:
    return [
        written("s.spz", lambda path, version=version: write_spz(path, gaussians(3, version - 2), version))
        for version in (2, 3)
    ]


def splats() -> list[bytes]:
    return [written("s.splat", lambda path: write_splat(path, gaussians(3, 0)))]


def glbs() -> list[bytes]:
    original = gaussians(3, 1)
    layers = {"original": original, "deutan-1.0": replace(original, sh=gaussians(3, 0).sh)}
    return [written("s.glb", lambda path: write_glb(path, layers))]


def point_clouds() -> list[bytes]:
    points = np.arange(12, dtype=np.float32).reshape(4, 3)
    return [written("p.ply", lambda path: write_point_cloud(path, points, points.astype(np.uint8)))]


@cache
def colmap_files(*, text: bool) -> dict[str, bytes]:
    """The files of a model of three images, by their names."""
    model = pycolmap.Reconstruction()
    camera = pycolmap.Camera(
        camera_id=1, model="OPENCV", width=SIDE, height=SIDE, params=[20, 20, 10, 10, 0.1, 0, 0, 0]
    )
    model.add_camera_with_trivial_rig(camera)
    for number, name in enumerate(NAMES, start=1):
        seen = [pycolmap.Point2D(np.array([3.0, 4.0]))]
        pose = pycolmap.Rigid3d(np.column_stack([np.eye(3), [0.1 * number, 0.0, 0.0]]))
        model.add_image_with_trivial_frame(pycolmap.Image(name=name, camera_id=1, image_id=number, points2D=seen), pose)
    track = pycolmap.Track()
    for number in (1, 2, 3):
        track.add_element(number, 0)
    model.add_point3D(np.array([0.0, 0.0, 3.0]), track, np.array([10, 20, 30], np.uint8))
    with TemporaryDirectory() as folder:
        (model.write_text if text else model.write_binary)(folder)
        return {path.name: path.read_bytes() for path in Path(folder).iterdir()}


def transforms() -> list[bytes]:
    pose = np.eye(4).tolist()
    frames = [{"file_path": name, "transform_matrix": pose} for name in NAMES]
    shared = {"fl_x": 20.0, "cx": 10.0, "cy": 10.0, "w": SIDE, "h": SIDE, "k1": 0.1, "camera_model": "OPENCV"}
    return [
        json.dumps({**shared, "frames": frames}).encode(),
        json.dumps({"camera_angle_x": 0.9, "frames": frames, "ply_file_path": "points.ply"}).encode(),
    ]


def picture(suffix: str) -> bytes:
    """A picture in the format of `suffix`."""
    return written(f"p{suffix}", write_picture)


def write_picture(path: Path) -> None:
    channels = 3 if path.suffix in (".jpg", ".hdr", ".ppm") else 4
    kind = oiio.HALF if path.suffix == ".exr" else oiio.FLOAT if path.suffix == ".hdr" else oiio.UINT8
    spec = oiio.ImageSpec(SIDE, SIDE, channels, kind)
    file = oiio.ImageOutput.create(str(path))
    pixels = np.linspace(0.0, 1.0, SIDE * SIDE * channels, dtype=np.float32).reshape(SIDE, SIDE, channels)
    assert file.open(str(path), spec)
    assert file.write_image(pixels)
    assert file.close()


def photographs(suffix: str) -> list[bytes]:
    """Small photographs as telephones and cameras write them; a HEIC in HDR, too."""
    return [photograph(suffix), *([hdr_photograph()] if suffix == ".heic" else [])]


def hdr_photograph() -> bytes:
    """A HEIC of 10 bits, PQ in BT.2020."""
    codes = np.linspace(0, 40_000, 32 * 32 * 3).astype(np.uint16).tobytes()
    described = {"color_primaries": 9, "transfer_characteristics": 16, "matrix_coefficients": 9}
    options = {"save_nclx_profile": True, "quality": -1}
    return written("h.heic", lambda path: pillow_heif.encode("RGB;16", (32, 32), codes, path, **described, **options))


def masks() -> list[bytes]:
    """A mask of an upright photograph, as stored, and one as it is shown."""
    shown = np.zeros((2 * SIDE, SIDE), np.uint8)
    shown[5:30] = 255
    return [
        written("m.png", lambda path, mask=mask: Image.fromarray(mask).save(path)) for mask in (shown, shown.T.copy())
    ]


def tags() -> list[bytes]:
    """A printed tag from in front, and askew, as a picture whose bytes are its pixels."""
    cells = np.pad(pattern(3), 3, constant_values=True)
    straight = np.where(cells, 215, 35).astype(np.uint8).repeat(6, axis=0).repeat(6, axis=1)
    askew = rotate(straight, 17.0, order=1, cval=215).astype(np.uint8)
    return [
        written("t.ppm", lambda path, grey=grey: Image.fromarray(grey).convert("RGB").save(path))
        for grey in (straight, askew)
    ]


FRAMES = json.dumps(
    {"frames": [{"name": f"{index:06d}.jpg", "time": 0.5 * index, "video": "walk.mp4"} for index in range(4)]}
).encode()


def photograph(suffix: str) -> bytes:
    """A small photograph as telephones and cameras write them."""

    def write(path: Path) -> None:
        side = 32  # the least that LibRaw develops
        y, x = np.mgrid[:side, :side] / side
        colors = np.stack([x, y, 0.5 + 0.3 * x * y], -1)
        if suffix == ".dng":
            write_dng(path, colors)
        elif suffix == ".heic":
            file = pillow_heif.from_pillow(Image.fromarray((colors * 255).astype(np.uint8)))
            file.info["icc_profile"] = DISPLAY_P3
            file.save(path)
        else:
            Image.fromarray((colors * 255).astype(np.uint8)).save(path, icc_profile=DISPLAY_P3)

    return written(f"p{suffix}", write)


def videos() -> list[bytes]:
    """A few frames, with the index at the file's end and at its beginning."""
    pixels = [np.roll(wall(side=96)[:64, :96], 5 * step, axis=1) for step in range(6)]
    options = ({}, {"movflags": "faststart"})
    return [
        written("v.mp4", lambda path, chosen=chosen: write_video(path, pixels, container_options=chosen))
        for chosen in options
    ]


def archives() -> list[bytes]:
    """A zip with a folder, a photograph and a camera file."""

    def write(path: Path) -> None:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("room/images/1.png", picture(".png"))
            archive.writestr("room/transforms.json", b"{}")

    return [written("z.zip", write)]


def weights() -> list[bytes]:
    from cvdgs.core.enhance.gan.networks import Generator, GeneratorConfig
    from cvdgs.core.enhance.gan.weights import save_generator

    generator = Generator(GeneratorConfig((2, 2, 2, 3), 1, 2, 2))
    return [written("w.safetensors", lambda path: save_generator(generator, path, {"step": "1"}))]


def luts() -> list[bytes]:
    import torch

    from cvdgs.core.enhance.lut import ColorLut

    return [written("l.safetensors", lambda path: ColorLut(torch.zeros(2, 2, 2, 3), {"cvd": "deutan"}).save(path))]


def networks() -> list[bytes]:
    import torch

    from cvdgs.core.color.simulation import Observer
    from cvdgs.core.enhance.scene.fit import FittedNetwork
    from cvdgs.core.enhance.scene.network import SceneNetwork
    from cvdgs.core.enhance.scene.storage import save_network

    network = SceneNetwork(Observer("deutan", 1.0, "machado"))
    fitted = FittedNetwork(network, torch.zeros_like(network.table), 2.0, 1.9)
    return [written("n.safetensors", lambda path: save_network(fitted, path))]


def scored_plys() -> list[bytes]:
    scores = np.array([0.0, 0.25, 1.0], np.float32)
    return [written("s.ply", lambda path: write_ply(path, gaussians(3, 0), scores))]


BATCH = b"""title = "Autumn"   # a comment
layers = ["original", "deutan-1.0"]
retries = 2

[train]
iterations = 3_000
strength = 0.5
max_size = "auto"

[turntable]
frames = 4
size = [64, 48]
engines = ["cycles"]

[cameras.low]
height = 0.1

[[items]]
name = "chair"
capture = '''capture'''
turntable.frames = 8
outputs = ["frames", "video"]

[[items]]
run = "../run"
layers = ["original"]
cameras = ["low"]
train = { device = "cpu", cameras = "given" }
"""


def requests() -> list[bytes]:
    sent = [
        {"job": "inspect", "capture": "c", "cameras": "given", "thumbnails": {"folder": "d", "count": 3, "size": 64}},
        {"job": "inspect-all", "captures": [{"capture": "c", "cameras": "auto"}]},
        {"job": "run", "settings": Settings("c", "o").to_dict(), "folder": "d", "previews": True},
        {"job": "enhance", "request": EnhanceRequest(("a.png",), "o").to_dict(), "folder": "d"},
        {"job": "check", "device": "auto"},
    ]
    return [json.dumps(one).encode() for one in sent]


def events() -> list[bytes]:
    lines: list[str] = []

    class Stream:
        def write(self, text: str) -> None:
            lines.append(text)

        def flush(self) -> None:
            pass

    reporter = JsonReporter(Stream(), interval=0.0)  # type: ignore[arg-type]
    reporter.status("geometry", "training 10288 Gaussians")
    reporter.progress("geometry", 0.42, "28.1 dB")
    reporter.warning("few-views", "2 views only")
    reporter.preview(Path("picture.png"))
    reporter.emit("error", kind="input", message="no such file")
    reporter.emit("result", report={"layers": {}})
    return [line.encode() for line in lines]


def report() -> dict:
    """A report of a finished run, as far as it is read again."""
    figures = {"input": 0.6, "enhanced": 0.9, "unenhanced": 0.5, "rendered": 0.8}
    layer = {
        "ccpr": {**figures, "tau": 6},
        "ccpr_mean": figures,
        "ssim_simulated": figures,
        "naturalness": {"ssim": 0.95, "psnr": None, "delta_e": 4.0},
        "rwe": {"ratio": 0.9, "enhanced_ratio": 1.1},
        "psnr_to_enhanced": 30.0,
    }
    return {
        "schema": "cvdgs-report-1",
        "settings": Settings("c", "o").to_dict(),
        "versions": {"cvdgs": "0.1.0"},
        "device": "cpu",
        "capture": {"views": 3, "train": 3, "test": 0, "width": SIDE, "height": SIDE, "points": 1},
        "gaussians": 3,
        "reconstruction": {"psnr": None, "ssim": None},
        "seconds": {"capture": 1.0, "total": 2.0},
        "peak_memory_mb": 100.0,
        "layers": {"deutan-1.0": layer},
        "views_shown": ["a"],
        "curve": [{"seconds": 1.0, "psnr": 20.0}],
        "notes": {},
        "warnings": [{"name": "few-views", "message": "3 views only"}],
    }


def plan() -> bytes:
    task = {
        "name": "chair.video",
        "kind": "video",
        "after": [],
        "arguments": {"frames": 4},
        "inputs": ["chair/frames/{0001..0004}.png"],
        "outputs": ["chair/turntable.mp4"],
        "item": "chair",
        "seconds": 1.5,
        "cores": 1,
        "memory_mb": 512,
        "gpu": 0,
    }
    return json.dumps({"format": 1, "retries": 1, "tasks": [task]}).encode()


METRICS = b"""file,output,size,ccpr_input,ccpr_enhanced,delta_e,note
photos/a.png,a.png,20x20,0.6,0.9,4.0,
photos/b.png,b.png,20x20,0.5,0.8,3.0,no visible colour: left unchanged
"""


def record() -> bytes:
    """What vouches for the task of `plan`."""
    (values,) = json.loads(plan())["tasks"]
    known = {"chair/frames/0001.png": [10, 20, "0" * 64], "chair/frames/0002.png": []}
    told = {"seconds": 1.5, "inputs": known, "outputs": {"chair/turntable.mp4": 100}}
    return json.dumps({"fingerprint": fingerprint(Task.from_dict(values)), **told}).encode()
