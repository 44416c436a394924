"""Light, images and noise of a batch against the compiled path."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from starling.sim import simulate
from starling.sim.corrupt import Corruptor
from starling.sim.reason import Reason
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.matching import readable
from tests.unit.sim.batch import steps

wp: Any = pytest.importorskip("warp", reason="warp-lang is not installed")

from starling.sim.batch import images, reading  # noqa: E402
from starling.sim.batch.batch_reading import BatchReading  # noqa: E402
from tests.unit.sim.batch.both_paths import (  # noqa: E402
    EQUAL_SHARE,
    build,
    equal_shares,
)
from tests.unit.sim.batch.both_paths import views as both_views  # noqa: E402

pytestmark = pytest.mark.slow

CORRELATION = 0.999  # Least correlation of the light of both paths.
ROUNDED_SHARE = 0.005  # Largest share of codes that differ, by one, as rounding differs.
RAISED = ("left.auto_exposure_max_s=0.0003", "left.auto_exposure_max_gain=6.0")  # Gain 6.
DARK = ("imager.auto_exposure_level=0.0", "imager.exposure_s=0.0001")


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("d435", ()),
        ("d415", ()),  # Two emitters.
        ("d435", ("projector.pattern_scale=1.02", "projector.rotation_deg=[1.0, 2.0, 3.0]")),
        ("d435", ("projector.defocus_mrad_m=0.5", "baseline_error=0.05")),
    ],
)
def test_light_is_that_of_the_compiled_path(name: str, changes: tuple[str, ...]) -> None:
    corruptor, rig = build(
        steps.sensor(*changes, name=name), {"ambient": 5.0, "ambient_gradient": 0.7}
    )
    depth = steps.depth_image()
    reflectance = np.linspace(0.2, 0.8, depth.size, dtype=np.float32).reshape(depth.shape)
    expected = corruptor.light(depth, reflectance=reflectance).layers
    views = both_views(rig, depth, reflectance=reflectance)
    assert expected.right is not None
    for view, layer in zip(views, (expected.left, expected.right), strict=True):
        light = view.light.numpy()[0]
        power, sky = rig.light.power, rig.ambient.irradiance_w_m2
        for ours, theirs in (
            (light[..., 0], layer.projector_direct * power),
            (light[..., 1], layer.ambient * sky),
        ):
            assert np.corrcoef(ours.ravel(), theirs.ravel())[0, 1] >= CORRELATION
            assert ours.mean() == pytest.approx(theirs.mean(), rel=1e-3)
    lit = views[0].lit.numpy()[0] > 0
    assert (lit == expected.truth.lit).mean() >= EQUAL_SHARE


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("d435", ()),
        ("d415", ()),  # Smooths its images.
        (
            "d435",
            ("imager.exposure_s=0.001", "imager.auto_exposure_level=0.0", "imager.crosstalk=0.2"),
        ),
        ("d435", ("imager.lens.veil=0.3", "imager.hot_pixels=0.01", "imager.column_noise_e=20.0")),
        ("d435", ("imager.lens.filter_width_nm=30.0", "imager.lens.vignetting=0.0")),
        ("d435", ("imager.lens.corner_blur_px=1.0", "imager.dsnu_e=30.0", "imager.prnu=0.05")),
        ("d435", ("imager.bit_depth=10", "imager.dropped_bits=0", "imager.dark_current_e_s=5e3")),
        ("d435", ("imager.lens.blur_px=0.0", "imager.lens.defocus_px_m=0.0", "imager.gamma=1.6")),
        ("d435", ("imager.pattern_contrast=0.1", "imager.pattern_px=5.0", "imager.prnu=0.03")),
        ("d435", ("imager.pattern_contrast=0.2", "imager.crosstalk=0.1")),
        ("d435", RAISED),
        ("d435", ("imager.auto_exposure_roi=0.4", "imager.lens.veil=0.1")),
        ("d435", ("left.alignment.warp_px=[[0.4, -0.3]]", "right.alignment.waves_px=0.5")),
    ],
)
def test_images_without_noise_are_those_of_the_compiled_path(
    name: str, changes: tuple[str, ...]
) -> None:
    sensor = steps.without_noise(steps.sensor(*changes, name=name))
    corruptor, _ = build(sensor, {"ambient": 2.0})
    depth = steps.depth_image()
    layers = corruptor.light(depth).layers
    expected = simulate.infrared(layers, corruptor._scene, corruptor.sensor)
    seen = corruptor.batch(wp.array(depth[None], dtype=float))
    assert expected.right is not None
    for ours, theirs in ((seen.ir_left, expected.left), (seen.ir_right, expected.right)):
        off = np.abs(ours.numpy()[0].astype(float) - theirs)
        assert np.corrcoef(ours.numpy().ravel(), theirs.ravel())[0, 1] >= CORRELATION
        assert off.max() <= 1
        assert (off > 0).mean() <= ROUNDED_SHARE
    for name in ("exposure_s", "gain"):
        chosen = getattr(expected.exposure, name)
        assert getattr(seen, name).numpy()[0] == pytest.approx(chosen, rel=1e-3)


@pytest.mark.parametrize("changes", [(), ("post.far_m=1.4",), DARK, RAISED])
def test_reasons_and_depth_are_those_of_the_compiled_path(changes: tuple[str, ...]) -> None:
    noisy = steps.sensor(*changes)
    reasons, depths, _ = equal_shares(
        dataclasses.replace(noisy, projector=noisy.projector.steady())
    )
    assert reasons >= EQUAL_SHARE and depths >= EQUAL_SHARE


@pytest.mark.parametrize("bits", [1, 2, 3, 8])
def test_the_matcher_reads_ten_bits(bits: int) -> None:
    """Ten bits are all that `match` accepts; finer ones are dropped, as from one image."""
    sensor = steps.without_noise(steps.sensor(f"imager.dropped_bits={bits}"))
    corruptor, rig = build(sensor)
    depth = steps.depth_image()
    pair = simulate.infrared(corruptor.light(depth).layers, corruptor._scene, sensor)
    expected = readable(pair.matched_left, sensor.left.matched_bits)
    left, _ = both_views(rig, depth)
    draws = images.SliceDraws(0, 0, 0)
    formed = images.form(left, "left", rig.left, draws)
    exposures = images.Exposures(
        wp.array([pair.exposure.exposure_s], dtype=float),
        wp.array([pair.exposure.gain], dtype=float),
    )
    delivered = wp.empty(formed.radiance.shape, dtype=wp.uint8)
    codes = images.read_out(formed, exposures, "left", rig.left, draws, delivered)
    matched = codes.matched.numpy()
    assert matched.max() > 255 and matched.max() <= 1023
    assert np.abs(matched[0].astype(int) - expected).max() <= 2


@pytest.mark.parametrize(
    ("kind", "wavelength_nm"),
    [("number", 850.0), ("image", 850.0), ("rgb", 850.0), ("rgb", 550.0)],
)
def test_reflectance_is_that_of_the_compiled_path(kind: str, wavelength_nm: float) -> None:
    edits = ("imager.auto_exposure_level=0.0", f"projector.wavelength_nm={wavelength_nm}")
    corruptor, _ = build(steps.without_noise(steps.sensor(*edits)))
    depth = steps.depth_image()
    images_of: dict[str, Any] = {
        "image": np.linspace(0, 1, depth.size, dtype=np.float32).reshape(depth.shape),
        "rgb": np.random.default_rng(0).integers(0, 256, (*depth.shape, 3), np.uint8),
        "number": 0.9,
    }
    expected = corruptor(depth, reflectance=images_of[kind])
    ours = 0.9 if kind == "number" else wp.array(images_of[kind][None])
    seen = corruptor.batch(wp.array(depth[None], dtype=float), reflectance=ours)
    off = np.abs(seen.ir_left.numpy()[0].astype(float) - expected.ir_left)
    assert np.quantile(off, 0.99) <= 1


def test_no_surface_is_written_in_many_ways() -> None:
    corruptor, _ = build(steps.without_noise(steps.sensor()))
    depth = np.repeat(steps.depth_image()[None], 5, axis=0)
    for number, value in enumerate((0.0, -1.0, np.inf, np.nan, 1e-4)):
        depth[number, :40] = value
    seen = corruptor.batch(wp.array(depth, dtype=float))
    reason = seen.reason.numpy()
    assert (reason == reason[0]).all()
    assert (reason[:, :30] == Reason.NO_SURFACE).mean() > 0.9


def test_depth_out_of_range_is_refused() -> None:
    corruptor, _ = build(steps.sensor("post.far_m=1.0"))
    seen = corruptor.batch(wp.array(steps.depth_image()[None], dtype=float))
    assert np.nanmax(seen.depth_m.numpy()) <= 1.0
    assert (seen.reason.numpy() == Reason.OUT_OF_RANGE).any()


def test_a_view_without_dots_gives_a_warning() -> None:
    sensor = steps.sensor("projector.fov_x_deg=30.0")
    with pytest.warns(UserWarning, match="50% of the sensor's image has no dots"):
        Corruptor(sensor, steps.MATRIX).batch(wp.array(steps.depth_image()[None], dtype=float))


def test_too_much_light_saturates() -> None:
    sensor = steps.sensor("imager.auto_exposure_level=0.0", "imager.exposure_s=0.5")
    corruptor, _ = build(sensor, {"ambient": 50.0})
    seen = corruptor.batch(wp.array(steps.depth_image()[None], dtype=float))
    assert (seen.reason.numpy() == Reason.SATURATED).mean() > 0.5


def plain(sensor: Sensor) -> Sensor:
    """A sensor without fixed patterns, whose black level keeps noise above code 0."""
    changes = {"prnu": 0.0, "dsnu_e": 0.0, "black_level_dn": 60.0, "auto_exposure_level": 0.0}
    left, right = (
        dataclasses.replace(part, **changes, exposure_s=1e-3)
        for part in (sensor.left, sensor.right)
    )
    return dataclasses.replace(sensor, left=left, right=right)


def codes(corruptor: Corruptor, count: int = 2, **draws: int) -> np.ndarray[Any, Any]:
    """Left images (n, h, w) of equal walls."""
    wall = np.full((count, steps.HEIGHT, steps.WIDTH), 1.5, np.float32)
    return corruptor.batch(wp.array(wall), **draws).ir_left.numpy().astype(float)


def residuals(corruptor: Corruptor, **draws: int) -> np.ndarray[Any, Any]:
    """Noise (n, pixels) of left images."""
    quiet = Corruptor(steps.without_noise(corruptor.sensor), steps.MATRIX)
    return (codes(corruptor, **draws) - codes(quiet)).reshape(2, -1)


def test_noise_has_the_moments_of_the_compiled_path() -> None:
    sensor = plain(steps.sensor("imager.bit_depth=12", "imager.dropped_bits=0"))
    corruptor, _ = build(dataclasses.replace(sensor, projector=sensor.projector.steady()))
    ours = residuals(corruptor).ravel()
    wall = np.full((steps.HEIGHT, steps.WIDTH), 1.5, np.float32)
    quiet = Corruptor(steps.without_noise(corruptor.sensor), steps.MATRIX)
    theirs = corruptor(wall).ir_left.astype(float) - quiet(wall).ir_left
    assert abs(ours.mean()) < 4 * ours.std() / np.sqrt(ours.size)
    assert ours.std() == pytest.approx(theirs.std(), rel=0.02)
    assert ((ours / ours.std()) ** 3).mean() == pytest.approx(
        ((theirs / theirs.std()) ** 3).mean(), abs=0.1
    )


def test_noise_correlates_as_that_of_the_compiled_path() -> None:
    changes = ("imager.noise_correlation=0.6", "imager.bit_depth=12", "imager.dropped_bits=0")
    sensor = plain(steps.sensor(*changes))
    corruptor, _ = build(dataclasses.replace(sensor, projector=sensor.projector.steady()))
    noise = residuals(corruptor).reshape(2, steps.HEIGHT, steps.WIDTH)
    left, right = noise[:, :, :-1].ravel(), noise[:, :, 1:].ravel()
    over, under = noise[:, :-1].ravel(), noise[:, 1:].ravel()
    for first, second in ((left, right), (over, under)):
        assert np.corrcoef(first, second)[0, 1] == pytest.approx(0.6, abs=0.03)
    white, _ = build(with_values(corruptor.sensor, [("imager.noise_correlation", 0.0)]))
    assert noise.std() == pytest.approx(residuals(white).std(), rel=0.03)


def test_rows_share_row_noise() -> None:
    sensor = plain(steps.sensor("imager.row_noise_e=100.0", "imager.bit_depth=12"))
    corruptor, rig = build(dataclasses.replace(sensor, projector=sensor.projector.steady()))
    noise = residuals(corruptor).reshape(2, steps.HEIGHT, steps.WIDTH).mean(2)
    assert noise.std() == pytest.approx(100.0 * rig.left.die.conversion, rel=0.2)


def test_speckle_has_the_contrast_of_the_projector() -> None:
    quiet = steps.without_noise(plain(steps.sensor("imager.bit_depth=16")))
    speckled = dataclasses.replace(
        quiet, projector=dataclasses.replace(quiet.projector, speckle_contrast=0.3, haze=1.0)
    )
    corruptor, _ = build(speckled, {"ambient": 0.0})
    still = dataclasses.replace(speckled, projector=speckled.projector.steady())
    black = speckled.left.black_level_dn
    grain = (codes(corruptor, seed=4) - black) / (
        codes(Corruptor(still, steps.MATRIX, effects={"ambient": 0.0})) - black
    )
    assert grain.mean() == pytest.approx(1.0, abs=0.01)
    assert grain.std() == pytest.approx(0.3, rel=0.03)
    frames = codes(corruptor, seed=4, frame=9)
    assert np.array_equal(codes(corruptor, seed=4), frames)
    assert abs(np.corrcoef(grain.reshape(2, -1))[0, 1]) < 0.05


@pytest.mark.parametrize(
    ("first", "second"),
    [({}, {"frame": 1}), ({}, {"seed": 1}), ({"seed": 1}, {"frame": 1}), ({}, {"seed": 2**40})],
)
def test_draws_are_independent(first: dict[str, int], second: dict[str, int]) -> None:
    """Between environments, frames and seeds; 5 standard errors bound the correlations."""
    sensor = plain(steps.sensor("imager.bit_depth=12", "imager.dropped_bits=0"))
    corruptor, _ = build(dataclasses.replace(sensor, projector=sensor.projector.steady()))
    noise = np.concatenate([residuals(corruptor, **draws) for draws in (first, second)])
    off = np.corrcoef(noise)[~np.eye(4, dtype=bool)]
    assert np.abs(off).max() < 5 / np.sqrt(noise.shape[1])


def test_equal_draws_are_equal_whatever_the_slices(monkeypatch: pytest.MonkeyPatch) -> None:
    corruptor, _ = build(steps.sensor())
    depth = wp.array(np.repeat(steps.depth_image()[None], 3, axis=0), dtype=float)
    reflectance = wp.full(depth.shape, 0.4, dtype=float)
    whole = corruptor.batch(depth, reflectance=reflectance, seed=5, frame=2)
    monkeypatch.setattr(reading, "SLICE_BYTES", 1)
    sliced = corruptor.batch(depth, reflectance=reflectance, seed=5, frame=2)
    for name in BatchReading.__slots__:
        ours, theirs = (getattr(each, name).numpy() for each in (whole, sliced))
        assert np.array_equal(ours, theirs, equal_nan=ours.dtype.kind == "f")
