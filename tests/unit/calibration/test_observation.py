"""Reading of captured scenes: images, and surfaces on demand."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from starling.calibration import observation
from starling.patterns import InputError
from starling.sim.captures import capture
from starling.sim.captures.capture import CapturedScene
from starling.sim.scene import visible
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values

EYE = np.eye(4).tolist()


def _first(folder: Path) -> CapturedScene:
    return capture.open_set(folder).scenes[0]


def test_images_are_read_without_a_surface(small_set: Path) -> None:
    seen = observation.read(_first(small_set))
    assert seen.left is not None and seen.right is not None and seen.left_off is None
    assert seen.scene is None and not seen.metric and seen.repeats is None
    disparity = observation.truth_px(seen)
    assert disparity is not None
    np.testing.assert_allclose(disparity, 90.0 * 0.05, rtol=1e-6)  # A wall at 1 m.
    assert observation.truth_px(dataclasses.replace(seen, truth_m=None)) is None


def test_reference_depth_becomes_a_surface(small_set: Path) -> None:
    scene = _first(small_set)
    sensor = scene.info.geometry_into(presets.load("d415"))
    seen = observation.load(scene, sensor)
    assert seen.scene is not None and not seen.metric
    np.testing.assert_allclose(seen.scene.bodies[0].mesh.vertices[:, 2], 1.0, rtol=1e-3)


def test_a_posed_mesh_takes_precedence_over_reference_depth(small_set: Path) -> None:
    scene = _first(small_set)
    (scene.path / "scene.toml").write_text(f'scene = "wall:2"\nleft_from_world = {EYE}\n')
    seen = observation.load(scene, scene.info.geometry_into(presets.load("d415")))
    assert seen.scene is not None and seen.scene.name == "wall:2" and seen.metric


def test_a_posed_mesh_is_in_the_band_of_the_sensor(small_set: Path) -> None:
    """Visible luminance for a passive camera; a stated reflectance holds in either band."""
    scene = _first(small_set)
    device = scene.info.geometry_into(presets.load("d415"))
    passive = with_values(device, [("projector.power_w", 0.0), ("projector.wavelength_nm", 550.0)])
    known = f'scene = "tabletop"\nleft_from_world = {EYE}\n'
    stated = '[[materials]]\nbody = "*"\nreflectance = 0.3\n'
    for text in (known, known + stated):
        (scene.path / "scene.toml").write_text(text)
        near, seen = (observation.load(scene, sensor).scene for sensor in (device, passive))
        assert near is not None and seen is not None
        for body, visible_body in zip(near.bodies, seen.bodies, strict=True):
            expected = 0.3 if text != known else visible.luminance(body)
            assert visible_body.material.reflectance == pytest.approx(expected)
        assert any(visible.is_coloured(body) for body in near.bodies) == (text == known)


@pytest.mark.parametrize("missing", [("truth",), ("0/ir_left", "0/ir_right")])
def test_scenes_without_reference_have_no_surface(
    missing: tuple[str, ...], small_set: Path
) -> None:
    scene = _first(small_set)
    for name in missing:
        (scene.path / f"{name}.png").unlink()
    seen = observation.load(scene, scene.info.geometry_into(presets.load("d415")))
    assert seen.scene is None
    with pytest.raises(InputError, match=r"scene a must have a surface; got none\. Capture"):
        _ = seen.stage


def test_the_mitsuba_scene_is_cached(small_set: Path) -> None:
    """A copy of the observation has its own surface."""
    scene = _first(small_set)
    seen = observation.load(scene, scene.info.geometry_into(presets.load("d415")))
    assert seen.stage is seen.stage and seen.stage.scene is seen.scene
    renamed = dataclasses.replace(seen, name="b")
    assert renamed.stage is not seen.stage


def test_no_scene_is_refused() -> None:
    with pytest.raises(InputError, match="captures must hold a scene; got none"):
        observation.read_all([])
