"""What an imager should read of each light of a scene, before strengths and reflectance are known.

Light is linear: signal = power laser + irradiance ambient + other [DN above black].
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.sim.geometry import frames
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.imaging.imager import electrons_per_radiance, mixed
from starling.sim.imaging.imager.exposure import Exposure
from starling.sim.imaging.signals import signals
from starling.sim.imaging.steady import steady
from starling.sim.render.layers import Image, Mask, View
from starling.sim.scene.scene import Scene
from starling.sim.sensor.sensor import Imager, Sensor

Side = Literal["left", "right"]

_DARKEST = 1e-3  # Share of the pixels whose level bounds the black level from above.
_JUMP = 0.02  # Relative step of depth between neighbours that makes an edge.
_EDGE_PX = 4  # Pixels on each side of an edge that blur and wrong geometry reach.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Levels:
    """Signal of one imager under lights of unit strength [DN above black], each (h, w)."""

    laser: Image  # Projector of 1 W.
    even: Image  # The same, all of its light between its dots.
    sharp_laser: Image  # `laser` before crosstalk and averaging, as speckle meets it.
    sharp_even: Image  # `even` likewise.
    ambient: Image  # Ambient light of 1 W m^-2.
    other: Image  # Sun and other projectors, at their own strength.
    lens_log_cos: Image  # log cos of the angle off the imager's axis: d log signal / d vignetting.
    projector_log_cos: Image  # Likewise off the projector's axis: d log laser / d falloff.


def part(sensor: Sensor, side: Side) -> Imager:
    """The imager of a side."""
    return sensor.left if side == "left" else sensor.right


def dn_per_electron(imager: Imager, exposure: Exposure) -> float:
    """Conversion at the gain of an image [DN / electron]."""
    return exposure.gain * imager.ceiling_dn / imager.full_well_e


def expected(
    view: View, even: View, scene: Scene, sensor: Sensor, side: Side, exposure: Exposure
) -> Levels:
    """Take a view's layers through optics and imager, light by light, without noise.

    Speckle, flicker, gamma and what is a pixel's own are left out; the mean does not move.

    Args:
        view: of one imager, rendered with this sensor's geometry and projector.
        even: the same with a `haze` of 1.
        scene: it is of; its interreflection counts, the strength of its ambient light does not.
        sensor: whose optics and imager act.
        side: which imager.
        exposure: time and gain of the image.
    """
    unit = dataclasses.replace(steady(sensor.projector), power_w=1.0)
    sensor = dataclasses.replace(sensor, projector=unit)
    imager, wavelength = part(sensor, side), sensor.projector.wavelength_nm
    electrons = electrons_per_radiance(imager, wavelength, exposure.exposure_s)
    scale = np.float32(electrons * dn_per_electron(imager, exposure))
    apart = signals(view, scene, sensor, side)
    dark = np.zeros_like(view.ambient)
    # What `view` has is not formed twice.
    alone = dataclasses.replace(even, ambient=dark, other=dark)
    sharp_laser = apart.laser * scale
    sharp_even = signals(alone, scene, sensor, side).laser * scale

    return Levels(
        laser=mixed(imager, sharp_laser),
        even=mixed(imager, sharp_even),
        sharp_laser=sharp_laser,
        sharp_even=sharp_even,
        ambient=mixed(imager, apart.ambient * scale),
        other=mixed(imager, apart.other * scale),
        lens_log_cos=np.asarray(-0.5 * np.log1p(Pinhole.of(sensor).tangent_squared()), np.float32),
        projector_log_cos=_projector_log_cos(view.depth_m, sensor, side),
    )


def away_from_edges(depth_m: Image) -> Mask:
    """Whether each pixel (h, w) sees a surface and no step of depth is within 4 px."""
    depth = np.where(np.isfinite(depth_m), depth_m, 0).astype(np.float32)
    square = np.ones((3, 3), np.uint8)
    highest, lowest = cv2.dilate(depth, square), cv2.erode(depth, square)
    edge = (highest > lowest * (1 + 2 * _JUMP)) | (lowest <= 0)
    reach = np.ones((2 * _EDGE_PX + 1, 2 * _EDGE_PX + 1), np.uint8)
    return cv2.dilate(edge.astype(np.uint8), reach) == 0


def lower_envelope_dn(level: NDArray) -> float:
    """Level that a thousandth of the pixels do not exceed [DN]: the black level is hardly higher.

    Args:
        level: image (h, w) [DN].
    """
    return float(np.quantile(level, _DARKEST))


def _projector_log_cos(depth_m: Image, sensor: Sensor, side: Side) -> Image:
    """log cos of the angle at which each pixel's surface point is off the projector's axis."""
    height, width = depth_m.shape
    x = (np.arange(width, dtype=np.float64) - sensor.cx_px) / sensor.fx_px
    y = (np.arange(height, dtype=np.float64) - sensor.cy_px) / sensor.fy_px
    depth = np.where(np.isfinite(depth_m), depth_m, 1.0).astype(np.float64)
    shift = 0.0 if side == "left" else sensor.baseline_m * (1 + sensor.baseline_error)
    points = np.stack([x * depth + shift, y[:, None] * depth, depth], axis=-1)
    pose = frames.pose(sensor.projector.position_m, sensor.projector.rotation_deg)
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    cosine = local[..., 2] / np.linalg.norm(local, axis=-1)
    return np.log(np.maximum(cosine, 1e-3)).astype(np.float32)
