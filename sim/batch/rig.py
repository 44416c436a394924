"""Constants of a sensor on a device: pattern, lens, electronics."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from starling.sim.arrays import Image
from starling.sim.batch import handoff
from starling.sim.batch.imaging import PixelChain, Spot
from starling.sim.batch.light import EmitterBeam, PairCamera
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.imaging import imager as electronics
from starling.sim.imaging.imager import charge, converter, noise_colour
from starling.sim.imaging.optics import alignment, shading, speckle, spot
from starling.sim.render.emission import NEAREST_M
from starling.sim.scene.scene import Scene
from starling.sim.sensor.sensor import Imager, Sensor
from starling.sim.stereo.matching import TEN_BITS
from starling.sim.warp import layers

wp: Any = handoff.import_warp()

Side = Literal["left", "right"]


@dataclass(frozen=True, slots=True, eq=False)
class LightRig:
    """Geometry and lights. Surfaces nearer than 0.1 m may lack shadows at the image's sides."""

    camera: Any  # `light.PairCamera`
    focal_baseline: float  # With the true baseline [px m].
    beams: tuple[tuple[Any, Any], ...]  # `light.EmitterBeam` and the levels of its pattern.
    margin: int  # Columns on each side of an emitter's view [px].
    power: float  # [W]
    reflectance_scale: float


@dataclass(frozen=True, slots=True, eq=False)
class SideRig:
    """Lens and electronics of one imager."""

    spot: Any  # `imaging.Spot`
    weights: Any  # (levels, 2 reach + 1) of the uniform blurs.
    steps: Any  # (levels,) their variances [px^2].
    shift: Any  # (h, w) of the image to the right [px]; () is none.
    taps: Any  # (taps,) of speckle.
    quantiles: Any  # Gamma variates; () without speckle.
    shading: Any  # (h, w) vec2
    metered: tuple[slice, slice]  # Rows and columns of the exposure control.
    die: Any  # `imaging.PixelChain`
    fixed: Any  # (h, w) vec4
    colour: Any  # (taps,) of correlated noise; () for white noise.
    smoothing: Any  # (2 reach + 1,)


@dataclass(frozen=True, slots=True)
class ExposureRule:
    """How exposure time and gain follow the left image."""

    veil: float  # Share of the mean light that is spread over the left image.
    aim: float  # Mean signal to reach [DN]; infinite for a fixed time.
    signal: float  # [DN / (W m^-2 sr^-1 s)]
    longest_s: float
    gains: tuple[float, float]  # The sensor's own, and the highest.


def light_rig(sensor: Sensor, scene: Scene, device: Any) -> LightRig:
    """Copy geometry and lights to a device."""
    camera = PairCamera()
    camera.fx, camera.fy, camera.cx, camera.cy = (
        float(value) for value in (sensor.fx_px, sensor.fy_px, sensor.cx_px, sensor.cy_px)
    )
    camera.baseline = sensor.true_baseline_m
    beams = []
    for number, table in enumerate(layers.emitter_tables(sensor.projector)):
        levels, focus, width, log_ratio = layers.pattern_levels(
            sensor.projector, number, sensor.fx_px
        )
        beam = EmitterBeam()
        beam.origin = wp.vec3(*table[:3])
        beam.rotation = wp.mat33(*table[3:12])
        beam.half = wp.vec2(*table[12:14])
        beam.scale = float(table[14])
        beam.place = float(table[0]) / sensor.true_baseline_m
        beam.focus, beam.width, beam.log_ratio = float(focus), float(width), float(log_ratio)
        beams.append((beam, wp.array(levels, dtype=float, device=device)))
    focal_baseline = sensor.fx_px * sensor.true_baseline_m
    farthest = max(abs(beam.place) for beam, _ in beams)
    return LightRig(
        camera=camera,
        focal_baseline=focal_baseline,
        beams=tuple(beams),
        margin=math.ceil(farthest * focal_baseline / NEAREST_M) + 2,
        power=sensor.projector.power_w,
        reflectance_scale=scene.finish.reflectance_scale,
    )


def side_rig(sensor: Sensor, side: Side, device: Any) -> SideRig:
    """Copy lens and electronics of an imager to a device."""
    imager = sensor.left if side == "left" else sensor.right
    pinhole = Pinhole.from_camera(sensor)
    lens = imager.lens
    blur = Spot()
    blur.even = lens.blur_px**2
    blur.corner = (lens.corner_blur_px / pinhole.half_diagonal_px) ** 2
    blur.defocus, blur.focus = lens.defocus_px_m, 1 / lens.focus_m
    blur.cx, blur.cy = sensor.cx_px, sensor.cy_px
    blur.focal_baseline = sensor.fx_px * sensor.true_baseline_m
    steps = spot.levels(blur.even, _widest_px2(sensor, imager))
    contrast = sensor.projector.speckle_contrast
    grain_px = speckle.grain_size_px(
        wavelength_nm=sensor.projector.wavelength_nm,
        f_number=lens.f_number,
        pixel_pitch_m=imager.pixel_pitch_m,
    )
    smoothing = np.ones(1, np.float32)
    if imager.smoothing_px > 0:
        smoothing = converter.smoothing_weights(imager.smoothing_px).ravel()
    none = np.zeros(0, np.float32)
    arrays = {
        "weights": _stacked([spot.kernel(step) for step in steps]),
        "steps": np.array(steps, np.float32),
        "taps": speckle.taps_of_grain(grain_px),
        "quantiles": speckle.gamma_of_normal(contrast) if contrast > 0 else none,
        "smoothing": smoothing,
        "colour": none
        if imager.noise_correlation == 0
        else noise_colour.weights(imager.noise_correlation),
    }
    return SideRig(
        spot=blur,
        **{name: wp.array(values, dtype=float, device=device) for name, values in arrays.items()},
        shading=wp.array(_shading(sensor, imager, pinhole), dtype=wp.vec2, device=device),
        metered=electronics.metered_rows_columns(
            (sensor.height, sensor.width), imager.auto_exposure_roi
        ),
        die=_die(sensor, imager),
        shift=wp.array(_shift(sensor, imager, side), dtype=float, device=device),
        fixed=wp.array(_fixed(sensor, imager, side), dtype=wp.vec4, device=device),
    )


def exposure_rule(sensor: Sensor) -> ExposureRule:
    """Return how the left imager sets exposure time and gain; see `choose_exposure`."""
    imager, veil = sensor.left, sensor.left.lens.veil
    signal = imager.dn_per_electron * electronics.electrons_per_radiance(
        imager, sensor.projector.wavelength_nm, 1.0
    )
    if imager.auto_exposure_level == 0:
        return ExposureRule(veil, math.inf, signal, imager.exposure_s, (imager.gain, imager.gain))
    aim = imager.auto_exposure_level * imager.ceiling_dn - imager.black_level_dn
    gains = (imager.gain, max(imager.auto_exposure_max_gain, imager.gain))
    return ExposureRule(veil, max(aim, 1.0), signal, imager.auto_exposure_max_s, gains)


def _widest_px2(sensor: Sensor, imager: Imager) -> float:
    """Largest variance of a spot, of surfaces from 0.1 m to infinity [px^2]."""
    lens = imager.lens
    focus = 1 / lens.focus_m
    defocus = lens.defocus_px_m * max(focus, abs(1 / NEAREST_M - focus))
    corner = lens.corner_blur_px**2
    across = max(sensor.cx_px, sensor.width - sensor.cx_px)
    down = max(sensor.cy_px, sensor.height - sensor.cy_px)
    farther = (across**2 + down**2) / (sensor.width**2 + sensor.height**2) * 4
    return lens.blur_px**2 + corner * farther + defocus**2


def _stacked(kernels: list[Image]) -> Image:
    """Stack kernels of odd lengths, with zeros around the shorter ones."""
    longest = max(map(len, kernels))
    return np.stack([np.pad(each, (longest - len(each)) // 2) for each in kernels])


def _shading(sensor: Sensor, imager: Imager, pinhole: Pinhole) -> Image:
    """Transmission (h, w, 2) of the projector's and of other light."""
    lens, wavelength = imager.lens, sensor.projector.wavelength_nm
    if lens.filter_width_nm == 0:
        both = shading.vignetting(lens.vignetting, pinhole)
        return np.stack([both, both], axis=-1)
    parts = (
        shading.laser(lens, wavelength, pinhole),
        shading.rest(lens, imager.quantum_efficiency, wavelength, pinhole),
    )
    return np.stack(parts, axis=-1)


def _die(sensor: Sensor, imager: Imager) -> Any:
    die = PixelChain()
    wavelength = sensor.projector.wavelength_nm
    die.electrons = electronics.electrons_per_radiance(imager, wavelength, 1.0)
    die.veil = imager.lens.veil
    die.crosstalk, die.hot = imager.crosstalk, imager.hot_pixels
    # With a smooth pattern, `_fixed` holds the whole sensitivity.
    die.prnu = imager.prnu if imager.pattern_contrast == 0 else 1.0
    die.dark, die.shot, die.read = imager.dark_current_e_s, imager.shot_noise, imager.read_noise_e
    die.dsnu, die.row, die.column = imager.dsnu_e, imager.row_noise_e, imager.column_noise_e
    die.full_well, die.conversion = imager.full_well_e, imager.dn_per_electron
    die.own_gain = sensor.left.gain
    die.low, die.high = (float(end) for end in converter.clipping_range(imager))
    die.gamma, die.black = 1 / imager.gamma, imager.black_level_dn
    die.ceiling = float(imager.ceiling_dn)
    die.finer = 2.0 ** (imager.matched_bits - imager.bit_depth)
    die.matched_ceiling = 2.0**imager.matched_bits - 1
    die.excess = max(imager.matched_bits - TEN_BITS.bit_length(), 0)
    return die


def _shift(sensor: Sensor, imager: Imager, side: Side) -> Image:
    if alignment.is_aligned(imager.alignment):
        return np.zeros((0, 0), np.float32)
    die, pinhole = charge.Die(sensor.unit, side), Pinhole.from_camera(sensor)
    return alignment.shift(imager.alignment, pinhole, die)


def _fixed(sensor: Sensor, imager: Imager, side: Side) -> Image:
    """Fixed patterns (h, w, 4) of the device: sensitivity, DSNU, columns, hot pixels; see `Die`."""
    shape, die = (sensor.height, sensor.width), charge.Die(sensor.unit, side)
    patterns = np.zeros((*shape, 4), np.float32)
    patterns[..., 3] = 1.0
    if imager.pattern_contrast > 0:
        patterns[..., 0] = charge.sensitivity(imager, die, shape) - 1
    elif imager.prnu > 0:
        patterns[..., 0] = die.normal("prnu", shape)
    if imager.dsnu_e > 0:
        patterns[..., 1] = die.normal("dsnu", shape)
    if imager.column_noise_e > 0:
        patterns[..., 2] = die.normal("column", shape[1:])
    if imager.hot_pixels > 0:
        patterns[..., 3] = die.uniform("hot", shape)
    return patterns
