"""Scenes as visible light shows them: with visible reflectances, without infrared projectors."""

from __future__ import annotations

import dataclasses

import numpy as np

from starling.sim.scene.scene import Body, Scene
from starling.sim.sensor.sensor import Sensor

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)  # Rec. ITU-R BT.709-6, 3.2.


def in_band(scene: Scene, sensor: Sensor) -> Scene:
    """Return the scene in the band of a sensor; the same object for an infrared sensor.

    A sensor is of visible light if `projector.wavelength_nm` is. Reflectances become the luminance
    of the materials' `rgb`; materials without it keep theirs. A filter blocks the infrared light of
    another device's projector. Mosaics of colour filters are not modelled.

    Args:
        scene: scene with near-infrared reflectances.
        sensor: sensor that observes it.
    """
    if not sensor.projector.visible:
        return scene
    bodies = tuple(_in_band(body) for body in scene.bodies)
    projector = scene.other_projector
    if sensor.left.lens.filter_width_nm and not projector.visible:
        projector = dataclasses.replace(projector, power_w=0.0)
    return dataclasses.replace(scene, bodies=bodies, other_projector=projector)


def is_coloured(body: Body) -> bool:
    """Whether a body has a visible reflectance of its own."""
    return body.colour is not None or body.material.rgb is not None


def _in_band(body: Body) -> Body:
    if body.colour is not None:
        return dataclasses.replace(body, texture=body.colour @ LUMINANCE)
    return with_reflectance(body, luminance(body))


def luminance(body: Body) -> float:
    """Visible reflectance of a body's material; its own without a colour."""
    material = body.material
    if material.rgb is None:
        return material.reflectance
    return float(LUMINANCE @ np.array(material.rgb, np.float32))


def with_reflectance(body: Body, reflectance: float) -> Body:
    """Return a body of another reflectance; its texture is scaled by the factor, to at most 1."""
    material, texture = body.material, body.texture
    if reflectance == material.reflectance:
        return body
    if texture is not None:
        tint = reflectance / max(material.reflectance, 1e-3)
        texture = np.minimum(texture * np.float32(tint), np.float32(1))
    material = dataclasses.replace(material, reflectance=reflectance)
    return dataclasses.replace(body, material=material, texture=texture)
