"""List the dots of a recovered pattern: direction, power and width."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.calibration.pattern.image_recovery import imager_blur_px
from starling.calibration.pattern.lattice import Lattice
from starling.calibration.pattern.recovery import RecoveredPattern
from starling.calibration.pattern.unprojected import PatternImage
from starling.sim.render import emission
from starling.sim.sensor.sensor import Sensor

_LEAST_HEIGHT = 3.0  # Minimum height of a dot's peak [standard errors].
_APART_PX = 5  # Side of the window of a local maximum, in pixels of the pattern image.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Dots:
    """Dots of one emitter."""

    slopes: NDArray[np.float64]  # (n, 2) tangents x/z, y/z of their directions.
    power: NDArray[np.float64]  # (n,) relative, mean 1.
    power_sd: NDArray[np.float64]  # (n,)
    sigma_mrad: float  # Width without the imager's blur.


def list_dots(recovered: RecoveredPattern, sensor: Sensor) -> tuple[Dots, ...]:
    """List the dots of each emitter.

    A lattice has dots in the whole field of the projector, all with power 1, because captures did
    not resolve differences (docs/design/calibration.md). The dots of an image are its local maxima.

    Args:
        recovered: result of `starling.calibration.pattern.recovery.recover`.
        sensor: sensor with the projector's field and the imager's blur.
    """
    dots = []
    for emitter in recovered.fitted.model.emitters:
        if isinstance(emitter.source, Lattice):
            dots.append(lattice_dots(emitter.source, sensor))
        else:
            dots.append(_image_dots(emitter.source))
    return tuple(dots)


def table(recovered: RecoveredPattern, sensor: Sensor) -> str:
    """Format the dots as CSV: emitter, tangents, power, its standard deviation, width."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(["emitter", "x_tangent", "y_tangent", "power", "power_sd", "sigma_mrad"])
    for number, dots in enumerate(list_dots(recovered, sensor)):
        for (x, y), power, deviation in zip(dots.slopes, dots.power, dots.power_sd, strict=True):
            row = [f"{v:.6g}" for v in (x, y, power, deviation, dots.sigma_mrad)]
            writer.writerow([number, *row])
    return stream.getvalue()


def lattice_dots(lattice: Lattice, sensor: Sensor) -> Dots:
    """List a lattice's dots in the projector's field, with the imager's blur removed."""
    blur = imager_blur_px(sensor) / sensor.fx_px
    half_x, half_y = emission.half_tangents(sensor.projector)
    far = float(np.hypot(half_x, half_y))
    reach = far / np.hypot(1, far)
    cosines = lattice.dots(reach, reach)
    cosines = cosines[(cosines**2).sum(axis=1) < 0.98]
    slopes = cosines / np.sqrt(1 - (cosines**2).sum(axis=1))[:, None]
    slopes = slopes[(np.abs(slopes) < [half_x, half_y]).all(axis=1)]
    sigma = float(np.sqrt(max(lattice.sigma**2 - blur**2, 0.0)))
    return Dots(
        slopes=slopes,
        power=np.ones(len(slopes)),
        power_sd=np.full(len(slopes), np.nan),
        sigma_mrad=1e3 * sigma,
    )


def _image_dots(source: PatternImage) -> Dots:
    value = np.where(np.isfinite(source.sd), source.value, 0).astype(np.float32)
    top = cv2.dilate(value, np.ones((_APART_PX, _APART_PX), np.uint8))
    rows, columns = np.nonzero((value == top) & (value > _LEAST_HEIGHT * source.sd))
    inside = (rows > 0) & (columns > 0)
    inside &= (rows < value.shape[0] - 1) & (columns < value.shape[1] - 1)
    rows, columns = rows[inside], columns[inside]
    a, b = source.grid.cosines()
    place_a = a[columns] + source.grid.step * _top(value, rows, columns, 0, 1)
    place_b = b[rows] + source.grid.step * _top(value, rows, columns, 1, 0)
    rest = np.sqrt(np.maximum(1 - place_a**2 - place_b**2, 1e-6))
    height = value[rows, columns].astype(np.float64)
    mean = max(float(height.mean()), 1e-12) if len(height) else 1.0
    return Dots(
        slopes=np.stack([place_a / rest, place_b / rest], axis=1),
        power=height / mean,
        power_sd=np.asarray(source.sd[rows, columns] / mean, np.float64),
        sigma_mrad=1e3 * source.grid.step * _width(value, rows, columns),
    )


def _top(
    value: NDArray, rows: NDArray, columns: NDArray, down: int, across: int
) -> NDArray[np.floating]:
    """Return the sub-pixel peak of a parabola through three pixels, -0.5 to 0.5."""
    before, centre = value[rows - down, columns - across], value[rows, columns]
    after = value[rows + down, columns + across]
    curvature = np.minimum(before - 2 * centre + after, -1e-6)
    return np.clip(0.5 * (before - after) / curvature, -0.5, 0.5)


def _width(value: NDArray, rows: NDArray, columns: NDArray) -> float:
    """Return the median sigma [px] of the peaks as Gaussians, from the centre and 4 neighbours."""
    if not len(rows):
        return float("nan")
    neighbours = (
        sum(value[rows + i, columns + j] for i, j in ((0, 1), (0, -1), (1, 0), (-1, 0))) / 4
    )
    ratio = np.clip(neighbours / np.maximum(value[rows, columns], 1e-6), 1e-3, 0.999)
    return float(np.median(np.sqrt(-1 / (2 * np.log(ratio)))))
