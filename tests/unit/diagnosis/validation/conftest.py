"""A small analytic scene, a wall with a box in front of it, and a camera that sees it."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.chain import ExposedPair, expose
from starling.diagnosis.validation.camera.draws import Draws
from starling.diagnosis.validation.camera.light import LightView, SceneLight
from starling.diagnosis.validation.camera.nominal import Nominal, from_table
from starling.diagnosis.validation.camera.projector import Dots, gather

HEIGHT, WIDTH = 64, 96
WALL_M, BOX_M = 1.0, 0.5
LEAN = 0.4  # Slope of the wall, whose foot is nearer: 1 / z = 1 + 0.4 y / z.
_SPOT = 0.0125  # Sigma of a dot as a tangent; 1.5 px.
_PITCH = 0.07  # Distance of the dots as a tangent.
_HALF_FIELD = (1.0, 0.6128)  # Half of a field of 90 x 63 degrees, as tangents.

TABLE = {
    "width": WIDTH,
    "height": HEIGHT,
    "fx_px": 120.0,
    "fy_px": 120.0,
    "cx_px": 47.5,
    "cy_px": 31.5,
    "baseline_m": 0.05,
    "exposure_s": 0.01,
    "power_w": 0.15,
    "ambient_w_m2": 0.5,
    "ambient_gradient": 0.5,
    "full_well_e": 10000.0,
    "bit_depth": 8,
    "dn_per_e": 0.0255,
    "gain": 1.0,
    "black_level_dn": 4.0,
    "depth_unit_m": 0.001,
    "read_noise_e": 10.0,
    "shot_noise": 1.0,
    "lens_blur_px": 0.4,
    "projector_x_m": 0.025,
    "quantum_efficiency": 0.3,
    "pixel_pitch_m": 3e-6,
    "f_number": 2.0,
    "wavelength_nm": 850.0,
    "maker": "unknown keys are ignored",
}
CAPTURE = """sensor = "device"
width = 96
height = 64
fx_px = 120.0
fy_px = 120.0
cx_px = 47.5
cy_px = 31.5
baseline_m = 0.05
depth_unit_m = 0.001
source = "made by a test"
licence = "Apache-2.0"
notes = ""
"""


@pytest.fixture(scope="session")
def camera() -> Nominal:
    return from_table(TABLE)


@pytest.fixture(scope="session")
def dot_directions() -> np.ndarray:
    """Tangents (n, 2) of the dots: a jittered grid."""
    rng = np.random.default_rng(5)
    x = np.arange(-_HALF_FIELD[0], _HALF_FIELD[0], _PITCH)
    y = np.arange(-_HALF_FIELD[1], _HALF_FIELD[1], _PITCH)
    grid = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    return grid + rng.uniform(-0.25, 0.25, grid.shape) * _PITCH


@pytest.fixture(scope="session")
def light(camera: Nominal, dot_directions: np.ndarray) -> SceneLight:
    return SceneLight(
        left=_view(camera, dot_directions, 0.0),
        right=_view(camera, dot_directions, camera.baseline_m),
    )


@pytest.fixture(scope="session")
def projector_dots(light: SceneLight, camera: Nominal) -> Dots:
    return gather([light], camera.fx_px)


Take = Callable[..., ExposedPair]


@pytest.fixture(scope="session")
def take(light: SceneLight, camera: Nominal, projector_dots: Dots) -> Take:
    """Return `take(seed=1, scene="a", frame=0, **strengths)`, which exposes the small scene."""

    def expose_scene(
        seed: int = 1, scene: str = "a", frame: int = 0, **values: float
    ) -> ExposedPair:
        strengths = Strengths(nominal=camera, values=values)
        return expose(light, strengths, projector_dots, Draws(seed=seed, scene=scene, frame=frame))

    return expose_scene


@pytest.fixture
def light_set(tmp_path: Path, light: SceneLight) -> Path:
    """Write a folder with nominal.json, capture.toml and the light of two scenes."""
    folder = tmp_path / "light"
    for scene in ("a", "b"):
        (folder / scene).mkdir(parents=True)
        arrays = {
            f"{side}_{item.name}": getattr(light.view(side), item.name)
            for side in ("left", "right")
            for item in dataclasses.fields(LightView)
        }
        small = {
            key: value if key.endswith("body") else value.astype(np.float32)
            for key, value in arrays.items()
        }
        np.savez(folder / scene / "light.npz", **small)
        (folder / scene / "room").write_text("kitchen\n")
        (folder / scene / "notes.txt").write_text("not to be copied\n")
    (folder / "nominal.json").write_text(json.dumps(TABLE))
    (folder / "capture.toml").write_text(CAPTURE)
    return folder


def _view(camera: Nominal, directions: np.ndarray, at_x_m: float) -> LightView:
    across, down = camera.tangents()
    depth_m = WALL_M / (1.0 + LEAN * down)
    body = np.ones(camera.shape, np.uint32)
    box = (np.abs(across * BOX_M + at_x_m) < 0.08) & (np.abs(down * BOX_M) < 0.06)
    depth_m[box], body[box] = BOX_M, 2
    away = (down < -0.25) & (across > 0.35)
    px = across + (at_x_m - camera.projector_x_m) / depth_m
    even_e = 400.0 / depth_m**2 * np.where(body == 2, 0.6, 0.4)
    bright = np.full(camera.shape, 0.02)
    for x, y in directions:
        bright += np.exp(-((px - x) ** 2 + (down - y) ** 2) / (2 * _SPOT**2))
    second = np.roll(bright, 5, 1)
    return LightView(
        laser_e=np.where(away, 0.0, even_e * bright / bright.mean()),
        even_e=np.where(away, 0.0, even_e),
        ambient_e=np.where(away, 0.0, np.where(body == 2, 600.0, 400.0)),
        other_e=np.where(away, 0.0, even_e * second),
        depth_m=np.where(away, np.nan, depth_m),
        body=np.where(away, 0, body).astype(np.uint32),
        px=np.where(away, np.nan, px),
        py=np.where(away, np.nan, down),
        up=np.array([0.0, -1.0, 0.0]),
    )
