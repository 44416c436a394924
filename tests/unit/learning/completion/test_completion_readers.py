"""Readers of public data sets, on tiny data sets in their layouts."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from starling.learning.completion.data.readers import irs, item, nyuv2, vkitti2
from starling.learning.completion.data.readers.item import Item
from starling.learning.completion.data.readers.readings import stereo_depth
from starling.patterns.errors import InputError
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.reason import Reason
from tests.unit.learning.completion.tiny_data_sets import exr, picture

SHAPE = (24, 40)
RNG = np.random.default_rng(1)
LEFT, RIGHT = (RNG.integers(0, 256, (*SHAPE, 3)).astype(np.uint8) for _ in range(2))
DISPARITY = RNG.uniform(4, 60, SHAPE).astype(np.float32)


@pytest.fixture
def rooms(tmp_path: Path) -> Path:
    """IRS: two variants of one scene and one more scene; disparity as one and as three channels."""
    for scene, name in (("Home/Flat", "00001"), ("Home/Flat_Dark", "00001"), ("Store/Shop", "7")):
        folder = tmp_path / scene
        picture(folder / f"l_{name}.png", LEFT)
        picture(folder / f"r_{name}.png", RIGHT)
        channels = {"G": DISPARITY}
        if scene.startswith("Store"):
            channels |= {"R": 0 * DISPARITY, "B": 0 * DISPARITY}
        exr(folder / f"d_{name}.exr", **channels)
        exr(folder / f"n_{name}.exr", **channels)
    return tmp_path


def test_irs(rooms: Path) -> None:
    result = irs.sources(rooms)
    assert [entry.name for entry in result] == [
        *("Home/Flat/l_00001", "Home/Flat_Dark/l_00001", "Store/Shop/l_7")
    ]
    assert [entry.room for entry in result] == ["Flat", "Flat", "Shop"]
    for source in result:
        first = source.load()
        np.testing.assert_array_equal(first.rgb, LEFT)
        np.testing.assert_array_equal(first.right, RIGHT)
        np.testing.assert_allclose(first.truth_m, 480 * 0.1 / DISPARITY, rtol=1e-6)
        assert first.camera.cx_px == 19.5 and first.camera.cy_px == 11.5 and first.sensor_m is None
    assert len(irs.sources(rooms / "Store")) == 1


def test_no_disparity_is_no_depth(rooms: Path) -> None:
    holed = DISPARITY.copy()
    holed[0, :3] = 0, -1, np.nan
    exr(rooms / "Home/Flat/d_00001.exr", G=holed)
    truth = irs.sources(rooms)[0].load().truth_m
    assert np.isnan(truth[0, :3]).all() and np.isfinite(truth).sum() == truth.size - 3


def test_irs_refuses(rooms: Path, tmp_path: Path) -> None:
    (rooms / "Empty").mkdir()
    with pytest.raises(InputError, match=r"IRS must hold SCENE/l_N.png"):
        irs.sources(rooms / "Empty")
    with pytest.raises(InputError, match="data set must be a folder"):
        irs.sources(rooms / "none")
    flat, dark, shop = irs.sources(rooms)
    exr(rooms / "Home/Flat/d_00001.exr", Y=DISPARITY)
    with pytest.raises(InputError, match=r"disparity must have the channel G; got .* with Y"):
        flat.load()
    (rooms / "Home/Flat_Dark/d_00001.exr").write_bytes(b"no image")
    with pytest.raises(InputError, match="disparity must be a readable OpenEXR file"):
        dark.load()
    picture(rooms / "Store/Shop/r_7.png", RIGHT[:5])
    with pytest.raises(InputError, match="images of an item must have one size"):
        shop.load()
    (rooms / "Store/Shop/l_7.png").write_bytes(b"no image")
    with pytest.raises(InputError, match="image must be a whole image file"):
        shop.load()
    (rooms / "Store/Shop/l_7.png").unlink()
    with pytest.raises(InputError, match="image must be readable"):
        shop.load()


def streets(root: Path, *, merged: bool) -> np.ndarray:
    """Virtual KITTI 2: one scene, two variations; returns the depth codes."""
    steps = RNG.integers(1, 60000, SHAPE).astype(np.uint16)
    steps[0] = 65535
    even = np.full((*SHAPE, 3), 90, np.uint8)
    for variation in ("clone", "fog"):
        for kind, name, image in (("rgb", "rgb_00003.jpg", even), ("depth", "depth_00003.png", 0)):
            part = root if merged else root / f"vkitti_2.0.3_{kind}"
            for camera in ("Camera_0", "Camera_1"):
                path = part / "Scene01" / variation / "frames" / kind / camera / name
                picture(path, steps if kind == "depth" else np.asarray(image))
    return steps


@pytest.mark.parametrize("merged", [False, True])
def test_vkitti2(tmp_path: Path, merged: bool) -> None:
    steps = streets(tmp_path, merged=merged)
    result = vkitti2.sources(tmp_path)
    assert [entry.name for entry in result] == ["Scene01/clone/00003", "Scene01/fog/00003"]
    assert {entry.room for entry in result} == {"Scene01"}
    first = result[0].load()
    assert first.right is not None and np.abs(first.rgb.astype(int) - 90).max() <= 2
    assert np.isnan(first.truth_m[0]).all()
    np.testing.assert_allclose(first.truth_m[1:], steps[1:] / 100, rtol=1e-6)
    assert (first.camera.fx_px, first.camera.cx_px, first.baseline_m) == (725.0087, 620.5, 0.532725)


def test_vkitti2_reads_intrinsics_from_text_files(tmp_path: Path) -> None:
    streets(tmp_path, merged=False)
    text = tmp_path / "vkitti_2.0.3_textgt/Scene01/clone/intrinsic.txt"
    text.parent.mkdir(parents=True)
    head = "frame cameraID K[0,0] K[1,1] K[0,2] K[1,2]\n"
    text.write_text(head + "3 1 1 1 1 1\n3 0 700.5 701.5 20 10\n")
    (clone, fog) = vkitti2.sources(tmp_path)
    camera = clone.load().camera
    assert (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px) == (700.5, 701.5, 20, 10)
    assert fog.load().camera.fx_px == 725.0087
    text.write_text(head + "4 0 700.5 701.5 20 10\n")
    with pytest.raises(InputError, match=r"intrinsic.txt must have a line for frame 3"):
        clone.load()
    text.write_text(head + "3 0 700.5\n")
    with pytest.raises(InputError, match=r"intrinsic.txt must have lines of frame, camera"):
        clone.load()


def test_vkitti2_refuses(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="Virtual KITTI 2 must hold SceneNN"):
        vkitti2.sources(tmp_path)
    streets(tmp_path, merged=True)
    depth = tmp_path / "Scene01/clone/frames/depth/Camera_0/depth_00003.png"
    picture(depth, LEFT)
    with pytest.raises(InputError, match="depth must be one channel of 16 bits"):
        vkitti2.sources(tmp_path)[0].load()


def labelled(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """NYU Depth V2: two images in MATLAB's HDF5 layout; raw and filled depth, (2, h, w)."""
    h5py = pytest.importorskip("h5py", reason="h5py reads NYU Depth V2")
    raw = RNG.uniform(1, 5, (2, *SHAPE)).astype(np.float32)
    filled = raw.copy()
    raw[:, 3:9, 4:20] = 0
    with h5py.File(path, "w") as file:
        file["images"] = np.stack([LEFT, RIGHT]).transpose(0, 3, 2, 1)
        file["rawDepths"] = raw.transpose(0, 2, 1)
        file["depths"] = filled.transpose(0, 2, 1)
        names = []
        for number, name in enumerate(("kitchen_0004", "den_0001")):
            text = np.array([list(map(ord, name))], np.uint16).T
            names.append(file.create_dataset(f"#refs#/{number}", data=text).ref)
        file.create_dataset("scenes", data=np.array([names], dtype=h5py.ref_dtype))
    return raw, filled


def test_nyuv2(tmp_path: Path) -> None:
    raw, filled = labelled(tmp_path / "nyu.mat")
    result = nyuv2.sources(tmp_path / "nyu.mat")
    assert [(entry.name, entry.room) for entry in result] == [
        *(("0000", "kitchen_0004"), ("0001", "den_0001"))
    ]
    for number, source in enumerate(result):
        first = source.load()
        np.testing.assert_array_equal(first.rgb, (LEFT, RIGHT)[number])
        np.testing.assert_array_equal(first.truth_m, filled[number])
        assert first.sensor_m is not None
        assert first.sensor_m.flags.c_contiguous and first.truth_m.flags.c_contiguous
        np.testing.assert_array_equal(np.nan_to_num(first.sensor_m), raw[number])
        assert np.isnan(first.sensor_m[5, 10]) and first.camera.fx_px == pytest.approx(518.8579)


def test_nyuv2_without_scenes_has_one_room_per_image(tmp_path: Path) -> None:
    path = tmp_path / "nyu.mat"
    labelled(path)
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "a") as file:
        del file["scenes"]
    assert [source.room for source in nyuv2.sources(path)] == ["0000", "0001"]
    with h5py.File(path, "a") as file:
        del file["rawDepths"]
    with pytest.raises(InputError, match=r"must have images, rawDepths and depths; got .* without"):
        nyuv2.sources(path)
    path.write_bytes(b"no file of MATLAB")
    with pytest.raises(InputError, match="NYU Depth V2 must be a readable HDF5 file"):
        nyuv2.sources(path)


def test_nyuv2_names_the_missing_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(InputError, match=r"NYU Depth V2 needs h5py; got none\. .*\[completion\]"):
        nyuv2.sources(tmp_path / "nyu.mat")


def shifted(disparity_px: int) -> Item:
    """A textured wall; the right image is the shifted left one."""
    shape = (96, 160)
    rng = np.random.default_rng(5)
    wide = rng.integers(0, 256, (shape[0], shape[1] + disparity_px, 3)).astype(np.uint8)
    camera = Pinhole(width=160, height=96, fx_px=100, fy_px=100, cx_px=79.5, cy_px=47.5)
    return Item(
        rgb=np.ascontiguousarray(wide[:, : shape[1]]),
        right=np.ascontiguousarray(wide[:, disparity_px:]),
        truth_m=np.full(shape, 100 * 0.1 / disparity_px, np.float32),
        camera=camera,
        baseline_m=0.1,
    )


def test_a_shifted_texture_has_the_depth_of_its_shift() -> None:
    pair = shifted(12)
    result = stereo_depth(pair)
    inside = result.valid[:, 20:]
    assert inside.mean() > 0.9 and not result.valid[:, :12].any()
    np.testing.assert_allclose(result.depth_m[:, 20:][inside], pair.truth_m[0, 0], rtol=0.01)
    assert ((result.reason == Reason.VALID) == np.isfinite(result.depth_m)).all()
    assert (result.reason[:, :8] == Reason.OUTSIDE_OVERLAP).mean() > 0.5


def test_stereo_depth_needs_a_pair() -> None:
    alone = item.Item(
        rgb=LEFT,
        truth_m=DISPARITY,
        camera=Pinhole(width=40, height=24, fx_px=1, fy_px=1, cx_px=0, cy_px=0),
        baseline_m=0.1,
    )
    with pytest.raises(InputError, match="item must have a right image to be matched"):
        stereo_depth(alone)
