"""A sensor in larger or smaller pixels of the same imager.

A scaled pixel averages the imager's pixels below it, so its noise is that of their sum. Lens and
imager stay as they are: what they do is the same in metres, and differs in pixels.
"""

from __future__ import annotations

import dataclasses
import math

from starling.patterns import errors
from starling.sim.sensor.imager import Alignment, Imager, Lens
from starling.sim.sensor.projector import Projector
from starling.sim.sensor.sensor import Sensor

_SAME_FIELD = 0.01  # Largest relative difference of two fields that count as equal.


@dataclasses.dataclass(frozen=True, kw_only=True, slots=True)
class _Zoom:
    """How an image follows from an image of the same imager."""

    ratio: float  # Pixels of the new image per pixel of the old.
    area: float  # Area of a new pixel over that of an old.
    radius: float  # Half the diagonal of the new image over that of the old, on the imager.
    rows: float  # Height of the new image over that of the old, on the imager.
    same_field: bool


def scaled(sensor: Sensor, ratio: float, width: int, height: int) -> Sensor:
    """Return the sensor with another image from the middle of its imager.

    Whole numbers are centres of pixels. A centre c [px] becomes (c + 0.5) ratio - 0.5, less the
    columns that are cut off. The nearest distance of a stereo camera follows the focal length,
    because its search has a fixed number of disparities.

    Args:
        sensor: sensor to scale.
        ratio: pixels of the new image per pixel of the old, along a row.
        width: width of the new image [px].
        height: height of the new image [px].

    Raises:
        InputError: if the result is impossible, or a warp of the image cannot be cropped.
    """
    diagonal = math.hypot(width, height) / math.hypot(sensor.width, sensor.height)
    across, down = width / sensor.width / ratio, height / sensor.height / ratio
    zoom = _Zoom(
        ratio=ratio,
        area=ratio**-2,
        radius=diagonal / ratio,
        rows=down,
        same_field=max(abs(across - 1), abs(down - 1)) < _SAME_FIELD,
    )
    near_m = sensor.post.near_m * (ratio if sensor.kind == "stereo" else 1)
    return dataclasses.replace(
        sensor,
        width=width,
        height=height,
        fx_px=sensor.fx_px * ratio,
        fy_px=sensor.fy_px * ratio,
        cx_px=_centre(sensor.cx_px, sensor.width, ratio, width),
        cy_px=_centre(sensor.cy_px, sensor.height, ratio, height),
        left=_imager(sensor.left, zoom),
        right=_imager(sensor.right, zoom),
        projector=_projector(sensor, zoom),
        post=dataclasses.replace(sensor.post, near_m=near_m),
    )


def at_rate(sensor: Sensor, fps: float, *, before: float) -> Sensor:
    """Return the sensor at another frame rate: exposure and readout fit into a frame.

    The limit of the exposure is the same share of a frame as before.

    Args:
        sensor: sensor to change.
        fps: frame rate [1/s].
        before: frame rate that the sensor's numbers hold at [1/s].
    """

    def timed(imager: Imager) -> Imager:
        limit_s = imager.auto_exposure_max_s * before / fps
        return dataclasses.replace(
            imager,
            auto_exposure_max_s=limit_s,
            exposure_s=min(imager.exposure_s, limit_s),
            rolling_shutter_s=min(imager.rolling_shutter_s, 1 / fps),
        )

    if fps == before:
        return sensor
    return dataclasses.replace(sensor, left=timed(sensor.left), right=timed(sensor.right))


def _centre(centre_px: float, side: int, ratio: float, new_side: int) -> float:
    return (new_side - 1) / 2 + ratio * (centre_px - (side - 1) / 2)


def _imager(imager: Imager, zoom: _Zoom) -> Imager:
    ratio, area = zoom.ratio, zoom.area
    return dataclasses.replace(
        imager,
        lens=_lens(imager.lens, zoom),
        alignment=_alignment(imager.alignment, zoom),
        pixel_pitch_m=imager.pixel_pitch_m / ratio,
        rolling_shutter_s=imager.rolling_shutter_s * zoom.rows,
        # Sums over the pixels that are averaged.
        full_well_e=imager.full_well_e * area,
        dark_current_e_s=imager.dark_current_e_s * area,
        # Independent in each pixel.
        read_noise_e=imager.read_noise_e / ratio,
        dsnu_e=imager.dsnu_e / ratio,
        prnu=imager.prnu * ratio,
        pattern_px=imager.pattern_px * ratio,
        hot_pixels=imager.hot_pixels * area,
        # Equal along a line: its pixels add up, and the lines are independent.
        column_noise_e=imager.column_noise_e * area**0.75,
        row_noise_e=imager.row_noise_e * area**0.75,
        # Charge crosses the border of a pixel, which grows less than its area.
        crosstalk=imager.crosstalk * ratio,
    )


def _lens(lens: Lens, zoom: _Zoom) -> Lens:
    return dataclasses.replace(
        lens,
        blur_px=lens.blur_px * zoom.ratio,
        corner_blur_px=lens.corner_blur_px * zoom.ratio * zoom.radius,
        defocus_px_m=lens.defocus_px_m * zoom.ratio,
    )


def _alignment(alignment: Alignment, zoom: _Zoom) -> Alignment:
    if alignment.warp_px and not zoom.same_field:
        raise errors.refuse(
            "alignment.warp_px",
            "must be () where a mode shows another field of view",
            f"{len(alignment.warp_px)} rows",
            "Calibrate in that mode, or set alignment.warp_px=[].",
        )
    return dataclasses.replace(
        alignment,
        offset_x_px=alignment.offset_x_px * zoom.ratio,
        offset_y_px=alignment.offset_y_px * zoom.ratio,
        distortion_px=alignment.distortion_px * zoom.ratio * zoom.radius**3,
        warp_px=tuple(tuple(value * zoom.ratio for value in row) for row in alignment.warp_px),
        waves_px=alignment.waves_px * zoom.ratio,
    )


def _projector(sensor: Sensor, zoom: _Zoom) -> Projector:
    """Speckle averages over the grains in a pixel, 1 + (pitch / grain)^2 of them."""
    grain_m = sensor.projector.wavelength_nm * 1e-9 * sensor.left.lens.f_number
    grains = (sensor.left.pixel_pitch_m / grain_m) ** 2
    share = math.sqrt((1 + grains) / (1 + grains * zoom.area))
    contrast = min(sensor.projector.speckle_contrast * share, 1.0)
    return dataclasses.replace(sensor.projector, speckle_contrast=contrast)
