"""The projector's pattern by name and by file, and refusals."""

import dataclasses

import cv2
import numpy as np
import pytest

from starling.patterns import InputError
from starling.sim.render import emission
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Projector


@pytest.mark.parametrize("name", sorted(emission.GENERATORS))
def test_every_generator_can_be_projected(name):
    part = Projector(pattern=name, fov_x_deg=60.0, fov_y_deg=40.0)
    image = emission.irradiance_at_unit_distance(part)
    area = 4 * np.tan(np.deg2rad(30)) * np.tan(np.deg2rad(20))
    assert image.mean(dtype=np.float64) * area == pytest.approx(1, rel=1e-3)


def test_every_preset_names_a_pattern():
    for name in presets.names():
        part = presets.load(name).projector
        assert part.pattern in emission.GENERATORS
        assert {one.pattern for one in emission.emitters(part)} <= emission.GENERATORS.keys()


LATTICES = {"d415-left": (60.32, 81.70), "d415-right": (49.22, 81.28)}  # Angle [deg], cycles.


def phase(name: str, seed: int) -> np.ndarray:
    """Offset (2,) of a D415's lattice from the axis, in lattice steps."""
    part = presets.load("d415").projector
    generated = emission.pattern(name, part.fov_x_deg, part.fov_y_deg, seed)
    assert generated.dots is not None
    x, y = generated.field.tangents(generated.dots[:, 0], generated.dots[:, 1], generated.shape)
    cosines = np.stack([x, y], axis=1) / np.sqrt(1 + x**2 + y**2)[:, None]
    angle, cycles = np.deg2rad(LATTICES[name][0]), LATTICES[name][1]
    axes = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turns = np.exp(2j * np.pi * cycles * cosines @ axes)
    assert (abs(turns.mean(axis=0)) > 1 - 1e-6).all()  # The offset is the same for all dots.
    assert np.ptp(generated.dots[:, 2]) == 0  # Equal in power.
    return np.angle(turns.mean(axis=0)) / (2 * np.pi) % 1


def test_the_lattices_of_a_d415_match_the_measurement():
    """The lattices have the measured angles and pitches, and different offsets.

    With equal offsets each unit would have a rosette on the axis. Does not prove that real units
    differ in this way.
    """
    left, right = (
        np.array([phase(name, seed) for seed in range(8)]) for name in ("d415-left", "d415-right")
    )
    apart = abs((left - right + 0.5) % 1 - 0.5)
    assert (apart.max(axis=1) > 0.02).all() and apart.mean() > 0.1
    assert len(np.unique(np.concatenate([left, right]).round(6), axis=0)) == 16


@pytest.mark.parametrize("name", sorted(LATTICES))
def test_dot_density_goes_into_a_lattices_pitch(name):
    sparse, default = (emission.pattern(name, 60.0, 40.0, 0, density) for density in (0.5, 1.0))
    assert sparse.dots is not None and default.dots is not None
    assert len(sparse.dots) / len(default.dots) == pytest.approx(0.5, rel=0.03)


@pytest.mark.parametrize("share", [0.3, 1.0])
def test_haze_takes_light_from_the_dots_and_spreads_it_evenly(share):
    """Also for a pattern with dark dots, whose light is lost; the background is unchanged."""
    intact = Projector(pattern="d435")
    worn = dataclasses.replace(intact, dropped_dots=0.5)
    mean = emission.irradiance_at_unit_distance(intact).mean()
    for one in (intact, worn):
        dots = emission.irradiance_at_unit_distance(one)
        hazy = emission.irradiance_at_unit_distance(dataclasses.replace(one, haze=share))
        np.testing.assert_allclose(hazy, (1 - share) * dots + share * mean, rtol=1e-4)


def test_falloff_takes_light_from_the_edge_only():
    even = Projector()
    dimmed = dataclasses.replace(even, falloff=3.0)
    ratio = emission.irradiance_at_unit_distance(dimmed) / np.maximum(
        emission.irradiance_at_unit_distance(even), 1e-12
    )
    rows, columns = ratio.shape
    assert ratio[rows // 2, columns // 2] == pytest.approx(1.0, abs=1e-4)
    assert ratio.max() <= 1 + 1e-6
    assert ratio[rows // 2, 0] == pytest.approx(np.cos(np.deg2rad(45)) ** 3, rel=0.01)


def test_neutral_light_is_the_patterns_own_bits():
    part = Projector()
    image = emission.pattern(part.pattern, part.fov_x_deg, part.fov_y_deg, 0).image
    half_x, half_y = emission.half_tangents(part)
    scale = np.float32(1 / (4 * half_x * half_y))
    assert np.array_equal(emission.irradiance_at_unit_distance(part), image * scale)


@pytest.mark.parametrize("name", ["pattern_seed", "faults_seed"])
def test_faults_belong_to_the_pattern_and_its_device(name):
    worn = Projector(dropped_dots=0.3, shifted_dots_mrad=2.0, fov_x_deg=60.0, fov_y_deg=40.0)
    first, again, different = (
        emission.irradiance_at_unit_distance(dataclasses.replace(worn, **{name: seed}))
        for seed in (0, 0, 1)
    )
    assert np.array_equal(first, again)
    assert not np.array_equal(first, different)


def test_dropped_dots_take_their_share_of_the_power():
    """Mean irradiance falls by the dark dots' share of all dots, to 4 deviations."""
    whole, worn = (
        emission.irradiance_at_unit_distance(Projector(dropped_dots=share)).mean(dtype=np.float64)
        for share in (0.0, 0.3)
    )
    generated = emission.pattern("d435", 90.0, 63.0, 0)
    assert generated.dots is not None and generated.background is not None
    power = generated.dots[:, 2]
    deviation = np.sqrt(0.3 * 0.7 * (power**2).sum()) / power.sum()
    lost = (1 - worn / whole) / (1 - generated.background)
    assert lost == pytest.approx(0.3, abs=4 * deviation)


def test_the_reference_projector_has_no_faults_or_rotation():
    worn = Projector(
        dropped_dots=0.1,
        shifted_dots_mrad=1.0,
        dot_blur_mrad=1.0,
        rotation_deg=(0.1, 0.2, 0.3),
        pattern_seed=4,
        falloff=2.0,
    )
    assert emission.reference_projector(worn) == Projector(pattern_seed=4, falloff=2.0)


@pytest.mark.parametrize("name", ["d415", "image"])
def test_defocus_has_levels_of_growing_width(tmp_path, name):
    """The first level is in focus; all levels have equal power and decreasing peaks."""
    if name == "image":
        name = str(tmp_path / "dots.png")
        image = np.zeros((400, 600), np.uint8)
        image[20::40, 20::40] = 255
        cv2.imwrite(name, image)
    part = Projector(pattern=name, defocus_mrad_m=1.0, fov_x_deg=60.0, fov_y_deg=40.0)
    generated = emission.defocus_levels(part)
    in_focus = emission.irradiance_at_unit_distance(part)
    assert np.array_equal(generated.levels[0], in_focus)
    means = generated.levels.mean(axis=(1, 2), dtype=np.float64)
    np.testing.assert_allclose(means, in_focus.mean(dtype=np.float64), rtol=0.02)
    peaks = generated.levels.max(axis=(1, 2))
    assert (np.diff(peaks) < 0).all()
    widest = generated.variance_mrad2 * (generated.ratio ** (len(peaks) - 1) - 1)
    assert widest >= (1 / emission.NEAREST_M - 1) ** 2


def test_dots_of_an_image_cannot_be_dropped(tmp_path):
    path = str(tmp_path / "flat.png")
    cv2.imwrite(path, np.full((64, 64), 9, np.uint8))
    for part in (
        Projector(pattern=path, dropped_dots=0.1),
        Projector(pattern=path, shifted_dots_mrad=0.1),
    ):
        with pytest.raises(InputError, match="Take a generated pattern"):
            emission.irradiance_at_unit_distance(part)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("dropped_dots", 1.0),
        ("shifted_dots_mrad", -1.0),
        ("dot_blur_mrad", 51.0),
        ("defocus_mrad_m", 6.0),
        ("focus_m", 0.05),
        ("haze", 1.1),
        ("falloff", 21.0),
        ("speckle_contrast", 1.1),
        ("flicker", 0.6),
        ("wavelength_nm", 0.85),
        ("power_w", -1.0),
    ],
)
def test_ranges(field, value):
    with pytest.raises(InputError, match=rf"projector\.{field} must be in"):
        dataclasses.replace(Projector(), **{field: value})


def test_unknown_patterns():
    with pytest.raises(InputError, match=r"projector\.pattern must be a known name; got 'd436'"):
        emission.irradiance_at_unit_distance(Projector(pattern="d436"))
    with pytest.raises(InputError):
        emission.irradiance_at_unit_distance(Projector(pattern="missing.png"))
