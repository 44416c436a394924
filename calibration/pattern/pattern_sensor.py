"""A recovered pattern as a sensor that renders it: pattern images on disk, emitters in place."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.calibration.pattern import dots
from starling.calibration.pattern.emitter_model import Emission, Model
from starling.calibration.pattern.lattice import Lattice
from starling.calibration.pattern.recovery import Recovered
from starling.calibration.pattern.unprojected import PatternImage
from starling.patterns import Pattern
from starling.patterns.dots import SIGMA_PER_FWHM
from starling.patterns.field import Field
from starling.sim.captures import png
from starling.sim.geometry import frames
from starling.sim.sensor.emitter import Emitter
from starling.sim.sensor.sensor import Sensor

_WIDTH_PX = 2048  # Of a written pattern: 0.75 mrad a pixel on a D415's axis.
_NARROWEST_MRAD = 1.0  # A dot's least sigma; less is the imager's blur taken for more than it is.
_DARKEST = 0.02  # Quantile of an image's values that is taken for no light.
_CODES = 65535


def with_pattern(sensor: Sensor, recovered: Recovered, folder: Path) -> Sensor:
    """Put a recovered pattern into a sensor.

    Args:
        sensor: that the captures were of.
        recovered: from `starling.calibration.pattern.recovery.recover`.
        folder: where `emitter-N.png` are written.

    Returns:
        The sensor with the emitters in their places, their patterns' full paths, and the right
        image's alignment and baseline as they were found.
    """
    model = recovered.fitted.model
    position = np.mean([one.position_m for one in model.emitters], axis=0)
    axes = frames.rotation(model.rotation_deg)
    emitters = []
    for number, (one, share) in enumerate(
        zip(model.emitters, recovered.fitted.shares, strict=True)
    ):
        path = folder / f"emitter-{number}.png"
        path.write_bytes(png.encode(_codes(_image(one, sensor))))
        offset = axes.T @ (one.position_m - position)
        emitters.append(
            Emitter(
                offset_m=_three(offset),
                pattern=str(path.resolve()),
                power_share=float(max(share, 1e-3)),
            )
        )
    light = dataclasses.replace(
        sensor.projector,
        position_m=_three(position),
        rotation_deg=model.rotation_deg,
        emitters=tuple(emitters),
        pattern=emitters[0].pattern,
    )
    return aligned(dataclasses.replace(sensor, projector=light), model)


def mirrored(sensor: Sensor, folder: Path) -> Sensor:
    """Turn every emitter's pattern over, left for right: a control that must match nothing."""
    emitters = []
    for number, one in enumerate(sensor.projector.emitters):
        path = folder / f"mirrored-{number}.png"
        image = np.asarray(png.read(Path(one.pattern), "pattern"), np.uint16)
        path.write_bytes(png.encode(np.ascontiguousarray(image[:, ::-1])))
        emitters.append(dataclasses.replace(one, pattern=str(path.resolve())))
    light = dataclasses.replace(sensor.projector, emitters=tuple(emitters))
    return dataclasses.replace(sensor, projector=light)


def aligned(sensor: Sensor, model: Model) -> Sensor:
    """Give a sensor the right image's rest that a model found."""
    rest = model.alignment
    old = sensor.right.alignment
    alignment = dataclasses.replace(
        old,
        offset_x_px=old.offset_x_px + rest.offset_x,
        offset_y_px=old.offset_y_px + rest.offset_y,
        # The model's image turns clockwise; the imager turns the other way.
        roll_deg=old.roll_deg - float(np.degrees(rest.roll / sensor.fx_px)),
    )
    return dataclasses.replace(
        sensor,
        baseline_m=sensor.baseline_m - rest.focal_baseline / sensor.fx_px,
        right=dataclasses.replace(sensor.right, alignment=alignment),
    )


def _image(emitter: Emission, sensor: Sensor) -> NDArray[np.floating[Any]]:
    field = Field(sensor.projector.fov_x_deg, sensor.projector.fov_y_deg)
    if isinstance(emitter.source, Lattice):
        return _drawn(emitter.source, field, sensor)
    return _resampled(emitter.source, field)


def _drawn(lattice: Lattice, field: Field, sensor: Sensor) -> NDArray[np.floating[Any]]:
    found = dots.of_lattice(lattice, sensor)
    return Pattern.of_dots(
        found.slopes[:, 0],
        found.slopes[:, 1],
        found.power,
        field=field,
        width_px=_WIDTH_PX,
        fwhm_mrad=max(found.sigma_mrad, _NARROWEST_MRAD) / SIGMA_PER_FWHM,
        background=0.0,
        name="lattice",
    ).image


def _resampled(source: PatternImage, field: Field) -> NDArray[np.floating[Any]]:
    """The image over the plane at unit distance, its darkest directions without light."""
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


def _three(vector: NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = map(float, vector)
    return x, y, z
