"""Every key of the files that users write changes an output, is refused, or gives a warning.

A new key without a case fails: the tables of cases are compared with the keys that the code reads.
"""

from __future__ import annotations

import dataclasses
import json
import re
import shutil
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tomli_w
import trimesh

from starling.calibration import observation
from starling.learning.completion.commands.complete_captures import complete_captures
from starling.learning.completion.data.pairs import read_pair
from starling.learning.features import features as holes
from starling.patterns.errors import InputError
from starling.sim.captures import capture, frame_record
from starling.sim.captures import info as capture_info
from starling.sim.captures.exchange import bop, tum
from starling.sim.commands import compare
from starling.sim.commands.match_captures import match_captures
from starling.sim.datasets.render_view import MemoryFolder
from starling.sim.geometry import frames
from starling.sim.imaging.imager.exposure import read_exposure
from starling.sim.scene import scene_file
from starling.sim.scene.captured import known_geometry
from starling.sim.sensor import presets, resolve
from tests.architecture.test_walls import ROOT

SHAPE = (48, 160)
IDENTITY = np.eye(4).tolist()
PINHOLE = {"width": 160, "height": 48, "fx_px": 90.0, "fy_px": 91.0, "cx_px": 79.5, "cy_px": 23.5}
CAPTURE: dict[str, Any] = {
    **PINHOLE,
    **{"sensor": "d415", "baseline_m": 0.05, "depth_unit_m": 0.001, "black_level_dn": 4.0},
    **{"source": "a", "licence": "b", "notes": "c", "preset": "d", "projector": "on"},
    "colour": {**PINHOLE, "width": 80},
    "colour_from_left": [[1, 0, 0, 0.01], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
    "distortion": [0.0, 0.0, 0.0, 0.0, 0.0],
}
SHIFTED = [[1, 0, 0, 0.1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]


def said(action: Callable[[], Any]) -> str:
    """Run an action; return its result as text, or its refusal, and the warnings before it."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            result = repr(action())
        except InputError as error:
            result = f"refused: {error}"
    return "\n".join([*(f"warning: {item.message}" for item in caught), result])


def unchanged(action: Callable[[], Any]) -> str:
    """Return what an action says of the unchanged files: no refusal, and twice the same."""
    first = said(action)
    assert "refused: " not in first and said(action) == first
    return first


def digest(*arrays: Any) -> list[Any]:
    return [None if array is None else hash(np.asarray(array).tobytes()) for array in arrays]


# --- capture.toml and camera.toml -------------------------------------------------------------


def write_captures(folder: Path, table: Mapping[str, Any], record: Mapping[str, Any] = {}) -> Path:
    """Write a set of one scene and frame, with a picture in the view of the colour camera."""
    rng = np.random.default_rng(0)
    frame = folder / "desk" / "0"
    frame.mkdir(parents=True, exist_ok=True)
    (folder / "capture.toml").write_text(tomli_w.dumps(table))
    infrared = rng.integers(20, 90, SHAPE).astype(np.uint8)
    far = np.full(SHAPE, 1000, np.uint16)
    images = {"ir_left": infrared, "ir_right": np.roll(infrared, -4, 1), "depth": far}
    for name, image in images.items():
        cv2.imwrite(str(frame / f"{name}.png"), image)
    cv2.imwrite(str(frame.parent / "truth.png"), far + rng.integers(0, 9, SHAPE, np.uint16))
    cv2.imwrite(str(frame / "rgb.png"), np.full((48, table["colour"]["width"], 3), 90, np.uint8))
    (frame / "frame.json").write_text(json.dumps(record))
    return folder / "desk"


def matched(scene: Path) -> Any:
    sensor = resolve.load("d435", captures=str(scene), edits=["matcher.search_px=32"])
    return match_captures(str(scene), sensor)


def completed(scene: Path) -> Any:
    """Return the camera of completed captures, which keeps the notes on the origin."""
    out = scene.parents[1] / "completed"
    complete_captures(str(scene), "poisson", out, force=True)
    return (out / "capture.toml").read_text()


def seen_in_colour(scene: Path) -> Any:
    pair = read_pair(capture.open_set(scene).scenes[0], 0, "rgb")
    return digest(pair.depth_m, pair.image), pair.camera


def dot_contrast(scene: Path) -> Any:
    opened = capture.open_set(scene).scenes[0]
    return compare.dot_contrast(opened.frame(0).ir_left, opened.info.black_level_dn or 0.0)


def projector_place(scene: Path) -> Any:
    return holes._projector_part(capture.open_set(scene).info)  # Where no simulation says it.


CAMERA: dict[str, tuple[Any, Callable[[Path], Any]]] = {
    "sensor": ("d435", projector_place),
    "width": (161, matched),
    "height": (49, matched),
    "fx_px": (99.0, matched),
    "fy_px": (99.0, seen_in_colour),
    "cx_px": (75.0, seen_in_colour),
    "cy_px": (20.0, seen_in_colour),
    "baseline_m": (0.06, matched),
    "depth_unit_m": (0.0011, matched),
    "black_level_dn": (9.0, dot_contrast),
    "source": ("other", completed),
    "licence": ("other", completed),
    "notes": ("other", completed),
    "preset": ("other", completed),
    "projector": ("off", completed),
    "distortion": ([0.1, 0, 0, 0, 0], matched),
    "colour.width": (81, seen_in_colour),
    "colour.height": (49, seen_in_colour),
    "colour.fx_px": (99.0, seen_in_colour),
    "colour.fy_px": (99.0, seen_in_colour),
    "colour.cx_px": (75.0, seen_in_colour),
    "colour.cy_px": (20.0, seen_in_colour),
    "colour_from_left": (SHIFTED, seen_in_colour),
    "a_typo": (1.0, matched),
}


def with_value(table: Mapping[str, Any], path: str, value: Any) -> dict[str, Any]:
    head, _, rest = path.partition(".")
    return {**table, head: with_value(table[head], rest, value) if rest else value}


def test_every_key_of_a_camera_has_a_case() -> None:
    names = {item.name for item in dataclasses.fields(capture_info.CaptureInfo)}
    assert {path.partition(".")[0] for path in CAMERA} == names - {"extra"} | {"a_typo"}
    colour = {path for path in CAMERA if path.startswith("colour.")}
    assert colour == {f"colour.{name}" for name in PINHOLE}


@pytest.mark.parametrize("file", ["capture.toml", "desk/camera.toml"])
@pytest.mark.parametrize("path", CAMERA)
def test_every_key_of_a_camera_matters(tmp_path: Path, path: str, file: str) -> None:
    value, observe = CAMERA[path]
    scene = write_captures(tmp_path / "set", CAPTURE)
    before = unchanged(lambda: observe(scene))
    (tmp_path / "set" / file).write_text(tomli_w.dumps(with_value(CAPTURE, path, value)))
    assert said(lambda: observe(scene)) != before


# --- frame.json -------------------------------------------------------------------------------

BOX = {"mesh": "box.ply", "body": "box", "left_from_mesh": frames.pose((0, 0, 1)).tolist()}
RECORD: dict[str, Any] = {
    **{"timestamp": 2.0, "exposure_s": 0.01, "gain": 2.0, "laser_power": 150, "counts": "repeats"},
    **{"left_from_world": IDENTITY, "bodies": ["table", "box"], "objects": [BOX]},
}


def exported_trajectory(scene: Path) -> Any:
    folder = MemoryFolder(scene)
    tum.export(capture.open_set(scene).scenes, folder)
    return folder.content["groundtruth.txt"]


def exported_objects(scene: Path) -> Any:
    meshes = scene.parents[1]
    trimesh.creation.box((0.3, 0.2, 0.2)).export(meshes / "box.ply")
    trimesh.creation.box((0.1, 0.2, 0.2)).export(meshes / "other.ply")
    cv2.imwrite(str(scene / "label.png"), np.full(SHAPE, 2, np.uint8))
    folder = MemoryFolder(scene)
    bop.export(capture.open_set(scene), meshes, folder)
    return {name: hash(data) for name, data in folder.content.items()}


def exposure(scene: Path) -> Any:
    return read_exposure(capture.open_set(scene).scenes[0].record(0))


def repeats(scene: Path) -> Any:
    shutil.copytree(scene / "0", scene / "1", dirs_exist_ok=True)
    return digest(observation.read(capture.open_set(scene).scenes[0]).repeats)


def kept_record(scene: Path) -> Any:
    out = scene.parents[1] / "completed"
    complete_captures(str(scene), "poisson", out, force=True)
    return (out / "desk" / "0" / "frame.json").read_text()


FRAME: dict[str, tuple[Any, Callable[[Path], Any]]] = {
    "timestamp": (3.0, exported_trajectory),
    "exposure_s": (0.02, exposure),
    "gain": (0.0, exposure),
    "laser_power": (100, kept_record),
    "counts": ("steps", repeats),
    "left_from_world": (SHIFTED, exported_trajectory),
    "bodies": (["box", "table"], exported_objects),
    "objects": ([], exported_objects),
    "objects.mesh": ([{**BOX, "mesh": "other.ply"}], exported_objects),
    "objects.body": ([{**BOX, "body": "table"}], exported_objects),
    "objects.left_from_mesh": (
        [{**BOX, "left_from_mesh": frames.pose((0.1, 0, 1)).tolist()}],
        exported_objects,
    ),
    "objects.sha256": ([{**BOX, "sha256": "0" * 64}], exported_objects),
}
READ = re.compile(r"""record(?:\([^()]*\))?(?:\.get\(|\[)"(\w+)\"""")
RUN_RECORD = {"arguments", "verb"}  # Keys of starling.json, which programs write.


def test_every_key_of_a_frame_has_a_case() -> None:
    folders = [ROOT / name for name in ("sim", "calibration", "learning", "diagnosis")]
    sources = [path.read_text() for folder in folders for path in folder.rglob("*.py")]
    read = {name for source in sources for name in READ.findall(source)} - RUN_RECORD
    assert {path for path in FRAME if "." not in path} == read | set(frame_record._NUMBERS)


@pytest.mark.parametrize("path", FRAME)
def test_every_key_of_a_frame_matters(tmp_path: Path, path: str) -> None:
    value, observe = FRAME[path]
    scene = write_captures(tmp_path / "set", CAPTURE, RECORD)
    before = unchanged(lambda: observe(scene))
    changed = {**RECORD, path.partition(".")[0]: value}
    (scene / "0" / "frame.json").write_text(json.dumps(changed))
    assert said(lambda: observe(scene)) != before


# --- scene.toml -------------------------------------------------------------------------------

KNOWN: dict[str, Any] = {
    "scene": "staircase:0.5",
    "left_from_world": IDENTITY,
    "materials": [{"body": "step*", "reflectance": 0.3}],
}
SCENE: dict[str, Any] = {
    "scene": "wall:1",
    "left_from_world": SHIFTED,
    "materials": [],
    "materials.body": [{"body": "back", "reflectance": 0.3}],
    "ambient_w_m2": 3.0,
    "materials.reflectance": [{"body": "step*", "reflectance": 0.4}],
    "materials.kind": [{"body": "step*", "reflectance": 0.3, "kind": "metal"}],
    "materials.roughness": [{"body": "step*", "reflectance": 0.3, "roughness": 0.5}],
    "materials.material": [{"body": "step*", "material": "none", "reflectance": 0.3}],
    "materials.rgb": [{"body": "step*", "reflectance": 0.3, "rgb": [0.1, 0.2, 0.3]}],
    "look_at": [0.0, 0.0, -1.0, 0.0, 0.0, 1.0],  # Beside a pose: refused.
    **{"up": "z", "unit": "mm", "camera": "top", "keyframe": "home", "qpos": "q.npy"},  # Refused.
    "a_typo": 1,
}


def test_every_key_of_a_known_scene_has_a_case() -> None:
    keys = {item.name for item in dataclasses.fields(scene_file.SceneFile)}
    keys |= {f"materials.{item.name}" for item in dataclasses.fields(scene_file.KnownMaterial)}
    assert set(SCENE) == keys | {"a_typo"}


@pytest.mark.parametrize("path", SCENE)
def test_every_key_of_a_known_scene_matters(tmp_path: Path, path: str) -> None:
    scene = write_captures(tmp_path / "set", CAPTURE)

    def observed(table: Mapping[str, Any]) -> Any:
        (scene / "scene.toml").write_text(tomli_w.dumps(table))
        loaded = known_geometry.load(capture.open_set(scene).scenes[0], presets.load("d435"))
        assert loaded is not None
        bodies = [(body.name, repr(body.material)) for body in loaded.bodies]
        return bodies, loaded.ambient, loaded.world_from_left.tolist()

    before = unchanged(lambda: observed(KNOWN))
    changed = {**KNOWN, path.partition(".")[0]: SCENE[path]}
    assert said(lambda: observed(changed)) != before


def test_the_pose_of_a_known_scene_is_exported(tmp_path: Path) -> None:
    """It applies to frames without a pose of their own."""
    scene = write_captures(tmp_path / "set", CAPTURE)
    (scene / "scene.toml").write_text(tomli_w.dumps({**KNOWN, "left_from_world": SHIFTED}))
    assert exported_trajectory(scene).decode().splitlines()[1].startswith("0.000000 -0.1 0 0 ")
    (scene / "0" / "frame.json").write_text(json.dumps({"left_from_world": IDENTITY}))
    assert exported_trajectory(scene).decode().splitlines()[1].startswith("0.000000 0 0 0 ")
