"""Presets of cameras: modes, bases, light, and cameras that are refused by name."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from starling.patterns.errors import InputError
from starling.sim import simulate
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene import materials, sources, visible
from starling.sim.scene.builtin import solids
from starling.sim.scene.scene import Body, Scene
from starling.sim.scene.spectra import Band, ambient_w_m2
from starling.sim.sensor import differences, other_kinds, presets, realsense, scaling, sensor_file
from starling.sim.sensor.projector import Projector
from starling.sim.sensor.sensor import Sensor

MODES = [(name, mode) for name in presets.names() for mode in presets.load_file(name).modes]
PASSIVE = [name for name in presets.names() if presets.load(name).projector.power_w == 0]
BASED = [name for name in presets.names() if presets.load_file(name).base]
# Distance of the wall [m] and width of the image [px], by kind.
SETTINGS: dict[str, tuple[float, int]] = {"stereo": (1.0, 160), "structured_light": (1.2, 320)}
# Fields that each derived camera says it changes.
DIFFERENCES = {
    "d435i": set(),
    "d456": set(),
    "d457": set(),
    "carmine-1.08": set(),
    "d435f": {"left.lens.filter_width_nm"},
    "d455f": {"left.lens.filter_width_nm"},
    "gemini-336": {"left.lens.filter_width_nm"},
    "carmine-1.09": {"post.near_m", "post.far_m"},
}


def small(name: str) -> Sensor:
    """Return a preset in larger pixels."""
    sensor = presets.load(name)
    width = SETTINGS[sensor.kind][1]
    height = round(sensor.height * width / sensor.width)
    return scaling.scaled(sensor, width / sensor.width, width, height)


def reading(name: str, scene: Scene) -> tuple[float, float]:
    """Return the share of pixels with depth, and the median relative error of depth."""
    shot = simulate.simulate(scene, small(name), quality="draft")
    depth_m, truth_m = shot.depth.depth_m, shot.layers.truth.depth_m
    known = np.isfinite(depth_m)
    error = np.median(np.abs(depth_m[known] / truth_m[known] - 1)) if known.any() else np.nan
    return float(known.mean()), float(error)


def test_there_are_presets_of_twenty_cameras() -> None:
    assert len(presets.names()) >= 25


@pytest.mark.parametrize(("name", "mode"), MODES)
def test_every_mode_has_its_size_and_search(name: str, mode: str) -> None:
    """The nearest distance is in reach of the search, whose two ends are refused."""
    file = presets.load_file(name)
    for rate in ("", *(f"@{fps:g}" for fps in file.modes[mode].fps)):
        sensor = presets.load(name, mode=mode + rate)
        assert f"{sensor.width}x{sensor.height}" == mode
        if sensor.kind == "stereo":
            nearest_m = sensor.focal_baseline_px_m / (sensor.matcher.search_px - 1)
            assert sensor.post.near_m >= 0.98 * nearest_m


@pytest.mark.parametrize("name", presets.names())
def test_every_preset_has_the_mode_of_its_own_numbers(name: str) -> None:
    file = presets.load_file(name)
    assert file.mode is not None
    assert presets.load(name, mode=file.mode.mode) == file.sensor


def test_the_page_of_cameras_has_the_presets_numbers() -> None:
    page = (Path(__file__).parents[3] / "docs" / "cameras.md").read_text("utf-8")
    rows = [
        (name, *(cell.strip() for cell in cells.split("|")))
        for listed, cells in re.findall(r"^\| ([a-z][^|]*) \| (.*) \|$", page, re.MULTILINE)
        if listed != "preset"
        for name in listed.split(", ")
    ]
    assert {row[0] for row in rows} == set(presets.names())
    for name, kind, baseline_mm, image, nearest_m, *_ in rows:
        sensor = presets.load(name)
        assert f"{sensor.width}x{sensor.height}" == image
        assert round(1e3 * sensor.baseline_m) == int(baseline_mm)
        assert sensor.post.near_m == pytest.approx(float(nearest_m), abs=0.0051)
        assert ("passive" in kind) == (name in PASSIVE)
        assert ("structured" in kind) == (sensor.kind == "structured_light")
        assert name in PASSIVE or f"{sensor.projector.wavelength_nm:g} nm" in kind


@pytest.mark.parametrize("name", BASED)
def test_a_base_is_described_by_what_differs(name: str) -> None:
    file = presets.load_file(name)
    base = presets.load_file(file.base)
    assert file.description.endswith(".")
    assert file.base in sensor_file.names()
    changed = set(differences.changed_paths(base, file.sensor)) - {"name"}
    if name in DIFFERENCES:
        assert changed == DIFFERENCES[name]
    else:
        assert changed


def test_filters_for_infrared_dim_daylight_alone() -> None:
    """A lamp of visible light gives the filtered imager fewer electrons for the same laser."""
    plain, filtered = (presets.load(name) for name in ("d435", "d435f"))
    lit = [
        ambient_w_m2("led", illuminance_lx=500.0, band=Band.from_imager(each.left, each.projector))
        for each in (plain, filtered)
    ]
    assert lit[1] < 0.1 * lit[0]
    assert filtered.left.quantum_efficiency == plain.left.quantum_efficiency


@pytest.mark.parametrize("name", PASSIVE)
def test_passive_pairs_see_visible_light(name: str) -> None:
    sensor = presets.load(name)
    lens, light = sensor.left.lens, sensor.projector
    assert lens.filter_centre_nm == light.wavelength_nm == 550.0
    assert (light.pattern, light.speckle_contrast) == ("uniform", 0.0)


def test_the_passive_cameras() -> None:
    assert set(PASSIVE) == {"d405", "oak-d", "oak-d-sr", "zed-2i", "zed-mini"}


def painted(material: str, *, textured: bool = True) -> Scene:
    """A plane at 1 m with blots of 20 mm."""
    blots = np.random.default_rng(1).uniform(0.2, 0.8, (150, 150)).astype(np.float32)
    flat = solids.body("plane", solids.plane(3, 3), materials.named(material), at_one_metre())
    uv = (flat.mesh.vertices[:, :2] / 3 + 0.5).astype(np.float32)
    mesh = dataclasses.replace(flat.mesh, uv=uv)
    texture = blots if textured else None
    return Scene(name="painted", bodies=(dataclasses.replace(flat, mesh=mesh, texture=texture),))


def at_one_metre() -> np.ndarray:
    pose = np.eye(4)
    pose[2, 3] = 1.0
    return pose


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(set(presets.names()) - set(PASSIVE)))
def test_every_active_preset_measures_a_wall(name: str) -> None:
    distance_m = SETTINGS[presets.load(name).kind][0]
    share, error = reading(name, sources.load(f"wall:{distance_m}", small(name)))
    assert share > 0.5
    assert error < 0.06


@pytest.mark.slow
@pytest.mark.parametrize("name", PASSIVE)
def test_every_passive_preset_measures_a_texture_only(name: str) -> None:
    share, error = reading(name, painted("wall paint"))
    assert share > 0.5
    assert error < 0.1
    bare, wrong = reading(name, sources.load("wall:1", small(name)))
    assert bare < 0.3
    assert bare == 0 or wrong > error


def test_a_visible_pair_sees_visible_reflectances() -> None:
    """Black dyed cloth is bright in the near infrared: 0.35 against 0.13."""
    scene = painted("black dyed cloth", textured=False)
    infrared, seen = (visible.in_band(scene, presets.load(name)) for name in ("d435", "oak-d"))
    assert infrared is scene
    assert seen.bodies[0].material.reflectance == pytest.approx(0.1307, abs=1e-4)
    ratio = [
        float(
            simulate.render_layers(MitsubaScene(scene), small(name), quality="draft")
            .left.ambient[40:60, 60:100]
            .mean()
        )
        for name in ("d435", "oak-d")
    ]
    assert ratio[1] / ratio[0] == pytest.approx(0.1307 / 0.35, rel=0.01)


def test_textures_follow_the_reflectance_and_grey_stays() -> None:
    scene = painted("leaf")
    seen = visible.in_band(scene, presets.load("d405")).bodies[0]
    assert seen.texture is not None
    texture = scene.bodies[0].texture
    assert texture is not None
    share = seen.material.reflectance / scene.bodies[0].material.reflectance
    np.testing.assert_allclose(seen.texture, texture * np.float32(share), rtol=1e-6)
    grey = dataclasses.replace(materials.named("leaf"), rgb=None)
    body: Body = dataclasses.replace(scene.bodies[0], material=grey)
    result = visible.in_band(dataclasses.replace(scene, bodies=(body,)), presets.load("d405"))
    assert result.bodies[0] is body


def test_a_filter_hides_infrared_projectors_from_visible_pairs() -> None:
    scene = dataclasses.replace(painted("leaf"), other_projector=Projector(power_w=0.2))
    camera = presets.load("oak-d")
    assert visible.in_band(scene, camera).other_projector.power_w == 0
    lens = dataclasses.replace(camera.left.lens, filter_width_nm=0.0)
    bare = dataclasses.replace(camera, left=dataclasses.replace(camera.left, lens=lens))
    assert visible.in_band(scene, bare).other_projector.power_w == 0.2


@pytest.mark.parametrize("name", [*other_kinds.names(), "Azure Kinect", "FEMTO_BOLT"])
def test_other_principles_are_refused_by_name(name: str) -> None:
    rule = f"sensor must be a stereo or structured-light camera; got {re.escape(name)}, which "
    with pytest.raises(InputError, match=rule) as caught:
        presets.load(name)
    nearest = re.search(r"Nearest preset: (\S+)\.$", str(caught.value))
    assert nearest is not None
    assert nearest[1] in presets.names()


def test_a_camera_without_projector_refuses_the_emitter() -> None:
    camera = presets.load("d405")
    assert realsense.with_emitter(camera, "off") == camera
    with pytest.raises(InputError, match=r"^emitter must be off where .*; got on for d405. Leave"):
        realsense.with_emitter(camera, "on")
    changed, report = realsense.apply(
        camera, {"controls-laserpower": 300, "controls-laserstate": "on"}
    )
    assert changed == camera
    assert {item.control: item.reason for item in report.unmapped} == {
        "controls-laserpower": "the camera has no projector",
        "controls-laserstate": "the camera has no projector",
    }


@pytest.mark.parametrize("name", [name for name in presets.names() if name.startswith("d")])
def test_the_default_device_preset_changes_no_camera_of_the_family(name: str) -> None:
    assert realsense.with_preset(presets.load(name), "default")[0] == presets.load(name)
