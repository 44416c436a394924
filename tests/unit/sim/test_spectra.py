"""Spectra, compared with hand calculations, definitions of units and thin-film theory."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.patterns import InputError
from starling.sim.imaging.imager import electrons_per_radiance
from starling.sim.imaging.optics import bandpass
from starling.sim.imaging.optics.bandpass import GRID_NM, integral
from starling.sim.render import emission
from starling.sim.scene import spectra
from starling.sim.sensor.sensor import Imager, Lens, Projector
from tests.oracles import multilayer

ROOT = Path(__file__).parents[3]
ANGLES_DEG = np.arange(0.0, 36.0, 2.5)
IMAGER = Imager(
    lens=Lens(f_number=2.0, transmission=0.85), quantum_efficiency=0.25, pixel_pitch_m=3e-6
)
FILTERED = spectra.Band(filter_width_nm=50.0)


def line(centre_nm: float, width_nm: float = 3.0) -> np.ndarray:
    """One watt per square metre in a narrow Gaussian (1441,)."""
    sigma = width_nm / 2.3548
    power = np.exp(-0.5 * ((GRID_NM - centre_nm) / sigma) ** 2)
    return power / integral(power)


def wall_electrons(irradiance_w_m2: float, *, exposure_s: float) -> float:
    """Mean electrons of a pixel that sees a diffuse wall of reflectance 0.65 at 850 nm."""
    radiance = 0.65 * irradiance_w_m2 / np.pi
    return radiance * electrons_per_radiance(IMAGER, 850.0, exposure_s)


# --- electrons by hand ---------------------------------------------------------------------------


def test_projector_at_one_metre_by_hand():
    """360 mW over 90 x 63 deg on a wall of reflectance 0.65 at 1 m, for 8.5 ms.

    Area lit: 4 tan 45 tan 31.5 = 4 * 1 * 0.612801 = 2.451203 m^2, so 0.146867 W m^-2. Radiance
    0.65 * 0.146867 / pi = 0.0303873 W m^-2 sr^-1. On the imager pi * 0.0303873 * 0.85 / (4 * 2^2)
    = 5.07152e-3 W m^-2. Energy on 9e-12 m^2 in 8.5 ms: 3.87972e-16 J. A photon of 850 nm has
    6.62607e-34 * 2.99792e8 / 850e-9 = 2.33700e-19 J: 1660.1 photons, 415.0 electrons.
    Does not prove that a device's 360 mW are spread evenly: that is the pattern's mean.
    """
    part = Projector(power_w=0.36, fov_x_deg=90.0, fov_y_deg=63.0)
    irradiance = part.power_w * float(emission.irradiance_at_unit_distance(part).mean())
    electrons = wall_electrons(irradiance, exposure_s=8.5e-3)
    assert electrons == pytest.approx(415.0, rel=2e-3)


def test_sun_by_hand():
    """50 klx of sun behind a 50 nm band at 850 nm on a wall of 0.65, for 1 ms.

    From anchors of ASTM G173 global and of V every 20 nm, its whole spectrum has

        nm   460  480  500  520  540  560  580  600  620  640  660  680
        V    .060 .139 .323 .710 .954 .995 .870 .631 .381 .175 .061 .017
        E    1.54 1.60 1.54 1.53 1.52 1.51 1.49 1.46 1.44 1.44 1.38 1.39
        V E  .092 .222 .497 1.086 1.450 1.502 1.296 .921 .549 .252 .084 .024

    (E rounded over 20 nm), sum 7.975 * 20 nm * 683 lm/W = 108.9 klx; so 50 klx are 0.459 of it.
    Around 850 nm G173 has 0.95 W m^-2 nm^-1, hence 0.436. The band 1 / (1 + x^6) has the area
    pi / 3 of its width: 52.4 nm, so 22.8 W m^-2. Radiance 0.65 * 22.8 / pi = 4.72; on the imager
    pi * 4.72 * 0.85 / 16 = 0.788 W m^-2; on 9e-12 m^2 in 1 ms 7.09e-15 J, over 2.337e-19 J
    30 340 photons, 7590 electrons. Silicon's slope and the spectrum's are even about 850 nm to
    first order; 3 % is what the anchors are worth.
    """
    irradiance = spectra.ambient_w_m2("sun", illuminance_lx=50e3, band=FILTERED)
    assert irradiance == pytest.approx(22.8, rel=0.03)
    electrons = wall_electrons(irradiance, exposure_s=1e-3)
    assert electrons == pytest.approx(7590, rel=0.03)


def test_incandescent_by_hand():
    """Planck's law at 2856 K by hand at two wavelengths, over its lux.

    h c / k = 1.43878e-2 m K. Exponents at 850 and 560 nm: 5.9268 and 8.9960, so
    E(850) / E(560) = (560 / 850)^5 * (e^8.9960 - 1) / (e^5.9268 - 1) = 0.12412 * 21.57 = 2.677.
    """
    lamp = spectra.irradiance("incandescent", 300.0)
    ratio = lamp[np.argmin(abs(GRID_NM - 850))] / lamp[np.argmin(abs(GRID_NM - 560))]
    assert ratio == pytest.approx(2.677, rel=2e-3)


# --- units ---------------------------------------------------------------------------------------


def test_a_watt_at_555_nm_has_683_lumens():
    """The definition of the lumen, but for the breadth of the line (V falls 0.1 % within it)."""
    assert spectra.illuminance_lx(line(555.0)) == pytest.approx(683.0, rel=2e-3)


@pytest.mark.parametrize("light", spectra.names())
def test_lights_have_the_given_illuminance(light):
    """Also proves linearity: twice the lux is twice the spectrum."""
    spectrum = spectra.irradiance(light, 500.0)
    assert (spectrum >= 0).all()
    assert spectra.illuminance_lx(spectrum) == pytest.approx(500.0)
    np.testing.assert_allclose(spectra.irradiance(light, 1000.0), 2 * spectrum)


def test_sun_is_astm_g173():
    """ASTM's own table at 1 nm, integrated by itself: 772.3 W m^-2 from 380 to 1100 nm (of 1000.4
    in all), 109.5 klx; and means over 5 nm at anchors.
    """
    spectrum = spectra.irradiance("sun", 1e5)
    scale = integral(spectrum) / 772.3
    assert 1e5 / scale == pytest.approx(109.5e3, rel=2e-3)
    for nanometres, expected in ((500, 1.53), (700, 1.29), (860, 0.99), (935, 0.20), (1000, 0.737)):
        seen = spectrum[np.argmin(abs(GRID_NM - nanometres))] / scale
        assert seen == pytest.approx(expected, rel=0.03)


# --- silicon -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("nanometres", "per_cm"), [(550, 6390), (850, 534), (940, 183)])
def test_absorption_is_green_2008(nanometres, per_cm):
    """4 pi k / lambda from the paper's k: 0.027968, 0.003612, 0.0013689."""
    seen = float(bandpass.absorption_per_um(np.array([float(nanometres)]))[0]) * 1e4
    assert seen == pytest.approx(per_cm, rel=2e-3)


def test_beer_lambert_by_hand():
    """5 um at 534 / cm: 1 - exp(-0.267) = 0.2343."""
    assert bandpass.absorbed(np.array([850.0]), 5.0)[0] == pytest.approx(0.2343, rel=1e-3)


@given(st.floats(0.01, 0.74), st.floats(400, 1000))
def test_depth_gives_back_its_efficiency(efficiency, nanometres):
    depth = bandpass.depth_um(efficiency, nanometres)
    seen = bandpass.COLLECTED * bandpass.absorbed(np.array([nanometres]), depth)[0]
    assert seen == pytest.approx(efficiency, rel=1e-9)


def test_an_ideal_detector_counts_all_photons():
    """At efficiency 1 (neutral), electrons per watt are proportional to the wavelength."""
    band = spectra.Band.from_imager(Imager(), Projector())
    assert band.epitaxy_um == float("inf")
    np.testing.assert_allclose(band.response, GRID_NM / 850.0)


# --- the band ------------------------------------------------------------------------------------


@given(st.floats(600, 1000), st.floats(0, 100))
def test_laser_light_counts_as_itself(nanometres, width_nm):
    """A watt at the laser's line counts as a watt for any filter and silicon."""
    band = spectra.Band(
        wavelength_nm=nanometres,
        filter_centre_nm=nanometres,
        filter_width_nm=0.0 if width_nm < 15 else width_nm,
    )
    assert spectra.in_band_irradiance(line(nanometres), band) == pytest.approx(1.0, rel=0.01)


def test_a_watt_of_green_by_hand():
    """Silicon of 5 um: (1 - e^-3.195) / (1 - e^-0.2670) * 550 / 850 = 0.9590 / 0.2343 * 0.6471."""
    seen = spectra.in_band_irradiance(line(550.0), spectra.Band())
    assert seen == pytest.approx(2.649, rel=5e-3)


def test_a_filter_blocks_ambient_light():
    """LED light has no infrared; a filter passes a share of sunlight and bulb light."""

    def share(light: str) -> float:
        both = (spectra.Band(), FILTERED)
        bare, behind = (spectra.ambient_w_m2(light, illuminance_lx=500.0, band=b) for b in both)
        return behind / bare

    assert share("led") < 1e-3
    assert share("fluorescent") < 1e-4
    assert 0.02 < share("sun") < 0.06
    assert 2 * share("sun") < share("incandescent") < 0.15


def test_band_of_a_sensor():
    lens = Lens(filter_centre_nm=832.0, filter_width_nm=30.0)
    band = spectra.Band.from_imager(
        Imager(lens=lens, quantum_efficiency=0.25), Projector(wavelength_nm=830.0)
    )
    assert (band.wavelength_nm, band.filter_centre_nm, band.filter_width_nm) == (830.0, 832.0, 30.0)
    efficiency = bandpass.COLLECTED * bandpass.absorbed(np.array([830.0]), band.epitaxy_um)[0]
    assert efficiency == pytest.approx(0.25)


# --- the filter ----------------------------------------------------------------------------------


def through(angle_deg: float, **change: float) -> float:
    values = {"wavelength_nm": 850.0, "centre_nm": 850.0, "width_nm": 50.0, "index": 2.0, **change}
    return float(bandpass.laser_transmission(np.deg2rad(np.float32(angle_deg)), **values))


def test_no_filter_is_exactly_one():
    angles = np.linspace(0, 1.2, 50, dtype=np.float32).reshape(5, 10)
    for seen in (
        bandpass.laser_transmission(
            angles, wavelength_nm=850.0, centre_nm=700.0, width_nm=0.0, index=2.0
        ),
        bandpass.ambient_transmission(angles, centre_nm=700.0, width_nm=0.0, index=2.0),
    ):
        assert seen.shape == angles.shape and seen.dtype == np.float32
        assert (seen == 1).all()


def test_laser_transmission_by_hand():
    """At 30 deg and n = 2: s = sqrt(1 - 0.0625) = 0.968246, so 850 nm counts as 877.876 nm.

    x = 2 * 27.876 / 50 = 1.11504, x^6 = 1.9219, 1 / 2.9219 = 0.34224.
    """
    assert through(0.0) == 1.0
    assert through(30.0) == pytest.approx(0.34224, rel=1e-3)
    assert through(0.0, wavelength_nm=875.0) == pytest.approx(0.5, rel=1e-6)
    assert through(0.0, wavelength_nm=825.0) == pytest.approx(0.5, rel=1e-6)
    # A laser that has drifted to the long side falls sooner, one on the short side gains first.
    assert through(20.0, wavelength_nm=860.0) < through(20.0) < 1
    assert through(20.0, wavelength_nm=835.0) > through(0.0, wavelength_nm=835.0)


@given(st.floats(2, 200), st.floats(1.2, 4.0), st.integers(0, 80))
def test_laser_only_falls_towards_the_corners(width_nm, index, degrees):
    near, far = (through(a, width_nm=width_nm, index=index) for a in (degrees, degrees + 5))
    assert 0 < far <= near <= 1


@pytest.mark.parametrize("high", [2.1, 2.3, 3.5])
@pytest.mark.parametrize("high_cavity", [True, False])
def test_law_of_the_shift_holds_for_thin_films(high, high_cavity):
    """A real stack's band moves as sqrt(1 - (sin a / n)^2), n fitted, to 0.2 nm up to 35 deg.

    The band moves by 27 nm at least. n agrees with Pidgeon and Smith's closed form to 2 %.
    Does not prove a maker's n, nor the flat band of three cavities: one cavity's is pointed.
    """
    stack = multilayer.single_cavity(
        850.0, high=high, low=1.46, pairs=2 if high > 3 else 5, high_cavity=high_cavity
    )
    peaks = np.array([multilayer.peak_nm(stack, a, 740.0, 880.0) for a in ANGLES_DEG])
    assert peaks[0] - peaks[-1] > 27
    index = multilayer.fitted_index(ANGLES_DEG, peaks, 850.0)
    law = 850.0 * bandpass.shift(np.deg2rad(ANGLES_DEG), index)
    assert abs(peaks - law).max() < 0.2
    closed = multilayer.first_order_index(high=high, low=1.46, high_cavity=high_cavity)
    assert index == pytest.approx(closed, rel=0.02)


def test_stack_passes_its_line_alone():
    """No layer absorbs: nearly all light passes at the centre, almost none 40 nm away."""
    stack = multilayer.single_cavity(850.0, pairs=6)
    passed = multilayer.transmittance(stack, np.array([810.0, 850.0, 890.0]), 0.0)
    assert passed[1] == pytest.approx(
        4 * 1.52 / 2.52**2, rel=1e-3
    )  # All light except the reflection of the glass.
    assert max(passed[0], passed[2]) < 0.02


@pytest.mark.parametrize(("light", "within"), [("even", 0.01), ("sun", 0.1), ("incandescent", 0.1)])
def test_broad_light_behind_a_filter(light, within):
    """The flat-spectrum formula agrees with the full integral of broad spectra, to 35 deg.

    The largest deviation is due to the sun's water bands at 820 nm.
    """
    spectrum = np.ones_like(GRID_NM) if light == "even" else spectra.irradiance(light, 1e4)

    def electrons(shift: float) -> float:
        passed = bandpass.transmission(GRID_NM / shift, centre_nm=850.0, width_nm=50.0)
        return integral(spectrum * passed * bandpass.absorbed(GRID_NM, 5.0) * GRID_NM)

    angles = np.deg2rad(ANGLES_DEG).astype(np.float32)
    expected = [electrons(float(s)) / electrons(1.0) for s in bandpass.shift(angles, 2.0)]
    seen = bandpass.ambient_transmission(angles, centre_nm=850.0, width_nm=50.0, index=2.0)
    assert seen[0] == 1
    np.testing.assert_allclose(seen, expected, rtol=within)


# --- refusals and imports ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: spectra.Band(wavelength_nm=0.85), "these micrometres are 850"),
        (lambda: spectra.Band(wavelength_nm=850e-9), "these metres are 850"),
        (lambda: through(0.0, width_nm=0.05), "filter width must be in [2, 500]"),
        (lambda: through(0.0, width_nm=-1.0), "filter width must be in"),
        (lambda: through(0.0, index=0.5), "filter index must be in"),
        (lambda: through(0.0, wavelength_nm=0.85), "laser wavelength must be in"),
        (
            lambda: bandpass.ambient_transmission(
                np.zeros(1), centre_nm=0.85, width_nm=50.0, index=2.0
            ),
            "filter centre must be in",
        ),
        (
            lambda: spectra.Band(filter_width_nm=20.0, filter_centre_nm=940.0),
            "band.filter_centre_nm must let the laser's 850 nm pass; got 940 nm, 20 nm wide.",
        ),
        (lambda: spectra.Band(epitaxy_um=0.0), "band.epitaxy_um must be > 0"),
        (lambda: spectra.Band(epitaxy_um=float("nan")), "band.epitaxy_um must be > 0"),
        (lambda: bandpass.depth_um(25.0, 850.0), "got 25.0. Give a share, not percent."),
        (
            lambda: spectra.ambient_w_m2("son", illuminance_lx=1.0, band=FILTERED),
            "light must be a known name; got 'son'. Known: sun,",
        ),
        (
            lambda: spectra.ambient_w_m2("sun", illuminance_lx=5e7, band=FILTERED),
            "illuminance_lx must be in [0, 150000]; got 50000000.0. Give lux",
        ),
        (
            lambda: spectra.in_band_irradiance(np.ones(5), FILTERED),
            "spectrum must be (1441,) numbers >= 0; got (5,), least 1.0.",
        ),
        (lambda: spectra.in_band_irradiance(-line(850.0), FILTERED), "spectrum must be (1441,)"),
        (lambda: multilayer.single_cavity(0.85), "these micrometres are 850"),
        (lambda: multilayer.single_cavity(850.0, high=1.4), "high must be in"),
        (lambda: multilayer.single_cavity(850.0, low=0.5), "low must be in"),
        (lambda: multilayer.single_cavity(850.0, pairs=0), "pairs must be in"),
    ],
)
def test_refusals(call, message):
    with pytest.raises(InputError, match=re.escape(message)):
        call()


def test_filters_need_no_heavy_library():
    """Each capture uses the filter, so it must not import colour-science, which takes seconds."""
    code = (
        "import sys; from starling.sim.scene import spectra; spectra.Band();"
        "print(*{'colour', 'scipy', 'cv2', 'mitsuba', 'matplotlib'} & set(sys.modules))"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.split() == []
