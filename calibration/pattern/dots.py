"""A recovered pattern's dots as a list: direction, power and width."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.calibration.pattern.image_recovery import imager_blur_px
from starling.calibration.pattern.lattice import Lattice
from starling.calibration.pattern.recovery import Recovered
from starling.calibration.pattern.unprojected import PatternImage
from starling.sim.render import emission
from starling.sim.sensor.sensor import Sensor

_LEAST_HEIGHT = 3.0  # A dot's top over the pattern's uncertainty there.
_APART_PX = 5  # Of the pattern's image: tops nearer than half of this are one dot's.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Dots:
    """Dots of one emitter."""

    slopes: NDArray[np.float64]  # (n, 2) tangents x/z, y/z of their directions.
    power: NDArray[np.float64]  # (n,) relative, mean 1.
    power_sd: NDArray[np.float64]  # (n,)
    sigma_mrad: float  # Their own width, the imager's blur taken off.


def of(recovered: Recovered, sensor: Sensor) -> tuple[Dots, ...]:
    """List the dots of each emitter.

    A lattice's dots are all that fall into the projector's field; their powers are one, as far as
    captures told (see docs/decisions). An image's dots are its round tops.

    Args:
        recovered: from `starling.calibration.pattern.recovery.recover`.
        sensor: whose field they fill and whose blur is taken off.
    """
    out = []
    for one in recovered.fitted.model.emitters:
        if isinstance(one.source, Lattice):
            out.append(of_lattice(one.source, sensor))
        else:
            out.append(_of_image(one.source))
    return tuple(out)


def table(recovered: Recovered, sensor: Sensor) -> str:
    """Write the dots as CSV: emitter, tangents, power, its deviation, width."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(["emitter", "x_tangent", "y_tangent", "power", "power_sd", "sigma_mrad"])
    for number, found in enumerate(of(recovered, sensor)):
        for (x, y), power, deviation in zip(found.slopes, found.power, found.power_sd, strict=True):
            row = [f"{v:.6g}" for v in (x, y, power, deviation, found.sigma_mrad)]
            writer.writerow([number, *row])
    return stream.getvalue()


def of_lattice(lattice: Lattice, sensor: Sensor) -> Dots:
    """List a lattice's dots that fall into a sensor's field, the imager's blur taken off."""
    blur = imager_blur_px(sensor) / sensor.fx_px
    half_x, half_y = emission.half_tangents(sensor.projector)
    far = float(np.hypot(half_x, half_y))
    reach = far / np.hypot(1, far)
    cosines = lattice.dots(reach, reach)
    cosines = cosines[(cosines**2).sum(axis=1) < 0.98]
    slopes = cosines / np.sqrt(1 - (cosines**2).sum(axis=1))[:, None]
    slopes = slopes[(np.abs(slopes) < [half_x, half_y]).all(axis=1)]
    own = float(np.sqrt(max(lattice.sigma**2 - blur**2, 0.0)))
    return Dots(
        slopes=slopes,
        power=np.ones(len(slopes)),
        power_sd=np.full(len(slopes), np.nan),
        sigma_mrad=1e3 * own,
    )


def _of_image(source: PatternImage) -> Dots:
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
    """Where between pixels a parabola through three of them has its top, -0.5 to 0.5."""
    before, here = value[rows - down, columns - across], value[rows, columns]
    after = value[rows + down, columns + across]
    bend = np.minimum(before - 2 * here + after, -1e-6)
    return np.clip(0.5 * (before - after) / bend, -0.5, 0.5)


def _width(value: NDArray, rows: NDArray, columns: NDArray) -> float:
    """Median sigma [pixels] of the tops, as Gaussians: from the middle to its four neighbours."""
    if not len(rows):
        return float("nan")
    beside = sum(value[rows + i, columns + j] for i, j in ((0, 1), (0, -1), (1, 0), (-1, 0))) / 4
    ratio = np.clip(beside / np.maximum(value[rows, columns], 1e-6), 1e-3, 0.999)
    return float(np.median(np.sqrt(-1 / (2 * np.log(ratio)))))
