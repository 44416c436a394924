"""Pictures of all kinds of captures, with the available images."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from starling.patterns.errors import InputError
from starling.sim.captures import capture, exr
from starling.sim.commands import show_captures
from starling.sim.render.layers import Layers, Truth, ViewLayers
from starling.sim.stereo.depth import DepthMap
from tests.unit.command_line import Capsys, refused


def _decode(data: bytes) -> np.ndarray:
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return image


def _add_reasons(frame: Path, shape: tuple[int, int] = (48, 160)) -> None:
    """Write a frame.exr that contains all reasons."""
    zeros = np.zeros(shape, np.float32)
    view = ViewLayers(
        projector_direct=zeros,
        projector_indirect=zeros,
        ambient=zeros,
        other=zeros,
        depth_m=zeros,
        body=zeros.astype(np.uint32),
    )
    reason = (np.arange(zeros.size) // 40 % 14).astype(np.uint32).reshape(shape)
    normal = np.zeros((*shape, 3), np.float32)
    lit = np.ones(shape, bool)
    truth = Truth(depth_m=zeros, normal=normal, material=reason, right_sees=lit, lit=lit)
    depth = DepthMap(disparity_px=zeros, depth_m=zeros, valid=reason == 0, reason=reason)
    exr.write(frame / "frame.exr", Layers(left=view, right=view, truth=truth), depth)


def test_draws_two_columns_of_panels(small_set: Path) -> None:
    scene = capture.open_set(small_set).scenes[0]
    image = _decode(show_captures.draw_picture(scene))
    assert image.shape[1] > 1000
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 100
    _add_reasons(small_set / "a" / "0")
    taller = _decode(
        show_captures.draw_picture(scene)
    )  # The legend of fourteen reasons needs additional height.
    assert taller.shape[0] > image.shape[0]


def test_draws_available_images(small_set: Path) -> None:
    for name in ("ir_left.png", "ir_right.png"):
        (small_set / "a" / "0" / name).unlink()
    (small_set / "a" / "truth.png").unlink()
    (small_set / "b" / "0" / "depth.png").unlink()
    first, second = capture.open_set(small_set).scenes
    assert _decode(show_captures.draw_picture(first)).size
    assert _decode(show_captures.draw_picture(second)).size
    with pytest.raises(InputError, match="must have an image in common"):
        show_captures.draw_picture(first, against=second)


def test_draws_depth_that_is_all_holes(small_set: Path) -> None:
    path = small_set / "a" / "0" / "depth.png"
    cv2.imwrite(str(path), np.zeros((48, 160), np.uint16))
    (small_set / "a" / "truth.png").unlink()
    scene = capture.open_set(small_set).scenes[0]
    assert _decode(show_captures.draw_picture(scene)).size
    cv2.imwrite(str(small_set / "a" / "truth.png"), np.zeros((48, 160), np.uint16))
    assert _decode(show_captures.draw_picture(scene)).size


def test_pictures_of_narrow_images_have_a_limited_height(small_set: Path) -> None:
    """At the width of a panel, images of 1x3000 would need gigabytes."""
    text = (small_set / "capture.toml").read_text()
    for line in ("width = 160", "height = 48", "cx_px = 79.5", "cy_px = 23.5"):
        assert line in text
        value = {"width": 1, "height": 3000, "cx_px": 0, "cy_px": 1499.5}[line.split()[0]]
        text = text.replace(line, f"{line.split()[0]} = {float(value) if 'px' in line else value}")
    (small_set / "capture.toml").write_text(text)
    for path in small_set.rglob("*.png"):
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert image is not None
        cv2.imwrite(str(path), np.full((3000, 1), image[0, 0], image.dtype))
    picture = _decode(show_captures.draw_picture(capture.open_set(small_set).scenes[0]))
    assert picture.shape[0] < 10 * picture.shape[1]


def test_sizes_must_agree(small_set: Path, write_set: Callable, tmp_path: Path) -> None:
    _add_reasons(small_set / "a" / "0", shape=(48, 152))
    scene = capture.open_set(small_set).scenes[0]
    with pytest.raises(InputError, match=r"frame.exr must be 160x48 .* 152x48"):
        show_captures.draw_picture(scene)
    second_set = write_set(tmp_path / "other")
    info = second_set / "capture.toml"
    info.write_text(info.read_text().replace("width = 160", "width = 152"))
    with pytest.raises(InputError, match="the two captures must have one image size"):
        show_captures.draw_picture(scene, against=capture.open_set(second_set).scenes[0])


def test_files_and_folders(small_set: Path, write_set: Callable, tmp_path: Path) -> None:
    second_set = str(write_set(tmp_path / "other"))
    picture = show_captures.show_captures(
        str(small_set / "a"), tmp_path / "a.png", against=second_set
    )
    assert picture == {"out": str(tmp_path / "a.png"), "files": 1}
    many = show_captures.show_captures(str(small_set), tmp_path / "many")
    assert many["files"] == 3
    names = {path.name for path in (tmp_path / "many").iterdir()}
    assert names == {"a.png", "b.png", "starling.json"}
    with pytest.raises(InputError, match="out must be a folder for 2 scenes"):
        show_captures.show_captures(str(small_set), tmp_path / "b.png")


def test_show_takes_pictures_or_a_recording(
    capsys: Capsys, tmp_path: Path, small_set: Path
) -> None:
    rerun, out = ("--rerun", tmp_path / "a.rrd"), ("--out", tmp_path / "a.png")
    message = refused("show", small_set, capsys=capsys)
    assert "out, rerun must be given, one of the two; got none." in message
    message = refused("show", small_set, *rerun, *out, capsys=capsys)
    assert "one of the two; got out, rerun." in message
    for more in ((small_set,), ("--frame", 0)):
        message = refused("show", small_set, *more, *rerun, capsys=capsys)
        assert "against, frame must not be given with rerun; got against " in message
