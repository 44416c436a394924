"""Estimation of a room's reflectance and ambient light from a simulated image."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from starling.patterns.errors import InputError
from starling.sim import simulate
from starling.sim.captures import info as capture_info
from starling.sim.captures import png
from starling.sim.captures.capture import CapturedScene, open_set
from starling.sim.captures.writer import info_of
from starling.sim.imaging import imager
from starling.sim.imaging.signals import Signals
from starling.sim.scene.captured import captured_scene, room_light
from starling.sim.scene.captured.room_light import RoomLight
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import to_code

pytestmark = pytest.mark.slow

# A crop of a D415's image; the position of the pattern is unknown.
SENSOR = with_values(
    presets.load("d415"),
    [("width", 480), ("height", 270), ("cx_px", 239.5), ("cy_px", 134.5)],
)
BELIEVED = with_values(SENSOR, [("projector.rotation_deg", [1.3, 0.7, 0.0])])
SHAPE = (SENSOR.height, SENSOR.width)
DARK = with_values(SENSOR, [("projector.power_w", 0.0)])


def truth_m() -> np.ndarray:
    """A slanted wall from 2 m to 0.8 m, with a block in front of it."""
    depth = np.broadcast_to(1 / np.linspace(1 / 2.0, 1 / 0.8, SHAPE[1]), SHAPE).copy()
    depth[90:200, 60:150] = 0.7
    return depth.astype(np.float32)


def painted() -> np.ndarray:
    """Piecewise constant reflectance with mean 0.5."""
    fields = np.array([[0.3, 0.8, 0.4], [0.7, 0.35, 0.45]])
    return np.kron(fields / fields.mean() * 0.5, np.ones((135, 160))).astype(np.float32)


def room(
    folder: Path,
    ambient_w_m2: float,
    *,
    device: Sensor = SENSOR,
    off: bool = False,
    share: np.ndarray | None = None,
    grain: np.ndarray | float = 1.0,
) -> CapturedScene:
    """Write a simulated capture; the right image is seen by the device too."""
    folder.mkdir()
    info = info_of(device, source="made here", licence="-", notes="")
    (folder / capture_info.FILE).write_text(capture_info.dumps(info))
    scene = folder / "room"
    (scene / "0").mkdir(parents=True)
    (scene / "truth.png").write_bytes(png.encode(to_code(truth_m(), info.depth_unit_m)))
    even = np.zeros(SHAPE, np.uint8)
    (scene / "0" / "ir_left.png").write_bytes(png.encode(even))
    (scene / "0" / "ir_right.png").write_bytes(png.encode(even))
    (known,) = open_set(folder).scenes
    lit = captured_scene.scene_from_light(known, RoomLight(painted() * grain, ambient_w_m2, share))
    for name, sensor in (("ir_left", device), ("ir_left_off", DARK))[: 1 + off]:
        shot = simulate.simulate(lit, sensor, seed=5)
        (scene / "0" / f"{name}.png").write_bytes(png.encode(shot.ir_left))
        if name == "ir_left" and shot.ir_right is not None:
            (scene / "0" / "ir_right.png").write_bytes(png.encode(shot.ir_right))
    return known


@pytest.mark.parametrize("ambient", [0.1, 0.4, 2.0])
def test_dots_give_the_ambient_light(ambient, tmp_path):
    """The estimate is right to 10 %, with the right pattern at another position.

    The reflectance excludes the laser's light, which brightens near surfaces. Brightness alone
    would be off by 20 %.
    """
    scene = room(tmp_path / "set", ambient)
    estimated = captured_scene.estimate_light(
        scene, BELIEVED, smoothing_px=6.0, within_surfaces=True
    )
    assert estimated.ambient_w_m2 == pytest.approx(ambient, rel=0.1)
    inside = cv2.erode(np.ones(SHAPE, np.uint8), np.ones((41, 41), np.uint8)) > 0
    fields = np.abs(cv2.Laplacian(cv2.blur(painted(), (31, 31)), cv2.CV_32F)) < 1e-6
    off = (estimated.reflectance / painted())[inside & fields]
    assert np.quantile(np.abs(off / np.median(off) - 1), 0.9) < 0.1


def test_rooms_are_not_darker_at_image_borders(tmp_path):
    """The scene extends beyond the image, since lens blur brings in light from there."""
    lens = [("imager.lens.blur_px", 1.5), ("imager.smoothing_px", 1.5)]
    noiseless = [("imager.shot_noise", 0.0), ("imager.read_noise_e", 0.0)]
    fine = [("imager.bit_depth", 12), ("imager.dropped_bits", 0)]  # One code of 8 bits is 4 %.
    still = with_values(DARK, [*lens, *noiseless, *fine])
    scene = captured_scene.scene_from_light(
        room(tmp_path / "set", 1.0), RoomLight(np.full(SHAPE, 0.5, np.float32), 1.0)
    )
    left = simulate.simulate(scene, still).ir_left.astype(float)
    for side in (left, left[::-1], left.T[:, 220:], left.T[::-1, 220:]):
        assert side[0].mean() == pytest.approx(side[12].mean(), rel=0.02)


def test_without_a_projector_the_estimate_is_the_default(tmp_path):
    scene = room(tmp_path / "set", 1.0)
    assert (
        captured_scene.estimate_light(scene, DARK, smoothing_px=6.0).ambient_w_m2
        == room_light.LIT_ROOM_W_M2
    )


def test_without_visible_dots_ambient_light_is_bright(tmp_path):
    scene = room(tmp_path / "set", 1.0, device=DARK)
    assert captured_scene.estimate_light(scene, SENSOR, smoothing_px=6.0).ambient_w_m2 > 10


def test_projector_off_images_give_reflectance_directly(tmp_path):
    """Each pixel's reflectance, up to noise; the lens's vignetting is not included."""
    scene = room(tmp_path / "set", 0.5, off=True)
    estimated = captured_scene.estimate_light(scene, BELIEVED)
    assert estimated.ambient_w_m2 == pytest.approx(0.5, rel=0.1)
    smooth = cv2.GaussianBlur(estimated.reflectance, (0, 0), 3.0)
    inner = (slice(15, 120), slice(15, 145))
    for rows in (0, 135):
        for columns in (0, 160, 320):
            place = tuple(
                slice(at.start + device, at.stop + device)
                for at, device in zip(inner, (rows, columns), strict=True)
            )
            away = np.abs(truth_m()[place] - 0.7) > 0.05
            assert_allclose(smooth[place][away], painted()[place][away], rtol=0.12)


@pytest.mark.parametrize(("left_only", "least"), [(False, 0.85), (True, 0.8)])
def test_texture_between_known_dots_is_estimated(left_only, least, tmp_path):
    """Grain of 2 px and contrast 0.15 returns, away from the block's edges.

    The dots are exactly those of the capture; a real sensor's are estimated.
    """
    noise = np.random.default_rng(3).standard_normal(SHAPE).astype(np.float32)
    noise = cv2.GaussianBlur(noise, (0, 0), 2.0)
    grain = np.clip(1 + 0.15 * noise / noise.std(), 0.6, 1.15)
    scene = room(tmp_path / "set", 0.4, grain=grain)
    estimated = captured_scene.estimate_light(scene, SENSOR, left_only=left_only)
    part = (slice(150, 250), slice(330, 460))
    refined = estimated.reflectance[part]
    assert np.corrcoef(refined.ravel(), grain[part].ravel())[0, 1] > least
    assert (refined / refined.mean()).std() == pytest.approx(grain[part].std(), rel=0.25)


def test_a_sensor_takes_the_geometry_of_the_captures(tmp_path):
    scene = room(tmp_path / "set", 0.4)
    wide = with_values(SENSOR, [("width", 1280), ("cx_px", 639.5)])
    estimated = captured_scene.estimate_light(scene, wide, smoothing_px=6.0)
    assert estimated.reflectance.shape == SHAPE
    assert estimated.ambient_w_m2 == pytest.approx(0.4, rel=0.1)


def test_invalid_smoothing_is_refused(tmp_path):
    scene = room(tmp_path / "set", 0.4)
    with pytest.raises(InputError, match=r"^smoothing_px must "):
        captured_scene.estimate_light(scene, SENSOR, smoothing_px=-1.0)


def test_smoothed_brightness_is_unmixed_at_depth_edges(tmp_path):
    """Levels at both sides of a depth edge, mixed over 24 px, are recovered next to the edge."""
    scene = room(tmp_path / "set", 0.4)
    left = np.zeros(SHAPE, bool)
    left[:, : SHAPE[1] // 2] = True
    (scene.path / "truth.png").write_bytes(png.encode(np.where(left, 700, 2000).astype(np.uint16)))
    image = np.where(left, 104, 54).astype(np.uint8)
    (scene.path / "0" / "ir_left.png").write_bytes(png.encode(image))
    plain = with_values(DARK, [("imager.lens.vignetting", 0.0), ("left.black_level_dn", 4.0)])
    near_edge = (slice(100, 150), slice(SHAPE[1] // 2 - 1, SHAPE[1] // 2 + 1))
    parted, mixed = (
        captured_scene.estimate_light(
            scene, plain, smoothing_px=6.0, within_surfaces=within
        ).reflectance[near_edge]
        for within in (True, False)
    )
    assert_allclose(parted, np.tile([0.5 * 100 / 75, 0.5 * 50 / 75], (50, 1)), rtol=0.03)
    assert_allclose(mixed.mean(), 0.5, rtol=0.03)


def test_reflectance_excludes_other_light():
    """Sun and other projectors are removed from the reflectance, as are dots and ambient light."""
    rng = np.random.default_rng(0)
    laser, ambient, rest = (rng.uniform(0.5, 1.5, SHAPE).astype(np.float32) for _ in range(3))
    light = Signals(laser=laser, ambient=ambient, other=rest)
    level = painted() * (laser + 0.8 * ambient + rest)
    estimated = room_light.reflectance(level.astype(np.float32), light, 0.8, lambda image: image)
    assert_allclose(estimated, painted(), rtol=1e-3)


def test_reflectance_is_clipped_to_plausible_values():
    brightness = np.ones(SHAPE, np.float32)
    brightness[0, 0], brightness[-1, -1] = 0.0, 5.0
    estimated = room_light.plausible_reflectance(brightness)
    assert estimated[0, 0] == np.float32(0.01) and estimated[-1, -1] == np.float32(0.95)
    assert_allclose(estimated[1:-1], 0.5, rtol=1e-3)


def test_without_ambient_light_the_estimate_is_the_lower_limit():
    """The estimate is the lower limit of the search, 0.01 W m^-2, if only dots are visible."""
    dots = np.zeros(SHAPE, np.float32)
    dots[5::9, 5::9] = 1.0
    spots = np.asarray(cv2.GaussianBlur(dots, (0, 0), 1.55), np.float32)
    light = Signals(laser=spots, ambient=np.ones_like(spots), other=np.zeros_like(spots))
    left = SENSOR.left
    electrons = spots / spots.max() * np.float32(150 / left.dn_per_electron)
    read = imager.read_out(
        left, electrons, exposure_s=left.exposure_s, unit=0, side="left", seed=9, frame=0
    ).delivered.astype(np.float32)
    estimated = room_light.ambient_w_m2(read - np.float32(left.black_level_dn), light, left)
    assert estimated < 0.0105


@pytest.mark.parametrize(
    ("darkest_dn", "wanted_dn"),
    [(3.0, 1.0), (6.0, 2.0), (0.0, 0.0)],  # A drifted black level, a lit place, a blank border.
)
def test_the_darkest_place_bounds_the_black_level(tmp_path, darkest_dn, wanted_dn):
    """A cloth 1 DN above a black level of 3 is no mirror of nothing, although 4 DN are stated."""
    scene = room(tmp_path / "set", 1.0)
    stated = dataclasses.replace(scene.info, black_level_dn=4.0)
    seen = dataclasses.replace(scene, info=stated)
    image = np.full(SHAPE, 200, np.uint8)
    image[20:60, 20:60] = darkest_dn
    cloth = slice(100, 140), slice(100, 140)
    image[cloth] = 4 if darkest_dn < 4 else 6
    level = captured_scene._level(seen, image, 0.0)
    assert level[cloth].mean() == pytest.approx(wanted_dn)
