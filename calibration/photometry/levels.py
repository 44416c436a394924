"""Signal of an imager under each light of a scene, at unit strength.

Light is additive: signal = power * laser + irradiance * ambient + other [DN above black].
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.calibration.observation import Side
from starling.sim.arrays import Image, Mask
from starling.sim.geometry import frames
from starling.sim.imaging.imager import electrons_per_radiance, mix_pixels
from starling.sim.imaging.imager.exposure import Exposure
from starling.sim.imaging.signals import signals
from starling.sim.render.layers import ViewLayers
from starling.sim.scene.scene import Scene
from starling.sim.sensor.sensor import Imager, Sensor

_DARKEST = 1e-3  # Quantile of the level that is an upper bound of the black level.
_JUMP = 0.02  # Relative step of depth between neighbours at an edge.
_EDGE_PX = 4  # Excluded margin on each side of an edge (blur, geometry errors).


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Levels:
    """Signal of one imager under lights of unit strength [DN above black], each (h, w)."""

    laser: Image  # Projector of 1 W.
    even: Image  # Projector of 1 W with a haze of 1 (uniform light).
    sharp_laser: Image  # `laser` before crosstalk and averaging, where speckle acts.
    sharp_even: Image  # `even` before crosstalk and averaging.
    ambient: Image  # Ambient light of 1 W m^-2.
    other: Image  # Sun and other projectors, at their actual strength.
    projector_log_cos: Image  # log cos of the angle off the projector's axis.


def side_imager(sensor: Sensor, side: Side) -> Imager:
    """Return the imager of a side."""
    return sensor.left if side == "left" else sensor.right


def dn_per_electron(imager: Imager, exposure: Exposure) -> float:
    """Return the conversion gain at an exposure [DN / electron]."""
    return exposure.gain * imager.ceiling_dn / imager.full_well_e


def unit_levels(
    view: ViewLayers, even: ViewLayers, scene: Scene, sensor: Sensor, side: Side, exposure: Exposure
) -> Levels:
    """Apply optics and imager to each light layer of a view, without noise.

    Speckle, flicker, gamma and fixed-pattern noise are excluded; they do not change the mean.

    Args:
        view: layers of one imager, rendered with this sensor's geometry and projector.
        even: the same layers with a `haze` of 1.
        scene: scene of the view, for its interreflection; its ambient strength is not used.
        sensor: sensor with optics and imager.
        side: side of the imager.
        exposure: time and gain of the image.
    """
    unit = dataclasses.replace(sensor.projector.steady(), power_w=1.0)
    sensor = dataclasses.replace(sensor, projector=unit)
    imager, wavelength = side_imager(sensor, side), sensor.projector.wavelength_nm
    electrons = electrons_per_radiance(imager, wavelength, exposure.exposure_s)
    scale = np.float32(electrons * dn_per_electron(imager, exposure))
    separate = signals(view, scene, sensor, side)
    dark = np.zeros_like(view.ambient)
    # Ambient and other light of `even` equal those of `view`.
    even_only = dataclasses.replace(even, ambient=dark, other=dark)
    sharp_laser = separate.laser * scale
    sharp_even = signals(even_only, scene, sensor, side).laser * scale

    return Levels(
        laser=mix_pixels(imager, sharp_laser),
        even=mix_pixels(imager, sharp_even),
        sharp_laser=sharp_laser,
        sharp_even=sharp_even,
        ambient=mix_pixels(imager, separate.ambient * scale),
        other=mix_pixels(imager, separate.other * scale),
        projector_log_cos=_projector_log_cos(view.depth_m, sensor, side),
    )


def away_from_edges(depth_m: Image) -> Mask:
    """Select pixels (h, w) with a surface and without a depth step within 4 px."""
    depth = np.where(np.isfinite(depth_m), depth_m, 0).astype(np.float32)
    square = np.ones((3, 3), np.uint8)
    highest, lowest = cv2.dilate(depth, square), cv2.erode(depth, square)
    edge = (highest > lowest * (1 + 2 * _JUMP)) | (lowest <= 0)
    reach = np.ones((2 * _EDGE_PX + 1, 2 * _EDGE_PX + 1), np.uint8)
    return cv2.dilate(edge.astype(np.uint8), reach) == 0


def lower_envelope_dn(level: NDArray) -> float:
    """Return the 0.1 % quantile of the level [DN], an approximate upper bound of the black level.

    Args:
        level: image (h, w) [DN].
    """
    return float(np.quantile(level, _DARKEST))


def _projector_log_cos(depth_m: Image, sensor: Sensor, side: Side) -> Image:
    """Return log cos of the angle between the projector's axis and each surface point."""
    height, width = depth_m.shape
    x = (np.arange(width, dtype=np.float64) - sensor.cx_px) / sensor.fx_px
    y = (np.arange(height, dtype=np.float64) - sensor.cy_px) / sensor.fy_px
    depth = np.where(np.isfinite(depth_m), depth_m, 1.0).astype(np.float64)
    shift = 0.0 if side == "left" else sensor.true_baseline_m
    points = np.stack([x * depth + shift, y[:, None] * depth, depth], axis=-1)
    pose = frames.pose(sensor.projector.position_m, sensor.projector.rotation_deg)
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    cosine = local[..., 2] / np.linalg.norm(local, axis=-1)
    return np.log(np.maximum(cosine, 1e-3)).astype(np.float32)
