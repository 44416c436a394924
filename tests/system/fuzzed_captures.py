"""Capture sets, images, streams and scenes of the fuzz tests."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import trimesh

from starling.patterns import image as pattern_image
from starling.sim.captures import capture, exr, png
from starling.sim.captures import info as capture_info
from starling.sim.captures.exchange import labelfusion, stream, tum
from starling.sim.render.layers import Layers, Truth, ViewLayers
from starling.sim.scene import mitsuba_xml, scene_file, sources
from starling.sim.sensor import presets, realsense
from starling.sim.stereo.depth import DepthMap
from tests.system import mutations
from tests.system.fuzzed_parts import (
    IDENTITY,
    INFO,
    RECORD,
    SHAPE,
    Format,
    as_json,
    as_toml,
    depth_codes,
    plain_file,
)

_TOML, _JSON, _WORDS = mutations.toml_text, mutations.json_text, mutations.words


# Capture sets.


def _set(name: str) -> Callable[[Path], Path]:
    """Write a capture set of one scene and return the path of one of its files."""

    def write(folder: Path) -> Path:
        frame = folder / "a" / "0"
        frame.mkdir(parents=True)
        (folder / "capture.toml").write_bytes(as_toml(INFO))
        (folder / "a" / "camera.toml").write_bytes(as_toml(INFO))
        (folder / "a" / "room").write_text("kitchen\n")
        (folder / "a" / "truth.png").write_bytes(png.encode(depth_codes()))
        for image, dtype in (("ir_left", np.uint8), ("ir_right", np.uint8), ("depth", np.uint16)):
            (frame / f"{image}.png").write_bytes(png.encode(depth_codes(dtype)))
        (frame / "rgb.png").write_bytes(png.encode_colour(np.dstack([depth_codes(np.uint8)] * 3)))
        (frame / "frame.json").write_bytes(as_json(RECORD))
        return folder / name

    return write


def _read_set(path: Path) -> object:
    folder = next(parent for parent in path.parents if (parent / "a").is_dir())
    captures = capture.open_set(folder)
    for scene in captures.scenes:
        capture_info.dumps(scene.info)
        scene.truth_m()
        stream.in_time_order([scene])
        for number in scene.frames:
            stream.pose_of_left(scene, scene.record(number))
    return captures


def _read_scene_file(path: Path) -> object:
    file = scene_file.read(path)
    scene_file.dumps(file)
    return file.world_from_left


def _read_sensor(path: Path) -> object:
    return presets.dumps(presets.load(str(path)))


def _read_device_preset(path: Path) -> object:
    return realsense.with_preset(presets.load("d435"), str(path))


# Images.


def _read_grey(path: Path) -> object:
    return png.read(path, "depth")


def _read_colour(path: Path) -> object:
    return png.decode_colour(path.read_bytes(), path, "rgb")


def _read_pattern(path: Path) -> object:
    return pattern_image.load(path, fov_x_deg=60, fov_y_deg=40)


def _write_exr(folder: Path) -> Path:
    rng = np.random.default_rng(0)

    def view() -> ViewLayers:
        names = ("projector_direct", "projector_indirect", "ambient", "other", "depth_m")
        body = rng.integers(0, 9, SHAPE, np.uint32)
        return ViewLayers(**{name: rng.random(SHAPE, np.float32) for name in names}, body=body)

    reason = rng.integers(0, 14, SHAPE).astype(np.uint32)
    depth_m = rng.random(SHAPE, np.float32)
    truth = Truth(
        depth_m=depth_m,
        normal=rng.normal(size=(*SHAPE, 3)).astype(np.float32),
        material=rng.integers(0, 99, SHAPE).astype(np.uint32),
        right_sees=depth_m > 0.5,
        lit=depth_m > 0.2,
    )
    depth = DepthMap(disparity_px=depth_m * 7, depth_m=depth_m, valid=reason == 0, reason=reason)
    exr.write(folder / "frame.exr", Layers(left=view(), right=view(), truth=truth), depth)
    return folder / "frame.exr"


# Streams of moving cameras.

_TRAJECTORY = b"".join(b"%.1f 0.1 0.2 %.1f 0 0 0.6 0.8\n" % (t, t) for t in (1.0, 1.1, 1.2))


def _tum(name: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        for kind in ("rgb", "depth"):
            (folder / kind).mkdir()
            lines = []
            for time in ("1.0", "1.1", "1.2"):
                dtype = np.uint16 if kind == "depth" else np.uint8
                (folder / kind / f"{time}.png").write_bytes(png.encode(depth_codes(dtype)))
                lines.append(f"{time} {kind}/{time}.png")
            (folder / f"{kind}.txt").write_text("\n".join(["# timestamp filename", *lines]) + "\n")
        (folder / "groundtruth.txt").write_bytes(b"# timestamp tx ty tz\n" + _TRAJECTORY)
        (folder / "camera.txt").write_text("30 30 15.5 11.5 32 24\n")
        return folder / name

    return write


def _labelfusion(name: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        images = folder / "images"
        images.mkdir()
        for number in (1, 2):
            start = images / f"{number:010d}"
            colour = np.dstack([depth_codes(np.uint8)] * 3)
            start.with_name(f"{start.name}_depth.png").write_bytes(png.encode(depth_codes()))
            start.with_name(f"{start.name}_rgb.png").write_bytes(png.encode_colour(colour))
            start.with_name(f"{start.name}_utime.txt").write_text(f"{1000000 + number * 100000}\n")
        (folder / "posegraph.posegraph").write_bytes(_TRAJECTORY)
        (folder / "camera.cfg").write_text("30 30 15.5 11.5\n")
        return folder / name

    return write


def _read_stream(read: Callable[[Path], stream.Stream]) -> Callable[[Path], object]:
    def read_all(path: Path) -> object:
        inside = path.parent.name in ("images", "depth", "rgb")
        folder = path.parent.parent if inside else path.parent
        opened = read(folder)
        for posed in stream.posed_frames(opened):
            posed.moment.depth()
            if posed.moment.image is not None:
                posed.moment.image()
        return opened

    return read_all


# Scenes.


def _mesh(kind: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        box = trimesh.creation.box((0.2, 0.3, 0.4))
        path = folder / f"box.{kind.removeprefix('ascii.')}"
        if kind == "obj":
            (folder / "a.mtl").write_text("newmtl a\nKd 1 0 0\nmap_Kd a.png\n")
            cv2.imwrite(str(folder / "a.png"), np.full((2, 2, 3), 128, np.uint8))
            text = box.export(file_type="obj")
            path.write_text(f"mtllib a.mtl\no box\nusemtl a\nvt 0 0\n{text}g b\nf 1 2 3 4\n")
        elif kind == "ascii.ply":
            path.write_bytes(box.export(file_type="ply", encoding="ascii"))
        else:
            path.write_bytes(box.export(file_type=kind))
        return path

    return write


def _read_mesh(path: Path) -> object:
    return sources.load_mesh(path, presets.load("d435"))


_XML = b"""<scene version="3.0.0">
<default name="width" value="32"/>
<sensor type="perspective">
<float name="fov" value="40"/>
<transform name="to_world"><lookat origin="0, 0, 2" target="0, 0, 0" up="0, 1, 0"/></transform>
<film type="hdrfilm"><integer name="width" value="$width"/>
<integer name="height" value="24"/></film>
</sensor>
<bsdf type="diffuse" id="grey"><spectrum name="reflectance" value="0.4"/></bsdf>
<shape type="rectangle" id="wall"><ref id="grey"/>
<transform name="to_world"><scale x="2" y="2"/><rotate y="1" angle="20"/></transform></shape>
<shape type="sphere"><point name="center" x="0" y="0" z="0"/><float name="radius" value="0.2"/>
<bsdf type="twosided"><bsdf type="roughplastic">
<rgb name="diffuse_reflectance" value="0.1, 0.2, 0.3"/>
</bsdf></bsdf><emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>
<shape type="ply"><string name="filename" value="box.ply"/></shape>
<emitter type="constant"/>
</scene>
"""


def _write_xml(folder: Path) -> Path:
    _mesh("ply")(folder)
    return plain_file("scene.xml", _XML)(folder)


def _read_xml(path: Path) -> object:
    return mitsuba_xml.load(path).world_from_left


FORMATS = {
    "capture.toml": Format(write=_set("capture.toml"), read=_read_set, mutator=_TOML),
    "camera.toml": Format(write=_set("a/camera.toml"), read=_read_set, mutator=_TOML),
    "room": Format(write=_set("a/room"), read=_read_set, mutator=_WORDS),
    "frame.json": Format(write=_set("a/0/frame.json"), read=_read_set, mutator=_JSON),
    "truth.png": Format(write=_set("a/truth.png"), read=_read_set, mutator=mutations.png),
    "ir_left.png": Format(write=_set("a/0/ir_left.png"), read=_read_set, mutator=mutations.png),
    "depth.png": Format(
        write=plain_file("depth.png", png.encode(depth_codes())),
        read=_read_grey,
        mutator=mutations.png,
    ),
    "rgb.png": Format(
        write=plain_file("rgb.png", png.encode_colour(np.dstack([depth_codes(np.uint8)] * 3))),
        read=_read_colour,
        mutator=mutations.png,
    ),
    "scene.toml": Format(
        write=plain_file(
            "scene.toml",
            as_toml(
                {
                    **{"scene": "table.ply", "left_from_world": IDENTITY},
                    "materials": [{"body": "ball*", "reflectance": 0.3}],
                }
            ),
        ),
        read=_read_scene_file,
        mutator=_TOML,
    ),
    "sensor": Format(
        write=plain_file("d435.toml", presets.text("d435").encode()),
        read=_read_sensor,
        mutator=_TOML,
    ),
    "device preset": Format(
        write=plain_file(
            "preset.json",
            as_json(
                {
                    **{"schema version": 1, "device": {"name": "D435", "product line": "D400"}},
                    "parameters": {
                        **{"param-depthunits": "1000", "controls-laserpower": 150},
                        **{"param-censususize": "9", "controls-laserstate": "on"},
                        "param-secondpeakdelta": 325,
                    },
                    "viewer": {"stream-width": "848"},
                }
            ),
        ),
        read=_read_device_preset,
        mutator=_JSON,
    ),
    "frame.exr": Format(write=_write_exr, read=exr.read, mutator=mutations.plain, native=True),
    "pattern": Format(
        write=plain_file("dots.png", png.encode(np.tile(depth_codes(), (2, 2)))),
        read=_read_pattern,
        mutator=mutations.png,
    ),
    **{
        f"tum {name}": Format(write=_tum(name), read=_read_stream(tum.read), mutator=mutator)
        for name, mutator in (
            *((name, _WORDS) for name in ("depth.txt", "rgb.txt", "groundtruth.txt", "camera.txt")),
            ("rgb/1.1.png", mutations.png),
        )
    },
    **{
        f"labelfusion {name}": Format(
            write=_labelfusion(name), read=_read_stream(labelfusion.read), mutator=mutator
        )
        for name, mutator in (
            *((name, _WORDS) for name in ("posegraph.posegraph", "camera.cfg")),
            ("images/0000000001_utime.txt", _WORDS),
            ("images/0000000001_depth.png", mutations.png),
        )
    },
    "ply": Format(write=_mesh("ply"), read=_read_mesh, mutator=_WORDS, native=True),
    "ascii ply": Format(write=_mesh("ascii.ply"), read=_read_mesh, mutator=_WORDS, native=True),
    "obj": Format(write=_mesh("obj"), read=_read_mesh, mutator=_WORDS, native=True),
    "glb": Format(write=_mesh("glb"), read=_read_mesh, mutator=mutations.glb, native=True),
    "xml": Format(write=_write_xml, read=_read_xml, mutator=_WORDS, native=True),
}
