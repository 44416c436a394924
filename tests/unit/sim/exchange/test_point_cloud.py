"""Point clouds, read back by trimesh and by the definition of PCD."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from starling import command_line
from starling.patterns.errors import InputError
from starling.sim.captures import capture, png
from starling.sim.captures.exchange import point_cloud
from starling.sim.console.output import OutputFolder


def exported(folder: Path, out: Path, form: point_cloud.Format) -> Path:
    with OutputFolder(out) as files:
        point_cloud.export(capture.open_set(folder).scenes, files, form)
    scene = capture.open_set(folder).scenes[0]
    return out / scene.name / f"{scene.frames[0]}.{form}"


def test_points_and_greys_are_those_of_the_frame(small_set: Path, tmp_path: Path):
    cloud = trimesh.load(exported(small_set, tmp_path / "out", "ply"))
    scene = capture.open_set(small_set).scenes[0]
    frame, info = scene.frame(scene.frames[0]), scene.info
    rows, columns = np.nonzero(np.isfinite(frame.depth_m))
    x, y, z = np.asarray(cloud.vertices).T
    np.testing.assert_allclose(z, frame.depth_m[rows, columns])
    np.testing.assert_allclose(x / z * info.fx_px + info.cx_px, columns, atol=1e-3)
    np.testing.assert_allclose(y / z * info.fy_px + info.cy_px, rows, atol=1e-3)
    largest = np.iinfo(frame.ir_left.dtype).max
    grey = (frame.ir_left[rows, columns] / largest * 255).astype(int)
    np.testing.assert_array_equal(np.asarray(cloud.colors)[:, 0], grey)


def test_pcd_holds_the_same_points_and_colours(small_set: Path, tmp_path: Path):
    cloud = trimesh.load(exported(small_set, tmp_path / "ply", "ply"))
    header, _, data = (
        exported(small_set, tmp_path / "pcd", "pcd").read_bytes().partition(b"DATA binary\n")
    )
    assert f"POINTS {len(cloud.vertices)}".encode() in header
    table = np.frombuffer(data, [("xyz", "<f4", 3), ("bgr", "u1", 4)])
    np.testing.assert_array_equal(table["xyz"], np.asarray(cloud.vertices, np.float32))
    np.testing.assert_array_equal(table["bgr"][:, 2::-1], np.asarray(cloud.colors)[:, :3])


def test_colours_are_those_of_the_colour_camera(small_set: Path, tmp_path: Path):
    info = capture.open_set(small_set).info
    with (small_set / "capture.toml").open("a") as file:
        file.write("colour_from_left = [[1,0,0,0.1],[0,1,0,0],[0,0,1,0],[0,0,0,1]]\n")
        file.write(f"[colour]\nwidth = {info.width}\nheight = {info.height}\n")
        file.write(f"fx_px = {info.fx_px}\nfy_px = {info.fy_px}\n")
        file.write(f"cx_px = {info.cx_px}\ncy_px = {info.cy_px}\n")
    columns = np.arange(info.width) % 251
    picture = np.zeros((*info.shape, 3), np.uint8)
    picture[..., 0], picture[..., 2] = columns, 7
    for scene in capture.open_set(small_set).scenes:
        for number in scene.frames:
            (scene.path / str(number) / "rgb.png").write_bytes(png.encode_colour(picture))
    cloud = trimesh.load(exported(small_set, tmp_path / "out", "ply"))
    x, _, z = np.asarray(cloud.vertices).T
    seen = np.rint((x + 0.1) / z * info.fx_px + info.cx_px)
    inside = (seen >= 0) & (seen < info.width)
    colours = np.asarray(cloud.colors)
    assert inside.any()
    apart = np.abs(colours[inside, 0] - seen[inside] % 251)
    assert (apart > 0).mean() < 0.01  # Halves of a pixel may round to either side.
    assert (colours[inside, 2] == 7).all()


def test_the_verb_writes_both_formats(
    small_set: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    for form in ("ply", "pcd"):
        command = ["export", str(small_set), "--layout", form, "--out", str(tmp_path / form)]
        assert command_line.main([*command, "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["frames"] == len(
            list((tmp_path / form).rglob(f"*.{form}"))
        )


def test_frames_without_depth_are_refused(small_set: Path, tmp_path: Path):
    for path in small_set.rglob("depth.png"):
        path.unlink()
    with pytest.raises(InputError, match=r"must have depth; got none\. A point cloud needs depth"):
        exported(small_set, tmp_path / "out", "ply")
    image = np.full((2, 3), np.nan, np.float32)
    assert len(point_cloud._grey(None, *np.nonzero(np.isnan(image)))) == 6
