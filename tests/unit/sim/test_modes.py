"""Modes of a camera: laws of scaling, calibrations of real devices, refusals."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

import starling
from starling.patterns.errors import InputError
from starling.sim.sensor import presets, scaling
from starling.sim.sensor.sensor import Alignment, Imager, Lens, Sensor

# Depth intrinsics (fx, cx, cy) [px] by mode, as devices list them.
D415 = {  # `rs-enumerate-devices -c`, jie0530/d3roma, datasets/Real/xiaomeng/intrinsics.txt.
    "1280x720": (887.829284667969, 631.876708984375, 373.140869140625),
    "848x480": (591.886169433594, 418.58447265625, 248.76057434082),
    "848x100": (591.886169433594, 418.58447265625, 58.7605743408203),
    "640x480": (591.886169433594, 314.58447265625, 248.76057434082),
    "640x360": (443.914642333984, 315.938354492188, 186.570434570312),
    "480x270": (332.935974121094, 236.953765869141, 139.927825927734),
    "424x240": (295.943084716797, 209.292236328125, 124.38028717041),
    "256x144": (887.829284667969, 119.876708984375, 85.140869140625),
}
OV9282 = {  # The same program on a unit with the D435's imager, realsense-ros#2788.
    "848x100": (424.229095458984, 423.426300048828, 46.0462493896484),
    "640x480": (384.207489013672, 319.480407714844, 236.351501464844),
    "640x360": (320.172912597656, 319.567016601562, 177.016036987305),
    "480x270": (240.129684448242, 239.675262451172, 132.762023925781),
    "424x240": (212.114547729492, math.nan, 117.93009185791),
}


def size_of(mode: str) -> tuple[int, int]:
    width, height = mode.split("x")
    return int(width), int(height)


@pytest.mark.parametrize(
    ("preset", "listed", "start", "tolerance_px"),
    [("d415", D415, "1280x720", 1e-4), ("d435", OV9282, "640x360", 0.1)],
)
def test_scales_are_those_of_real_devices(
    preset: str, listed: dict, start: str, tolerance_px: float
) -> None:
    """Focal lengths agree to 1e-6. Centres agree where the device counts from the image's corner.

    Coordinates from the corner scale as c r, those of pixel centres as (c + 0.5) r - 0.5. The
    listed centres scale as c r, so that they agree after half a pixel is taken off.
    """
    modes = presets.load_file(preset).modes
    width, height = size_of(start)
    fx, cx, cy = listed[start]
    unit = dataclasses.replace(
        presets.load(preset, mode=start), fx_px=fx, fy_px=fx, cx_px=cx - 0.5, cy_px=cy - 0.5
    )
    assert (unit.width, unit.height) == (width, height)
    for mode, (focal_px, centre_x_px, centre_y_px) in listed.items():
        ratio = modes[mode].scale / modes[start].scale
        scaled = scaling.scaled(unit, ratio, *size_of(mode))
        assert scaled.fx_px == pytest.approx(focal_px, rel=1e-6)
        for name, centre_px in (("cx_px", centre_x_px), ("cy_px", centre_y_px)):
            if math.isfinite(centre_px):
                expected = pytest.approx(centre_px - 0.5, abs=tolerance_px)
                assert getattr(scaled, name) == expected, (mode, name)


def test_presets_have_a_mode_for_each_listed_size() -> None:
    assert set(presets.load_file("d415").modes) == set(D415)
    assert set(OV9282) < set(presets.load_file("d435").modes)


@pytest.mark.parametrize("preset", ["d415", "d435", "d455"])
def test_the_search_sets_the_nearest_distance_of_each_mode(preset: str) -> None:
    """The device searches 126 disparities (librealsense#2885); presets give two digits."""
    for mode in presets.load_file(preset).modes:
        sensor = presets.load(preset, mode=mode)
        nearest_m = sensor.focal_baseline_px_m / 126
        assert sensor.post.near_m == pytest.approx(nearest_m, rel=0.02)


def test_whole_pixels_are_averaged_about_their_centres() -> None:
    """Half the size: pixels 0 and 1 become pixel 0, whose centre is at 0.5."""
    sensor = scaled_from(Imager(), 0.5)
    assert (sensor.cx_px, sensor.fx_px) == ((321.0 + 0.5) / 2 - 0.5, 250.0)
    cropped = scaling.scaled(scaled_from(Imager(), 1.0), 1.0, 320, 240)
    assert (cropped.cx_px, cropped.cy_px) == (321.0 - 160, 239.5 - 120)


def scaled_from(imager: Imager, ratio: float) -> Sensor:
    sensor = Sensor(
        name="a", width=640, height=480, fx_px=500.0, fy_px=500.0, cx_px=321.0, cy_px=239.5,
        baseline_m=0.05, left=imager, right=imager,
    )  # fmt: skip
    return scaling.scaled(sensor, ratio, round(640 * ratio), round(480 * ratio))


def test_noise_is_that_of_the_sum_of_pixels() -> None:
    """Blocks of 2x2 pixels with noise of each kind, summed."""
    imager = Imager(
        full_well_e=4000.0, dark_current_e_s=2.0, read_noise_e=5.0, dsnu_e=4.0, prnu=0.01,
        column_noise_e=3.0, row_noise_e=2.0, hot_pixels=0.001,
    )  # fmt: skip
    half = scaled_from(imager, 0.5).left
    rng = np.random.default_rng(1)

    def deviation(pixels: np.ndarray) -> float:
        height, width = pixels.shape
        return float(pixels.reshape(height // 2, 2, width // 2, 2).sum((1, 3)).std())

    shape = (2000, 2000)
    assert half.read_noise_e == pytest.approx(deviation(5.0 * rng.standard_normal(shape)), rel=0.01)
    assert half.dsnu_e == pytest.approx(2 * imager.dsnu_e)
    signal = 1000 * (1 + 0.01 * rng.standard_normal(shape))
    assert half.prnu == pytest.approx(deviation(signal) / 4000, rel=0.01)
    columns = np.repeat(3.0 * rng.standard_normal((1, 200_000)), 2, axis=0)
    assert half.column_noise_e == pytest.approx(deviation(columns), rel=0.02)
    assert half.row_noise_e == pytest.approx(2.0 * 2**1.5)
    assert (half.full_well_e, half.dark_current_e_s) == (16000.0, 8.0)
    assert half.hot_pixels == pytest.approx(0.004)
    assert half.dn_per_electron == pytest.approx(imager.dn_per_electron / 4)


def test_the_lens_is_the_same_in_metres() -> None:
    lens = Lens(blur_px=1.0, corner_blur_px=0.8, defocus_px_m=0.2)
    alignment = Alignment(offset_x_px=0.6, distortion_px=0.4, warp_px=((0.2, 0.4),))
    imager = Imager(lens=lens, alignment=alignment, pixel_pitch_m=3e-6)
    half = scaled_from(imager, 0.5)
    assert (half.left.lens.blur_px, half.left.lens.defocus_px_m) == (0.5, 0.1)
    assert half.left.lens.corner_blur_px == pytest.approx(0.4)
    assert half.left.pixel_pitch_m * half.fx_px == pytest.approx(3e-6 * 500)
    turned = half.left.alignment
    assert (turned.offset_x_px, turned.warp_px) == (0.3, ((0.1, 0.2),))
    assert turned.distortion_px == pytest.approx(0.2)


def test_a_crop_keeps_pixels_and_shortens_the_readout() -> None:
    """Corner blur is linear in the radius, distortion cubic."""
    lens, alignment = Lens(corner_blur_px=0.8), Alignment(distortion_px=0.4)
    imager = Imager(lens=lens, alignment=alignment, rolling_shutter_s=0.02, read_noise_e=3.0)
    whole = scaled_from(imager, 1.0)
    part = scaling.scaled(whole, 1.0, 320, 240)
    assert part.left.lens.corner_blur_px == pytest.approx(0.4)
    assert part.left.alignment.distortion_px == pytest.approx(0.05)
    assert part.left.rolling_shutter_s == 0.01
    assert (part.left.read_noise_e, part.projector) == (3.0, whole.projector)


def test_speckle_averages_over_more_grains_in_larger_pixels() -> None:
    """D435: 0.14 at pixels of 4.49 um; by the preset's formula for those of 1280x720."""
    looks = [1 + (pitch_m / 1.7e-6) ** 2 for pitch_m in (4.49e-6, 4.49e-6 * 0.6625)]
    contrast = presets.load("d435", mode="1280x720").projector.speckle_contrast
    assert contrast == pytest.approx(0.14 * math.sqrt(looks[0] / looks[1]))


def test_ways_there_and_back_end_at_the_start() -> None:
    file = presets.load_file("d435")
    back = starling.sim.sensor.sensor_file.in_mode(
        starling.sim.sensor.sensor_file.in_mode(file, "1280x720@30"), "848x480@30"
    ).sensor
    assert back.left.full_well_e == pytest.approx(file.sensor.left.full_well_e)
    assert back.cx_px == pytest.approx(file.sensor.cx_px)
    assert presets.load("d435", mode="848x480") == file.sensor


def test_the_rate_limits_exposure_and_readout() -> None:
    """A limit is the same share of a frame; 6 per second permit the device's 165 ms."""
    fast, slow = (presets.load("d415", mode=f"848x480@{fps}").left for fps in (90, 6))
    assert fast.auto_exposure_max_s == pytest.approx(0.011)
    assert fast.exposure_s == pytest.approx(0.011)
    assert fast.rolling_shutter_s == pytest.approx(1 / 90)
    assert slow.auto_exposure_max_s == pytest.approx(0.165)
    assert (slow.exposure_s, slow.rolling_shutter_s) == (0.033, 0.03)
    assert presets.load("d435", mode="848x100").left.auto_exposure_max_s == pytest.approx(0.0099)


MODES = """
[modes."848x480"]
scale = 0.6625
[modes."424x240"]
scale = 0.33125
fps = [30]
"""
PLAIN = (
    "name='a'\nwidth=848\nheight=480\nfx_px=430.0\nfy_px=430.0\ncx_px=423.5\ncy_px=239.5\n"
    "baseline_m=0.05\n"
)


def load(folder: Path, text: str, mode: str = "") -> Sensor:
    (folder / "a.toml").write_text(text)
    return presets.load(str(folder / "a.toml"), mode=mode)


def test_a_file_is_in_the_mode_that_it_names(tmp_path: Path) -> None:
    """Its own keys are numbers of that mode; they are converted to another."""
    text = 'base = "d435"\nmode = "640x480@60"\ncx_px = 322.0\n'
    mine = load(tmp_path, text)
    assert mine == dataclasses.replace(presets.load("d435", mode="640x480@60"), cx_px=322.0)
    large = load(tmp_path, text, "1280x720")
    assert large.cx_px == pytest.approx(639.5 + (322 - 319.5) / 0.6)
    assert large.left.auto_exposure_max_s == pytest.approx(0.033)


def test_keys_of_a_mode_hold_in_it_only(tmp_path: Path) -> None:
    """The keys of a file itself win over those of its base's modes."""
    only = '[modes."424x240".matcher]\nsearch_px = 64\n[modes."424x240".left]\ngain = 2.0\n'
    text = PLAIN + MODES + only
    small = load(tmp_path, text, "424x240")
    assert (small.matcher.search_px, small.left.gain, small.right.gain) == (64, 2.0, 2.0)
    assert load(tmp_path, text).matcher.search_px == 128
    (tmp_path / "b.toml").write_text('base = "a.toml"\nmode = "424x240"\nunit = 3\n')
    back = presets.load(str(tmp_path / "b.toml"), mode="848x480")
    assert (back.matcher.search_px, back.left.gain, back.unit) == (128, 1.0, 3)
    (tmp_path / "c.toml").write_text('base = "a.toml"\n[matcher]\n"search_px" = 96\n')
    mine = presets.load(str(tmp_path / "c.toml"), mode="424x240")
    assert (mine.matcher.search_px, mine.left.gain) == (96, 2.0)
    more = (
        'base = "a.toml"\n[modes."424x240"]\n"left.gain" = 3.0\n[modes."212x120"]\nscale = 0.16\n'
    )
    (tmp_path / "d.toml").write_text(more)
    assert presets.load(str(tmp_path / "d.toml"), mode="424x240").left.gain == 3.0
    assert presets.load(str(tmp_path / "d.toml"), mode="212x120").width == 212


def test_a_file_drops_modes_of_its_base(tmp_path: Path) -> None:
    """Its own modes stay, and a chain of bases drops further ones."""
    text = 'base = "d435"\nmode = "424x240"\n[modes]\nonly = ["640x480", "848x480", "424x240"]\n'
    (tmp_path / "a.toml").write_text(text)
    file = presets.load_file(str(tmp_path / "a.toml"))
    assert set(file.modes) == {"640x480", "848x480", "424x240"}
    assert file.sensor == presets.load("d435", mode="424x240")
    large = presets.load(str(tmp_path / "a.toml"), mode="848x480")
    assert large == presets.load("d435", mode="848x480")
    further = '[modes]\nonly = ["424x240"]\n[modes."320x180"]\nscale = 0.25\n'
    (tmp_path / "b.toml").write_text(f'base = "a.toml"\n{further}')
    assert set(presets.load_file(str(tmp_path / "b.toml")).modes) == {"424x240", "320x180"}


_BASE = 'base = "d435"\n[modes]\n'


@pytest.mark.parametrize(
    ("text", "mode", "message"),
    [
        (_BASE + 'only = ["848x480"]', "640x480", r"^mode must be a mode of d435; got '640x480'"),
        (
            _BASE + 'only = "848x480"',
            "",
            r"^modes.only must list modes; got '848x480'\. Write only",
        ),
        (_BASE + "only = []", "", r"^modes.only must list modes; got \[\]"),
        (
            _BASE + 'only = ["848x481"]',
            "",
            r"^mode in modes.only must be a known name; got '848x481'",
        ),
        (
            _BASE + 'only = ["640x480"]',
            "",
            r"^modes.only must list 848x480, the mode of the file; got 640x480\. Add it, or give",
        ),
        (PLAIN + '[modes]\nonly = ["848x480"]', "", r"^name of a mode must be .*; got 'only'"),
        (
            'base = "d435"',
            "800x600",
            r"^mode must be a mode of d435; got '800x600'. Modes: 1280x720,",
        ),
        ('base = "d435"', "640x480@45", r"must have a frame rate of 640x480; .* Rates: 6, 15, 30,"),
        ('base = "d435"', "640x480@", r"^mode must have a frame rate of 640x480; got '640x480@'"),
        ('base = "d435"\nmode = 640', "", r"^a.toml: mode must be text; got 640"),
        ('base = "d435"\nmode = "640x480"\nwidth = 600', "", r"^width and height must be those of"),
        (
            'base = "d435"\nwidth = 600',
            "640x480",
            r"^mode must start from an image .*; got 600x480",
        ),
        (
            PLAIN,
            "320x240",
            r"^mode must be of a camera with modes; got '320x240' of a",
        ),
        (PLAIN + MODES, "848x480@30", r"^mode must be without a rate where the mode lists none"),
        ("mode = '424x240'\n" + PLAIN + MODES, "", r"^width and height .* 424x240; got 848x480"),
        (PLAIN + "modes = 3", "", r"^modes must be a table; got 3"),
        ('base = "d435"\nmodes = 3', "", r"^modes must be a table; got 3"),
        (PLAIN + "[modes]\nVGA = {}", "", r"^name of a mode must be WIDTHxHEIGHT; got 'VGA'"),
        (PLAIN + '[modes]\n"6x4" = 3', "", r"^modes.6x4 must be a table; got 3"),
        (PLAIN + '[modes."6x4"]', "", r"^modes.6x4.scale must be given; got nothing"),
        (
            PLAIN + '[modes."6x4"]\nscale = 0',
            "",
            r"^modes.6x4.scale must be in \[0.001, 16\]; got 0",
        ),
        (
            PLAIN + '[modes."6x4"]\nscale = 1\nfps = 30',
            "",
            r"^modes.6x4.fps must be a list; got 30",
        ),
        (
            PLAIN + '[modes."6x4"]\nscale = 1\nfps = ["a"]',
            "",
            r"^modes.6x4.fps must be in .*; got 'a'",
        ),
        (
            PLAIN + '[modes."848x480"]\nscale = 1\nunit = 3',
            "",
            r"^modes.848x480 must have scale and",
        ),
        (PLAIN + '[modes."6x4"]\nscale = 1\nunit = 3\n' + MODES, "", r"^width must be in"),
        (
            PLAIN + MODES + '[modes."64x48"]\nscale = 0.05\ngian = 3\n',
            "",
            r"^key in modes.64x48 must be a known name; got 'gian'",
        ),
        (
            PLAIN
            + "[left.alignment]\nwarp_px = [[0.1]]\n"
            + MODES
            + '[modes."640x480"]\nscale = 0.6625',
            "640x480",
            r"^alignment.warp_px must be \(\) where a mode shows another field of view",
        ),
        # Keys of modes that are not chosen.
        (
            'base = "d435"\n[modes."640x480"]\nmatcher.foo = 96\n',
            "",
            r"^modes.640x480: key in matcher must be a known name; got 'foo'",
        ),
        (
            'base = "d435"\n[modes."640x480"]\nbaseline_m = -5\n',
            "",
            r"^modes.640x480: baseline_m must be > 0; got -5",
        ),
        (
            'base = "d435"\nwidth = 100\ncx_px = 50.0\n[modes."640x480"]\nunit = "a"\n',
            "",
            r"^modes.640x480: .*unit must be",
        ),
        (
            'base = "d435"\n[modes."640x480"]\n"matcher.search_px" = 96\nmatcher.search_px = 64\n',
            "",
            r"^matcher.search_px in modes.640x480 must be given once; got two values",
        ),
        (
            'base = "d435"\n[matcher]\n"refinement.median_px" = 3\nrefinement.median_px = 5\n',
            "",
            r"^matcher.refinement.median_px must be given once; got two values",
        ),
        ('base = "d435"\nmode = "1280x721"', "", r"^a.toml: mode must be a mode of d435; got"),
        (PLAIN + 'mode = "1280x721"\n' + MODES, "", r"^a.toml: mode must be a mode of"),
    ],
)
def test_wrong_modes_are_refused(tmp_path: Path, text: str, mode: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as refusal:
        load(tmp_path, text, mode)
    assert "\n" not in str(refusal.value)


OWN_KEYS = '[modes."{}"]\nmatcher.search_px = 192\n'


@pytest.mark.parametrize(
    ("text", "mode", "wanted"),
    [
        (OWN_KEYS.format("848x480"), "", 192),  # The mode of the base.
        (OWN_KEYS.format("848x480"), "640x480", 128),
        ('mode = "848x480"\n' + OWN_KEYS.format("848x480"), "", 192),
        ('mode = "640x480"\n' + OWN_KEYS.format("640x480"), "", 192),
        ('mode = "640x480"\n' + OWN_KEYS.format("640x480"), "848x480", 128),
        ('mode = "640x480"\n' + OWN_KEYS.format("848x480"), "", 128),
        ('mode = "640x480"\n' + OWN_KEYS.format("848x480"), "848x480", 192),
        ("width = 100\ncx_px = 50.0\n" + OWN_KEYS.format("640x480"), "", 128),
        ("matcher.search_px = 160\n" + OWN_KEYS.format("640x480"), "640x480", 192),
        ("matcher.search_px = 160\n" + OWN_KEYS.format("640x480"), "1280x720", 160),
    ],
)
def test_keys_of_a_mode_hold_in_that_mode_only(
    tmp_path: Path, text: str, mode: str, wanted: int
) -> None:
    assert load(tmp_path, 'base = "d435"\n' + text, mode).matcher.search_px == wanted


def test_python_takes_a_mode() -> None:
    assert starling.load_sensor("d435", mode="640x480@60") == presets.load(
        "d435", mode="640x480@60"
    )
