"""The renderer agrees with the scalar variant, which uses Mitsuba's plugins in another process.

Common errors remain undetected: both use the same code for pattern, power and poses.
"""

import dataclasses
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from starling.sim.render import direct, mitsuba_scene
from starling.sim.render.layers import Layers
from starling.sim.scene.builtin import scenes
from starling.sim.scene.scene import Body
from starling.sim.sensor import presets
from starling.sim.sensor.projector import Emitter
from starling.sim.sensor.sensor import Sensor

TWIN = """
import sys
import numpy as np
from starling.sim.render import backend
from tests.system import test_render_twin as twin
layers = twin.rendered(sys.argv[1])
assert not backend.is_jit()
np.savez(sys.argv[2], direct=layers.left.projector_direct, right=layers.right.projector_direct,
         ambient=layers.left.ambient, depth=layers.truth.depth_m, normal=layers.truth.normal,
         material=layers.truth.material, sees=layers.truth.right_sees, lit=layers.truth.lit)
"""


def camera(name: str) -> Sensor:
    """A small D435, or one with the D415's emitters, farther apart and rotated."""
    sensor = dataclasses.replace(
        presets.load("d435"), width=160, height=90, fx_px=80.0, fy_px=80.0, cx_px=80.3, cy_px=44.1
    )
    if name == "one emitter":
        return sensor
    light = presets.load("d415").projector
    left, right = (emitter.pattern for emitter in light.emitters)
    emitters = (
        Emitter(offset_m=(-0.02, 0.01, -0.003), pattern=left, power_share=3.0),
        Emitter(offset_m=(0.05, 0.0, 0.0), rotation_deg=(2.0, -3.0, 10.0), pattern=right),
    )
    return dataclasses.replace(sensor, projector=dataclasses.replace(light, emitters=emitters))


def unevenly_lit(body: Body, share: np.ndarray) -> Body:
    """The body with an ambient share that varies along the world's x axis."""
    mesh = dataclasses.replace(body.mesh, uv=body.mesh.vertices[:, :2])
    return dataclasses.replace(body, mesh=mesh, ambient_share=share)


def rendered(name: str) -> Layers:
    """Layers of a cluttered table; with two emitters the ambient light is uneven."""
    scene = scenes.clutter()
    if name == "two emitters":
        share = np.repeat(np.array([[0.5, 2.5]], np.float32), 2, axis=0)
        bodies = [unevenly_lit(body, share) for body in scene.bodies[::2]]
        scene = dataclasses.replace(scene, bodies=(*bodies, *scene.bodies[1::2]))
    return direct.layers(mitsuba_scene.MitsubaScene(scene), camera(name), subpixels=2)


@pytest.mark.parametrize("name", ["one emitter", "two emitters"])
def test_both_renderers_agree(tmp_path: Path, name: str) -> None:
    path = tmp_path / "twin.npz"
    environment = {**os.environ, "STARLING_VARIANT": "scalar_rgb"}
    root = Path(__file__).parents[2]
    subprocess.run(
        [sys.executable, "-c", TWIN, name, str(path)], check=True, cwd=root, env=environment
    )
    twin = np.load(path)
    layers = rendered(name)
    assert layers.right is not None
    for key, mine in (
        ("direct", layers.left.projector_direct),
        ("right", layers.right.projector_direct),
    ):
        # Mitsuba's projector derives its vertical field from the image's rounded aspect.
        assert np.corrcoef(twin[key].ravel(), mine.ravel())[0, 1] > 0.995
        assert np.isclose(twin[key].mean(), mine.mean(), rtol=0.01)
    np.testing.assert_allclose(twin["depth"], layers.truth.depth_m, rtol=1e-4)
    np.testing.assert_allclose(twin["normal"], layers.truth.normal, atol=2e-3)
    assert np.array_equal(twin["material"], layers.truth.material)
    assert (twin["sees"] != layers.truth.right_sees).mean() < 1e-3
    assert (twin["lit"] != layers.truth.lit).mean() < 1e-3
    # The scalar variant samples ambient light once per pixel.
    assert np.isclose(twin["ambient"].mean(), layers.left.ambient.mean(), rtol=0.01)
    alike = np.isclose(twin["ambient"], layers.left.ambient, rtol=0.02)
    assert alike.mean() > 0.85
