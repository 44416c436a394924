"""Flat targets before a camera, and the figures that vendors measure on them.

The target faces the camera, and the central 80 % of the field counts. The plane fit is that of
Intel's Depth Quality Tool (librealsense, tools/depth-quality/rs-depth-quality.cpp). The accuracy of
the tool and of Luxonis (docs.luxonis.com, depth accuracy) is the median of the signed error, in
which noise cancels. Ours is the median of the absolute error.
"""

from __future__ import annotations

import dataclasses
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.sim.geometry import frames
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene import spectra
from starling.sim.scene.builtin import solids
from starling.sim.scene.scene import Ambient, Body, Material, Mesh, Scene
from starling.sim.sensor.datasheets import Target
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import Shot, expose, render_layers, simulate

REFLECTANCE = 0.5  # Of targets at the laser's wavelength; assumed, vendors say white.
# Room light at the laser's wavelength [W m^-2]; assumed, vendors do not state it. For an imager
# without a filter, 17 lx of white LEDs have as much.
ROOM_W_M2 = 0.1
SUNLIGHT_LX = 50e3  # Daylight on the target; half of direct sunlight.
# Every figure is the mean over these multiples of the stated distance. A flat target has a single
# disparity, and the matcher's error depends on its fraction of a pixel.
AROUND = (0.98, 1.0, 1.02)
FRAMES = 5  # Frames of one target for the temporal noise.
STRIP_ROWS = 96  # Rows of the strip that replaces the image where only the range is searched.
_FIELD = 0.8  # Share of rows and columns on which vendors measure.
_RIGHT_SHARE = 0.1  # A larger error of the depth counts as missing, relative to the distance.
_FEWEST = 0.5  # Below this share of right depth, errors are NaN and a column is empty.
_OUTLIERS = 0.005  # Share of the least and of the greatest depths that a plane fit leaves out.
_TEXELS = 1024  # Texture of the textured target; about one texel for four pixels of 848.
_TEXTURE = (0.4, 1.6)  # Range of its reflectance, relative to that of a plain target.
_SIDE = 8.0  # Side of a target relative to its distance: 152 degrees.


@dataclass(frozen=True, kw_only=True, slots=True)
class FlatTarget:
    """A flat target that faces the camera, and its light."""

    distance_m: float
    target: Target = "plain"
    reflectance: float = REFLECTANCE  # Its mean, if the target is textured; at most 0.6 then.
    room_w_m2: float = ROOM_W_M2
    sunlight: bool = False  # 50 klux in place of room light.
    projector: bool = True


@dataclass(frozen=True, kw_only=True, slots=True)
class TargetFigures:
    """Figures of one target [percent]; errors are NaN if most of it has no right depth."""

    accuracy_pct: float  # Median of |z - truth| over the distance.
    bias_pct: float  # Median of z - truth over the distance.
    median_error_pct: float  # Its magnitude, at each of the near distances.
    plane_rms_pct: float  # RMS distance of z from its own plane, over the distance.
    fill_pct: float  # Share of the central 80 % with right depth.
    reachable_fill_pct: float  # Share of all pixels right of the geometric left band.
    left_band_pct: float  # Share of the columns, from the left, that have depth in few rows.


def scene(view: FlatTarget, sensor: Sensor) -> Scene:
    """Return the scene of a target; sunlight depends on the imager's band."""
    place = frames.pose((0, 0, view.distance_m))
    side_m = _SIDE * view.distance_m
    body = solids.body(
        "target",
        solids.plane(side_m, side_m),
        Material(name="target", reflectance=view.reflectance),
        place,
    )
    light = view.room_w_m2
    if view.sunlight:
        band = spectra.Band.from_imager(sensor.left, sensor.projector)
        light = spectra.ambient_w_m2("sun", illuminance_lx=SUNLIGHT_LX, band=band)
    if view.target == "textured":
        body = _textured(body)
    return Scene(name="target", bodies=(body,), ambient=Ambient(irradiance_w_m2=light))


def strip(sensor: Sensor) -> Sensor:
    """Return the sensor with only the middle rows of its image."""
    rows = min(STRIP_ROWS, sensor.height)
    top = (sensor.height - rows) // 2
    return dataclasses.replace(sensor, height=rows, cy_px=sensor.cy_px - top)


def measure(sensor: Sensor, view: FlatTarget, *, seed: int = 0) -> TargetFigures:
    """Simulate a target at three near distances and return the mean figures."""
    readings = []
    for multiple in AROUND:
        near = dataclasses.replace(view, distance_m=multiple * view.distance_m)
        readings.append(figures(_shot(sensor, near, seed), sensor, near.distance_m))
    names = [field.name for field in dataclasses.fields(TargetFigures)]
    return TargetFigures(
        **{name: statistics.fmean(getattr(item, name) for item in readings) for name in names}
    )


def fill_of_reachable(sensor: Sensor, view: FlatTarget, *, seed: int = 0) -> float:
    """Simulate a target once; return the share of the reachable area with right depth [percent]."""
    return figures(_shot(sensor, view, seed), sensor, view.distance_m).reachable_fill_pct


def temporal_noise_pct(sensor: Sensor, view: FlatTarget, *, seed: int = 0) -> float:
    """Return the median standard deviation of a pixel's depth over frames [percent]."""
    device = _powered(sensor, view)
    stage = scene(view, sensor)
    layers = render_layers(MitsubaScene(stage), device, seed=seed, quality="draft")
    shots = [expose(layers, stage, device, seed=seed, frame=frame) for frame in range(FRAMES)]
    depths = np.stack([_central(shot.depth.depth_m) for shot in shots]).astype(np.float64)
    seen = np.isfinite(depths).all(axis=0)
    if seen.mean() < _FEWEST:
        return float("nan")
    return 100 * float(np.median(depths[:, seen].std(axis=0, ddof=1))) / view.distance_m


def figures(shot: Shot, sensor: Sensor, distance_m: float) -> TargetFigures:
    """Measure one reading of a target."""
    depth = shot.depth.depth_m.astype(np.float64)
    truth = shot.layers.truth.depth_m.astype(np.float64)
    right = np.abs(depth - truth) < _RIGHT_SHARE * distance_m  # NaN is not.
    central, central_truth = _central(depth), _central(truth)
    known = np.isfinite(central)
    accuracy = bias = rms = float("nan")
    if _central(right).mean() >= _FEWEST:
        error = (central - central_truth)[known]
        accuracy, bias = float(np.median(np.abs(error))), float(np.median(error))
        rms = _plane_rms_m(central)
    filled_columns = np.flatnonzero(right.mean(axis=0) >= _FEWEST)
    band = filled_columns[0] if filled_columns.size else sensor.width
    return TargetFigures(
        accuracy_pct=100 * accuracy / distance_m,
        bias_pct=100 * bias / distance_m,
        median_error_pct=100 * abs(bias) / distance_m,
        plane_rms_pct=100 * rms / distance_m,
        fill_pct=100 * float(_central(right).mean()),
        reachable_fill_pct=100 * _mean(right[:, geometric_band_px(sensor, distance_m) :]),
        left_band_pct=100 * float(band) / sensor.width,
    )


def geometric_band_px(sensor: Sensor, distance_m: float) -> int:
    """Return the columns at the left that the right imager does not see: f b / Z.

    Structured light has no right imager, so it has no such band.
    """
    if sensor.kind == "structured_light":
        return 0
    return min(round(sensor.focal_baseline_px_m / distance_m), sensor.width)


def _mean(mask: NDArray[np.bool_]) -> float:
    return float(mask.mean()) if mask.size else 0.0


def _central(image: NDArray) -> NDArray:
    """Cut out the central 80 % of rows and columns."""
    height, width = image.shape
    edge = (1 - _FIELD) / 2
    rows = slice(round(edge * height), round((1 - edge) * height))
    return image[rows, round(edge * width) : round((1 - edge) * width)]


def _plane_rms_m(depth_m: NDArray[np.float64]) -> float:
    """Return the RMS distance in z from the least-squares plane, without outliers [m]."""
    height, width = depth_m.shape
    rows, columns = np.mgrid[:height, :width]
    low_m, high_m = np.nanquantile(depth_m, (_OUTLIERS, 1 - _OUTLIERS))
    known = (depth_m >= low_m) & (depth_m <= high_m)
    basis = np.stack([rows[known], columns[known], np.ones(known.sum())], axis=1)
    plane = np.linalg.lstsq(basis, depth_m[known], rcond=None)[0]
    return float(np.sqrt(np.mean((basis @ plane - depth_m[known]) ** 2)))


def _shot(sensor: Sensor, view: FlatTarget, seed: int) -> Shot:
    stage = MitsubaScene(scene(view, sensor))
    return simulate(stage, _powered(sensor, view), seed=seed, quality="draft")


def _powered(sensor: Sensor, view: FlatTarget) -> Sensor:
    """Return the sensor with its projector switched off if the target is to be seen without."""
    if view.projector:
        return sensor
    return dataclasses.replace(sensor, projector=dataclasses.replace(sensor.projector, power_w=0.0))


def _textured(plain: Body) -> Body:
    """Return a body with a random texture."""
    corners: Sequence[tuple[float, float]] = ((0, 0), (1, 0), (1, 1), (0, 1))
    mesh = Mesh(
        vertices=plain.mesh.vertices, faces=plain.mesh.faces, uv=np.array(corners, np.float32)
    )
    draw = np.random.default_rng(0)
    share = draw.uniform(*_TEXTURE, (_TEXELS, _TEXELS))
    texture = (plain.material.reflectance * share).astype(np.float32)
    return dataclasses.replace(plain, mesh=mesh, texture=texture)
