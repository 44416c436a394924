"""Laws of the projector's light on walls: widths, focus, falloff, pose, power.

Rationale: in an imager at the projector, a dot of angular deviation s is s f pixels wide at any
distance. Defocus adds a width proportional to |1/z - 1/focus|. Falloff and pose act in the
projector's frame. Expected values are derived by hand. The pixel's variance of 1/12 and the texel
interpolation are small for the fine sensor used here.
"""

import dataclasses

import cv2
import numpy as np
import pytest

from starling.patterns import Pattern
from starling.patterns.field import Field
from starling.sim import metrics, simulate
from starling.sim.imaging.lens_input import combine_light
from starling.sim.render import direct, emission, mitsuba_scene
from starling.sim.scene.builtin import scenes
from starling.sim.scene.scene import Ambient
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values
from starling.sim.stereo import structured_light

pytestmark = pytest.mark.slow

FWHM_MRAD = 5.0
SIGMA_MRAD = FWHM_MRAD / np.sqrt(8 * np.log(2))
FOCAL_PX = 2000.0


@pytest.fixture
def fine(monkeypatch):
    """A sensor of 0.5 mrad per pixel whose projector, at the left imager, has one dot ahead."""

    def one_dot(*, fov_x_deg, fov_y_deg, seed):
        ahead = np.zeros(1)
        return Pattern.from_dots(
            ahead,
            ahead,
            ahead + 1,
            field=Field(fov_x_deg, fov_y_deg),
            width_px=1920,
            fwhm_mrad=FWHM_MRAD,
            background=0.0,
            name=f"one dot, seed {seed}",
        )

    monkeypatch.setitem(emission.GENERATORS, "one dot", one_dot)
    sensor = presets.load("d435")
    part = dataclasses.replace(
        sensor.projector,
        pattern="one dot",
        position_m=(0.0, 0.0, 0.0),
        fov_x_deg=30.0,
        fov_y_deg=30.0,
    )
    size = {"width": 320, "height": 320, "cx_px": 159.5, "cy_px": 159.5}
    focal = {"fx_px": FOCAL_PX, "fy_px": FOCAL_PX}
    return dataclasses.replace(sensor, projector=part, **size, **focal)


def with_light(sensor, **changes):
    return dataclasses.replace(sensor, projector=dataclasses.replace(sensor.projector, **changes))


def lit(sensor, distance_m):
    return direct.layers(
        mitsuba_scene.MitsubaScene(scenes.wall(distance_m)), sensor
    ).left.projector_direct


def width_mrad(image):
    """Standard deviation of the dot's light, without the pixel's contribution [mrad]."""
    column = np.arange(image.shape[1])
    profile = image.sum(axis=0, dtype=np.float64)
    middle = (profile * column).sum() / profile.sum()
    variance = (profile * (column - middle) ** 2).sum() / profile.sum() - 1 / 12
    return 1e3 * np.sqrt(variance) / FOCAL_PX


@pytest.mark.parametrize("blur_mrad", [0.0, 1.0, 3.0, 6.0])
@pytest.mark.parametrize("distance_m", [0.4, 2.0])
def test_dots_widen_in_quadrature_and_keep_their_angle(fine, blur_mrad, distance_m):
    """The deviation in the image is sqrt(s^2 + blur^2) f at all distances, to 2 %.

    The imager's lens is ideal here. Its blur would add in the same way; with projector light alone
    the two are unidentifiable.
    """
    image = lit(with_light(fine, dot_blur_mrad=blur_mrad), distance_m)
    assert width_mrad(image) == pytest.approx(np.hypot(SIGMA_MRAD, blur_mrad), rel=0.02)


@pytest.mark.parametrize("distance_m", [0.15, 0.25, 0.5, 1.0, 2.0, 8.0])
def test_defocus_is_proportional_to_the_difference_of_inverse_depth(fine, distance_m):
    """Deviation^2 = s^2 + (c |1/z - 1/focus|)^2 to 2 %, in focus as narrow as without defocus.

    Does not prove the spot's shape, which is a disc for a real aperture.
    """
    spread, focus_m = 1.2, 1.0
    image = lit(with_light(fine, defocus_mrad_m=spread, focus_m=focus_m), distance_m)
    expected = np.hypot(SIGMA_MRAD, spread * abs(1 / distance_m - 1 / focus_m))
    assert width_mrad(image) == pytest.approx(expected, rel=0.02)
    # The power is conserved; a wall's radiance falls as 1 / z^2.
    in_focus = lit(fine, distance_m)
    assert image.sum(dtype=np.float64) == pytest.approx(in_focus.sum(dtype=np.float64), rel=5e-3)


def test_in_focus_defocus_changes_no_more_than_rounding(fine):
    image = lit(with_light(fine, defocus_mrad_m=1.2, focus_m=1.0), 1.0)
    np.testing.assert_allclose(image, lit(fine, 1.0), rtol=1e-3, atol=1e-6 * image.max())


def test_defocus_is_limited_at_the_nearest_depth(fine):
    out_of_focus = with_light(fine, defocus_mrad_m=0.3)
    near, nearer = (width_mrad(lit(out_of_focus, z)) for z in (0.1, 0.05))
    assert nearer == pytest.approx(near, rel=0.01)


@pytest.fixture
def even(tmp_path):
    """A D435 whose projector, 10 cm from the left imager, lights a wide field evenly."""
    cv2.imwrite(str(tmp_path / "even.png"), np.full((64, 96), 200, np.uint8))
    changes = {"pattern": str(tmp_path / "even.png"), "position_m": (0.1, 0.0, 0.0)}
    return with_light(presets.load("d435"), **changes, fov_x_deg=130.0, fov_y_deg=110.0)


@pytest.mark.parametrize("turn_deg", [0.0, 10.0])
@pytest.mark.parametrize("distance_m", [0.5, 2.0])
def test_falloff_stays_with_the_projector(even, distance_m, turn_deg):
    """The dimming is cos^n of the angle off the projector's axis, for any wall and axis.

    In the image it moves with distance (parallax) and with the projector's rotation, unlike a
    lens's vignetting. Tolerance: 0.5 %. Does not prove that a real projector follows cos^n.
    """
    exponent = 4.0
    turned = with_light(even, rotation_deg=(0.0, turn_deg, 0.0))
    ratio = lit(with_light(turned, falloff=exponent), distance_m) / lit(turned, distance_m)
    rows, columns = np.indices(ratio.shape)
    x = (columns - even.cx_px) / even.fx_px - 0.1 / distance_m
    y = (rows - even.cy_px) / even.fy_px
    axis = np.sin(np.deg2rad(turn_deg)), np.cos(np.deg2rad(turn_deg))
    cosine = (x * axis[0] + axis[1]) / np.sqrt(1 + x**2 + y**2)
    np.testing.assert_allclose(ratio, cosine**exponent, rtol=0.005)


@pytest.mark.parametrize(
    "change", [{"position_m": (0.034, 0.002, 0.001)}, {"rotation_deg": (0.4, 0.4, 0.4)}]
)
def test_the_projectors_pose_does_not_move_stereo_depth(change):
    """Both imagers see the pattern on the same wall: their shift stays f b / z to 0.01 px.

    Measured by correlation of noise-free renders. Does not include a matcher, whose error depends
    on the dots in its window.
    """
    sensor, distance_m = presets.load("d435"), 1.0
    expected = sensor.focal_baseline_px_m / distance_m
    measured = []
    for each in (sensor, with_light(sensor, **change)):
        layers = direct.layers(mitsuba_scene.MitsubaScene(scenes.wall(distance_m)), each)
        views = layers.left.projector_direct, layers.right.projector_direct
        measured.append(metrics.shift_px(*views, near_px=expected, margin_px=int(expected) + 40))
    assert measured[1] == pytest.approx(measured[0], abs=0.01)


def test_a_rotated_projector_moves_structured_light_depth():
    """A projector rotated by phi since its reference was stored shifts d by f tan(phi).

    To 5 % in the middle of the image. Does not prove that a device's projector rotates.
    """
    sensor = presets.load("kinect-v1")
    turn_deg, distance_m = 0.1, 1.0
    turned = with_light(sensor, rotation_deg=(0.0, turn_deg, 0.0))
    assert np.array_equal(
        structured_light.reference_image(sensor), structured_light.reference_image(turned)
    )
    stored = (
        structured_light.reference_image(sensor).astype(np.float64) - sensor.left.black_level_dn
    )
    bias = sensor.fx_px * np.tan(np.deg2rad(turn_deg))
    nominal = sensor.focal_baseline_px_m / distance_m
    measured = []
    for each, near in ((sensor, nominal), (turned, nominal + bias)):
        seen = cv2.GaussianBlur(lit(each, distance_m), (0, 0), sensor.left.lens.blur_px)
        seen = seen.astype(np.float64)
        alike = stored * (seen[160:320, 160:480].mean() / stored[160:320, 160:480].mean())
        measured.append(metrics.shift_px(seen, alike, near_px=near, margin_px=160))
    assert measured[0] == pytest.approx(nominal, abs=0.05)
    assert measured[1] - measured[0] == pytest.approx(bias, rel=0.05)


@pytest.mark.parametrize(
    "change", [{"dropped_dots": 0.3}, {"shifted_dots_mrad": 2.0}, {"dot_blur_mrad": 1.0}]
)
def test_the_stored_reference_holds_the_ideal_pattern(change):
    sensor = presets.load("kinect-v1")
    assert np.array_equal(
        structured_light.reference_image(sensor),
        structured_light.reference_image(with_light(sensor, **change)),
    )


@pytest.fixture
def seen():
    """Layers of a wall for a D435, with the scene."""
    sensor = dataclasses.replace(
        presets.load("d435"), width=160, height=90, fx_px=80.0, fy_px=80.0, cx_px=80.0, cy_px=45.0
    )
    scene = dataclasses.replace(scenes.wall(1.0), ambient=Ambient(irradiance_w_m2=0.05))
    return direct.layers(mitsuba_scene.MitsubaScene(scene), sensor), scene, sensor


@pytest.mark.parametrize("flicker", [0.02, 0.1, 0.4])
def test_flicker_has_the_set_deviation_in_both_imagers(seen, flicker):
    """Over 400 frames the laser's power has mean 1 and deviation `flicker`, to four sigma.

    Other light keeps its bits. Does not prove that frames of a real driver are independent.
    """
    layers, scene, sensor = seen
    steady = combine_light(layers.left, scene, sensor, seed=7, frame=0)
    middle = 45, 80
    left, right = [], []
    shaky = with_light(sensor, flicker=flicker)
    for frame in range(400):
        for view, measured in ((layers.left, left), (layers.right, right)):
            light = combine_light(view, scene, shaky, seed=7, frame=frame)
            measured.append(light.laser[middle] / (view.projector_direct[middle] * 0.15))
            assert np.array_equal(
                light.rest, combine_light(view, scene, sensor, seed=7, frame=0).rest
            )
    np.testing.assert_allclose(left, right, rtol=1e-5)
    assert np.mean(left) == pytest.approx(1, abs=4 * flicker / 20)
    assert np.std(left) == pytest.approx(flicker, rel=4 / np.sqrt(2 * 400) * (1 + 2 * flicker))
    again = combine_light(layers.left, scene, shaky, seed=7, frame=3).laser
    assert np.array_equal(again, combine_light(layers.left, scene, shaky, seed=7, frame=3).laser)
    assert not np.array_equal(again, steady.laser)


def test_without_flicker_every_frame_is_the_same_bits(seen):
    layers, scene, sensor = seen
    frames = [combine_light(layers.left, scene, sensor, seed=7, frame=n).laser for n in (0, 5)]
    assert np.array_equal(frames[0], frames[1])
    assert np.array_equal(frames[0], layers.left.projector_direct * np.float32(0.15))


def test_auto_exposure_ignores_flicker(seen):
    """Otherwise auto exposure would make the ambient light flicker."""
    layers, scene, sensor = seen
    sensor = with_values(sensor, [("imager.auto_exposure_max_s", 0.2)])
    shaky = with_light(sensor, flicker=0.3)
    pairs = [simulate.infrared(layers, scene, shaky, seed=7, frame=frame) for frame in range(6)]
    steady = simulate.infrared(layers, scene, sensor, seed=7).exposure
    assert steady.exposure_s < sensor.left.auto_exposure_max_s
    assert all(pair.exposure == steady for pair in pairs)
    levels = [pair.electrons.mean() for pair in pairs]
    assert np.std(levels) > 0.1 * np.mean(levels)
