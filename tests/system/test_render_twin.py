"""The plugin-made twin of the renderer agrees with it, in another process and variant."""

import dataclasses
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from sim import render, sensors, stage
from sim.scenes import builtin

TWIN = """
import dataclasses, sys
import numpy as np
from sim import backend, render, sensors, stage
from sim.scenes import builtin
sensor = dataclasses.replace(
    sensors.load("d435"), width=160, height=90, fx_px=80.0, fy_px=80.0, cx_px=80.3, cy_px=44.1
)
layers = render.layers(stage.Stage(builtin.clutter()), sensor, subpixels=2)
assert not backend.is_jit()
np.savez(sys.argv[1], direct=layers.left.projector_direct, right=layers.right.projector_direct,
         ambient=layers.left.ambient, depth=layers.truth.depth_m, normal=layers.truth.normal,
         material=layers.truth.material, sees=layers.truth.right_sees, lit=layers.truth.lit)
"""


def test_both_renderers_agree(tmp_path):
    path = tmp_path / "twin.npz"
    environment = {**os.environ, "STARLING_VARIANT": "scalar_rgb"}
    root = Path(__file__).parents[2]
    subprocess.run([sys.executable, "-c", TWIN, str(path)], check=True, cwd=root, env=environment)
    twin = np.load(path)
    sensor = dataclasses.replace(
        sensors.load("d435"), width=160, height=90, fx_px=80.0, fy_px=80.0, cx_px=80.3, cy_px=44.1
    )
    layers = render.layers(stage.Stage(builtin.clutter()), sensor, subpixels=2)
    for name, mine in (
        ("direct", layers.left.projector_direct),
        ("right", layers.right.projector_direct),
    ):
        # Mitsuba's projector takes its vertical field from the image's rounded aspect.
        assert np.corrcoef(twin[name].ravel(), mine.ravel())[0, 1] > 0.995
        assert np.isclose(twin[name].mean(), mine.mean(), rtol=0.01)
    np.testing.assert_allclose(twin["depth"], layers.truth.depth_m, rtol=1e-4)
    np.testing.assert_allclose(twin["normal"], layers.truth.normal, atol=2e-3)
    assert np.array_equal(twin["material"], layers.truth.material)
    assert (twin["sees"] != layers.truth.right_sees).mean() < 1e-3
    assert (twin["lit"] != layers.truth.lit).mean() < 1e-3
    # The twin's ambient light has one position a pixel.
    assert np.isclose(twin["ambient"].mean(), layers.left.ambient.mean(), rtol=0.01)
