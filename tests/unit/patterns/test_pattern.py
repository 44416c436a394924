"""The pattern: its invariants and input checks."""

import dataclasses

import numpy as np
import pytest

from starling.patterns import Field, InputError, Pattern, uniform

FOV = {"fov_x_deg": 60.0, "fov_y_deg": 40.0}


def small(seed=0):
    return uniform(**FOV, width_px=320, fwhm_mrad=8.0, seed=seed)


def test_an_image_is_normalised_and_frozen():
    pattern = Pattern.from_image(np.arange(64 * 48).reshape(48, 64), **FOV, name="ramp")
    assert pattern.image.dtype == np.float32
    assert pattern.image.mean(dtype=np.float64) == pytest.approx(1, abs=1e-6)
    with pytest.raises(ValueError, match="read-only"):
        pattern.image[0, 0] = 1


def test_it_keeps_its_own_copy():
    image = np.ones((48, 64), np.float32)
    pattern = Pattern(image=image, **FOV, name="flat")
    image[:] = 7
    assert pattern.image.max() == 1


def test_all_the_power_lands_in_the_field():
    """Irradiance times pixel area sums to the projector's power at any depth."""
    pattern = small()
    for depth_m in (0.5, 1.0, 3.0):
        focal_x, focal_y = pattern.field.focal_px(pattern.shape)
        pixel_m2 = depth_m**2 / (focal_x * focal_y)
        total = pattern.irradiance_w_m2(0.36, depth_m).sum(dtype=np.float64) * pixel_m2
        assert total == pytest.approx(0.36, rel=1e-5)


def test_equality_is_by_content():
    assert small() == small()
    assert hash(small()) == hash(small())
    assert small() != small(seed=1)
    assert small() != "pattern"


def test_background_is_the_floor_of_the_image():
    pattern = uniform(**FOV, width_px=320, dots_per_deg2=0.05, fwhm_mrad=8.0, background=0.4)
    assert pattern.image.min() == pytest.approx(0.4, abs=1e-6)


def grey(value, dtype=np.float32):
    return np.full((48, 64), value, dtype)


def of_dots(**changes):
    arguments = {
        "x": np.array([0.0]),
        "y": np.array([0.0]),
        "power": np.array([1.0]),
        "field": Field(60.0, 40.0),
        "width_px": 320,
        "fwhm_mrad": 8.0,
        "background": 0.1,
        "name": "one",
    }
    return Pattern.from_dots(**(arguments | changes))


def changed(**fields: object) -> Pattern:
    return dataclasses.replace(small(), **fields)


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (lambda: Pattern(image=grey(2), **FOV, name=""), r"image must be float32 with mean 1; got"),
        (
            lambda: Pattern(image=grey(1, np.float64), **FOV, name=""),
            r"image must be float32 .* got float64, mean 1\. Use Pattern\.from_image",
        ),
        (
            lambda: Pattern(image=grey(1), **FOV, name="", dots=np.ones((1, 3))),
            r"fwhm_mrad and background must come with dots; got None, None\.",
        ),
        (
            lambda: Pattern.from_image(np.ones((48, 64, 3)), **FOV, name=""),
            r"image must be \(h, w\) with both sides >= 32; got \(48, 64, 3\)\.",
        ),
        (lambda: Pattern.from_image(np.ones((8, 64)), **FOV, name=""), r"got \(8, 64\)\. Give one"),
        (
            lambda: Pattern.from_image(grey(0), **FOV, name=""),
            r"image must be finite, >= 0 and not",
        ),
        (lambda: Pattern.from_image(grey(-1), **FOV, name=""), r"values in \[-1, -1\]\."),
        (lambda: Pattern.from_image(grey(np.nan), **FOV, name=""), r"values in \[nan, nan\]\."),
        (
            lambda: Pattern.from_image(grey(1j, complex), **FOV, name=""),
            r"image must be an array of real num",
        ),
        (
            lambda: Pattern.from_image(grey(1), fov_x_deg=0.0, fov_y_deg=40.0, name=""),
            r"fov_x_deg must be in",
        ),
        (lambda: of_dots(background=1.0), r"background must be in \[0, 0\.99\]; got 1\.0\."),
        (lambda: of_dots(x=np.array([2.0])), r"pattern must hold a dot with power; got none\."),
        (lambda: of_dots(power=np.array([0.0])), r"pattern must hold a dot with power; got none"),
        (lambda: of_dots(x=np.array([np.nan])), r"dots must be finite"),
        (lambda: small().irradiance_w_m2(0.0), r"power_w must be in .*; got 0\.0\."),
        (lambda: small().irradiance_w_m2(1.0, 1e308), r"depth_m must be in .*; got 1e\+308\."),
        (lambda: of_dots(x=[0.1, 0.2]), r"x, y and power must be \(n,\), of one length"),
        (lambda: of_dots(x="a"), r"x must be an array of real numbers"),
        (lambda: of_dots(field=40), r"field must be of type Field"),
        (lambda: changed(fwhm_mrad="a"), r"fwhm_mrad must be > 0"),
        (lambda: changed(background=-1), r"background must be in \[0, 1\]"),
        (lambda: changed(name=5), r"name must be of type str"),
        (lambda: changed(dots="a"), r"dots must be an array of real numbers"),
    ],
)
def test_refusals(act, message):
    with pytest.raises(InputError, match=message):
        act()
