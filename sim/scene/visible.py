"""Scenes in visible light: with visible reflectances, without infrared projectors."""

from __future__ import annotations

import dataclasses

import numpy as np

from starling.sim.scene.scene import Body, Scene
from starling.sim.sensor.sensor import Sensor

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)  # Rec. ITU-R BT.709-6, 3.2.


def views(scene: Scene, sensor: Sensor) -> tuple[Scene, ...]:
    """Return the scene in the band of a sensor, and in each of its colours (see `bands`)."""
    return in_band(scene, sensor), *bands(scene, sensor)


def in_band(scene: Scene, sensor: Sensor) -> Scene:
    """Return the scene in the band of a sensor; the same object for an infrared sensor.

    A sensor is of visible light if `projector.wavelength_nm` is. Reflectances become the luminance
    of the bodies' colours; bodies without a colour keep theirs. A filter blocks the infrared light
    of another device's projector.

    Args:
        scene: scene with near-infrared reflectances.
        sensor: sensor that observes it.
    """
    if not sensor.projector.visible:
        return scene
    bodies = tuple(_in_band(body) for body in scene.bodies)
    return dataclasses.replace(_without_infrared(scene, sensor), bodies=bodies)


def bands(scene: Scene, sensor: Sensor) -> tuple[Scene, ...]:
    """Return the scene in red, green and blue light, for a sensor with a mosaic of colour filters.

    It is empty if all bands are equal: for an infrared sensor, no mosaic, or a grey scene.
    """
    mosaics = {sensor.left.mosaic, sensor.right.mosaic}
    if not sensor.projector.visible or mosaics == {"none"} or all(map(_is_grey, scene.bodies)):
        return ()
    scene = _without_infrared(scene, sensor)
    return tuple(in_channel(scene, channel) for channel in range(3))


def in_channel(scene: Scene, channel: int) -> Scene:
    """Return the scene with the reflectances of a colour: 0 red, 1 green, 2 blue."""
    bodies = tuple(_tinted(body, channel) for body in scene.bodies)
    return dataclasses.replace(scene, bodies=bodies)


def is_coloured(body: Body) -> bool:
    """Whether a body has a visible reflectance of its own."""
    return body.colour is not None or body.material.rgb is not None


def _is_grey(body: Body) -> bool:
    if body.colour is not None:
        return bool((body.colour == body.colour[..., :1]).all())
    return body.material.rgb is None or len(set(body.material.rgb)) == 1


def _tinted(body: Body, channel: int) -> Body:
    if body.colour is not None:
        return dataclasses.replace(body, texture=np.ascontiguousarray(body.colour[..., channel]))
    rgb = body.material.rgb
    return body if rgb is None else with_reflectance(body, rgb[channel])


def _without_infrared(scene: Scene, sensor: Sensor) -> Scene:
    projector = scene.other_projector
    if sensor.left.lens.filter_width_nm and not projector.visible:
        projector = dataclasses.replace(projector, power_w=0.0)
    return dataclasses.replace(scene, other_projector=projector)


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
