"""Put a recovered pattern into a sensor: write pattern images, set the emitters."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.calibration.pattern import dots
from starling.calibration.pattern.emitter_model import EmitterModel, PatternEmitter
from starling.calibration.pattern.lattice import Lattice
from starling.calibration.pattern.recovery import RecoveredPattern
from starling.calibration.pattern.unprojected import PatternImage
from starling.patterns import Pattern
from starling.patterns.dots import SIGMA_PER_FWHM
from starling.patterns.field import Field
from starling.sim.captures import png
from starling.sim.geometry import frames
from starling.sim.sensor.projector import Emitter
from starling.sim.sensor.sensor import Sensor

_WIDTH_PX = 2048  # Width of a written pattern; 0.75 mrad per pixel on a D415's axis.
_NARROWEST_MRAD = 1.0  # Minimum sigma of a dot; a smaller one means an overestimated blur.
_DARKEST = 0.02  # Quantile of an image's values that counts as dark.
_CODES = 65535  # Largest 16-bit code.


def with_pattern(sensor: Sensor, recovered: RecoveredPattern, folder: Path) -> Sensor:
    """Put a recovered pattern into a sensor.

    Args:
        sensor: sensor of the captures.
        recovered: result of `starling.calibration.pattern.recovery.recover`.
        folder: output folder of the files `emitter-N.png`.

    Returns:
        The sensor with the fitted emitters, absolute paths of their patterns, and the fitted
        baseline and alignment of the right image.
    """
    model = recovered.fitted.model
    position = np.mean([emitter.position_m for emitter in model.emitters], axis=0)
    axes = frames.rotation(model.rotation_deg)
    emitters = []
    for number, (emitter, share) in enumerate(
        zip(model.emitters, recovered.fitted.shares, strict=True)
    ):
        path = folder / f"emitter-{number}.png"
        path.write_bytes(png.encode(_codes(_image(emitter, sensor))))
        offset = axes.T @ (emitter.position_m - position)
        emitters.append(
            Emitter(
                offset_m=_as_tuple(offset),
                pattern=str(path.resolve()),
                power_share=float(max(share, 1e-3)),
            )
        )
    light = dataclasses.replace(
        sensor.projector,
        position_m=_as_tuple(position),
        rotation_deg=model.rotation_deg,
        emitters=tuple(emitters),
        pattern=emitters[0].pattern,
    )
    return with_alignment(dataclasses.replace(sensor, projector=light), model)


def with_mirrored_pattern(sensor: Sensor, folder: Path) -> Sensor:
    """Mirror each emitter's pattern left to right, as a control without correlation."""
    emitters = []
    for number, emitter in enumerate(sensor.projector.emitters):
        path = folder / f"mirrored-{number}.png"
        image = np.asarray(png.read(Path(emitter.pattern), "pattern"), np.uint16)
        path.write_bytes(png.encode(np.ascontiguousarray(image[:, ::-1])))
        emitters.append(dataclasses.replace(emitter, pattern=str(path.resolve())))
    light = dataclasses.replace(sensor.projector, emitters=tuple(emitters))
    return dataclasses.replace(sensor, projector=light)


def with_alignment(sensor: Sensor, model: EmitterModel) -> Sensor:
    """Apply a model's alignment of the right image to a sensor."""
    shift = model.alignment
    old = sensor.right.alignment
    alignment = dataclasses.replace(
        old,
        offset_x_px=old.offset_x_px + shift.offset_x,
        offset_y_px=old.offset_y_px + shift.offset_y,
        # A clockwise rotation of the image is a counterclockwise rotation of the imager.
        roll_deg=old.roll_deg - float(np.degrees(shift.roll / sensor.fx_px)),
    )
    return dataclasses.replace(
        sensor,
        baseline_m=sensor.baseline_m - shift.focal_baseline / sensor.fx_px,
        right=dataclasses.replace(sensor.right, alignment=alignment),
    )


def _image(emitter: PatternEmitter, sensor: Sensor) -> NDArray[np.floating[Any]]:
    field = Field(sensor.projector.fov_x_deg, sensor.projector.fov_y_deg)
    if isinstance(emitter.source, Lattice):
        return _draw(emitter.source, field, sensor)
    return _resample(emitter.source, field)


def _draw(lattice: Lattice, field: Field, sensor: Sensor) -> NDArray[np.floating[Any]]:
    lattice_dots = dots.lattice_dots(lattice, sensor)
    return Pattern.from_dots(
        lattice_dots.slopes[:, 0],
        lattice_dots.slopes[:, 1],
        lattice_dots.power,
        field=field,
        width_px=_WIDTH_PX,
        fwhm_mrad=max(lattice_dots.sigma_mrad, _NARROWEST_MRAD) / SIGMA_PER_FWHM,
        background=0.0,
        name="lattice",
    ).image


def _resample(source: PatternImage, field: Field) -> NDArray[np.floating[Any]]:
    """Resample the image to the plane at unit distance; its darkest directions become 0."""
    height, width = field.shape(_WIDTH_PX)
    x, y = field.tangents(np.arange(width), np.arange(height), (height, width))
    x, y = np.meshgrid(x, y)
    far = np.sqrt(1 + x**2 + y**2)
    place = source.grid.place(np.stack([x / far, y / far], axis=-1)).astype(np.float32)
    across, down = place[..., 0], place[..., 1]
    known = np.isfinite(source.sd)
    value = np.where(known, source.value, 0).astype(np.float32)
    image = cv2.remap(value, across, down, cv2.INTER_CUBIC, borderMode=cv2.BORDER_CONSTANT)
    dark = np.quantile(value[known], _DARKEST) if known.any() else 0.0
    return np.maximum(np.asarray(image) - dark, 0)


def _codes(image: NDArray[np.floating[Any]]) -> NDArray[np.uint16]:
    top = float(image.max())
    return np.rint(image / max(top, 1e-20) * _CODES).astype(np.uint16)


def _as_tuple(vector: NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = map(float, vector)
    return x, y, z
