"""Derivatives of the projector's light by the rig's geometry, compared with differences."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from starling.calibration import parameters
from starling.patterns.errors import InputError
from starling.sim.differentiable import image as differentiable_image
from starling.sim.differentiable import light as differentiable
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.imaging.lens_input import LensInput
from starling.sim.imaging.optics import image as optics
from starling.sim.render import backend, direct
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.builtin import scenes
from starling.sim.scene.scene import ModelError, Motion, Scene
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.projector import Emitter
from starling.sim.sensor.sensor import Sensor

# Steps that move dots by about 1e-3 image pixels, or 1e-2 pattern pixels. The pattern's linear
# interpolation has a kink at each pixel, which larger steps would cross. Smaller steps would suffer
# from single precision.
STEPS = {
    "fx_px": 6e-3,
    "cx_px": 4e-3,
    "cy_px": 4e-3,
    "baseline_m": 2e-5,
    "projector.position_m.x": 2e-5,
    "projector.position_m.y": 2e-5,
    "projector.position_m.z": 2e-4,
    "projector.rotation_deg.x": 2e-3,
    "projector.rotation_deg.y": 2e-3,
    "projector.rotation_deg.z": 4e-3,
    "projector.field": 4e-5,
    "projector.pattern_scale": 4e-5,
}


def small(**changes: object) -> Sensor:
    """A sensor of 160x96 with a turned projector."""
    sensor = presets.load("d435")
    values = {
        "width": 160,
        "height": 96,
        "fx_px": 120.0,
        "fy_px": 118.0,
        "cx_px": 81.3,
        "cy_px": 46.1,
        "projector.rotation_deg": [1.0, -2.0, 3.0],
        "projector.position_m": [0.03, 0.002, -0.004],
        "left.alignment.roll_deg": 0.0,
        **changes,
    }
    return with_values(sensor, values.items())


@pytest.fixture(scope="module")
def stage() -> MitsubaScene:
    """A table with objects."""
    return MitsubaScene(scenes.tabletop(0))


def with_step(sensor: Sensor, name: str, step: float) -> Sensor:
    """Change one parameter; the field changes relatively, as its derivative is defined."""
    name, step = (
        (parameters.FIELD, step * parameters.value(sensor, parameters.FIELD))
        if name == "projector.field"
        else (name, step)
    )
    return parameters.with_values(sensor, [(name, parameters.value(sensor, name) + step)])


def agree(difference: np.ndarray, column: np.ndarray, where: np.ndarray) -> None:
    """Compare a difference with a derivative, relative to the derivative's root mean square.

    Half of the pixels agree to 0.3 % (single precision). 99 % agree to 15 %, limited by kinks. The
    weighted sum over pixels, as in a fit, agrees to 0.5 %. The other pixels, at outlines of facets,
    are not tested.
    """
    size = np.sqrt(np.mean(column[where] ** 2))
    wrong = np.abs(difference - column)[where] / size
    assert np.median(wrong) < 3e-3
    assert np.quantile(wrong, 0.99) < 0.15
    inner = where.copy()
    inner[where] = wrong <= np.quantile(wrong, 0.999)
    assert (difference * column)[inner].sum() / (column**2)[inner].sum() == pytest.approx(
        1, abs=5e-3
    )


def inside(*views: differentiable.TracedView) -> np.ndarray:
    """Pixels that are clear in all views, eroded by one pixel."""
    clear = np.logical_and.reduce([view.clear for view in views]).astype(np.uint8)
    clear[[0, -1]] = 0
    clear[:, [0, -1]] = 0
    return cv2.erode(clear, np.ones((3, 3), np.uint8)).astype(bool)


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_image_equals_the_rendered_layer(
    stage: MitsubaScene, side: differentiable.Side
) -> None:
    """The layer equals the renderer's, which is not tested here."""
    sensor = small()
    traced = differentiable.trace(stage, sensor, side)
    image, rendered = traced.linear().image, direct.layers(stage, sensor)
    view = rendered.left if side == "left" else rendered.right
    assert view is not None
    shown = traced.clear
    assert shown.mean() > 0.5
    error = np.abs(image - view.projector_direct)[shown]
    assert np.quantile(error, 0.999) < 1e-4 * view.projector_direct.max()  # Single precision.


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("name", [name for name in STEPS if name != "projector.field"])
def test_forward_mode_agrees_with_central_differences(
    stage: MitsubaScene, side: differentiable.Side, name: str
) -> None:
    """Derivatives agree with differences of traced images, except at depth and shadow edges.

    The test does not show that the image itself is correct, and excludes edges, where the image is
    discontinuous.
    """
    sensor = small()
    traced = differentiable.trace(stage, sensor, side)
    column = traced.linear((name,)).columns[name]
    if name == "baseline_m" and side == "left":
        assert not column.any()
        return
    step = STEPS[name]
    ends = [
        differentiable.trace(stage, with_step(sensor, name, way), side) for way in (step, -step)
    ]
    difference = (ends[0].linear().image - ends[1].linear().image) / (2 * step)
    agree(difference, column, inside(traced, *ends))


def test_the_field_of_an_image_stretches(stage: MitsubaScene, tmp_path) -> None:
    """As above, for the field. Generated patterns change with the field, so an image is used."""
    path = tmp_path / "dots.png"
    rng = np.random.default_rng(0)
    drawn = cv2.GaussianBlur(rng.random((288, 384), np.float32), (0, 0), 2.0)
    drawn = (drawn - drawn.min()) / np.ptp(drawn)
    assert cv2.imwrite(str(path), (65535 * drawn).astype(np.uint16))
    sensor = small(**{"projector.pattern": str(path)})
    traced = differentiable.trace(stage, sensor, "right")
    column = traced.linear(("projector.field",)).columns["projector.field"]
    step = STEPS["projector.field"]
    ends = [
        differentiable.trace(stage, with_step(sensor, "projector.field", way), "right")
        for way in (step, -step)
    ]
    difference = (ends[0].linear().image - ends[1].linear().image) / (2 * step)
    agree(difference, column, inside(traced, *ends))


def backward_gradient(traced: differentiable.TracedView, weights: np.ndarray) -> dict[str, float]:
    """Derivative of the image's weighted sum by each parameter, in backward mode."""
    mi, dr = backend.mitsuba(), backend.drjit()
    weight = mi.Float(np.ascontiguousarray(weights, np.float32).ravel())
    total = dict.fromkeys(differentiable.PARAMETERS, 0.0)
    for hits in traced._hits:
        steps = differentiable._steps(differentiable.PARAMETERS)
        dr.backward(dr.sum(traced._radiance(hits, steps, None) * weight))
        for name in total:
            total[name] += float(np.array(dr.grad(steps.attached[name])).sum())
    return {name: value / len(traced._hits) for name, value in total.items()}


@pytest.mark.parametrize("side", ["left", "right"])
def test_backward_mode_agrees_with_forward_mode(
    stage: MitsubaScene, side: differentiable.Side
) -> None:
    """Both modes agree on random weights. Common errors of both remain undetected."""
    sensor = small()
    traced = differentiable.trace(stage, sensor, side)
    weights = np.random.default_rng(0).random((96, 160), np.float32) * traced.clear
    columns = traced.linear(differentiable.PARAMETERS).columns
    pulled = backward_gradient(traced, weights)
    for name, column in columns.items():
        forward = float((column.astype(np.float64) * weights).sum())
        size = float(np.abs(column * weights).sum())
        assert abs(pulled[name] - forward) <= 1e-4 * size, name  # Sums in single precision.


def test_derivatives_of_emitters_add_up(stage: MitsubaScene) -> None:
    """Images and derivatives of single emitters sum to those of all emitters."""
    emitters = (
        Emitter(offset_m=(-2e-3, 0, 0)),
        Emitter(offset_m=(3e-3, 0, 0), rotation_deg=(0, 0, 12), power_share=0.5),
    )
    sensor = small()
    light = dataclasses.replace(sensor.projector, emitters=emitters)
    sensor = dataclasses.replace(sensor, projector=light)
    traced = differentiable.trace(stage, sensor, "left")
    names = ("projector.rotation_deg.z", "projector.position_m.x")
    whole, parts = (
        traced.linear(names),
        [traced.linear(names, emitter=number) for number in range(traced.emitters)],
    )
    assert len(parts) == 2
    np.testing.assert_allclose(sum(part.image for part in parts), whole.image, rtol=1e-4, atol=1e-6)
    for name in names:
        ends = [
            differentiable.trace(stage, with_step(sensor, name, way), "left")
            for way in (STEPS[name], -STEPS[name])
        ]
        difference = (ends[0].linear().image - ends[1].linear().image) / (2 * STEPS[name])
        agree(difference, whole.columns[name], inside(traced, *ends))


@pytest.mark.parametrize("name", differentiable_image.ALIGNMENT)
def test_alignment_moves_the_image_as_the_simulator_does(stage: MitsubaScene, name: str) -> None:
    """Derivatives by alignment agree with differences of the simulator's images.

    The signs of the alignment have their own test.
    """
    turned = {"right.alignment.yaw_deg": 0.4, "right.alignment.roll_deg": -0.3}
    sensor = small(**turned, **{"projector.speckle_contrast": 0.0})
    rendered = direct.layers(stage, sensor).right
    assert rendered is not None
    light = LensInput(
        laser=rendered.projector_direct, rest=np.zeros_like(rendered.projector_direct)
    )
    step = 5e-4
    ends = [
        optics.image(light, rendered.depth_m, with_step(sensor, name, way), "right", seed=0)
        for way in (step, -step)
    ]
    traced = differentiable.trace(stage, sensor, "right")
    column = differentiable_image.form(traced, (name,)).columns[name]
    where = cv2.erode(inside(traced).astype(np.uint8), np.ones((9, 9), np.uint8)).astype(bool)
    agree((ends[0] - ends[1]) / (2 * step), column, where)
    left = differentiable.trace(stage, sensor, "left")
    assert not differentiable_image.form(left, (name,)).columns[name].any()


def test_the_flow_is_how_dots_move(stage: MitsubaScene) -> None:
    """Brightness moves along the flow, up to changes of shading."""
    sensor = small()
    traced = differentiable.trace(stage, sensor, "right")
    columns = traced.linear(differentiable.PARAMETERS).columns
    flows = traced.flow(differentiable.PARAMETERS)
    for name in STEPS:
        carried = -sum(
            columns[ray] * flows[name][..., axis] for axis, ray in enumerate(differentiable.RAY)
        )
        where = inside(traced)
        off = np.sqrt(np.mean((carried - columns[name])[where] ** 2))
        assert off < 0.05 * np.sqrt(np.mean(columns[name][where] ** 2)), name


@pytest.mark.parametrize("side", ["left", "right"])
def test_scale_is_unobservable_with_reference_depth(tmp_path, side: differentiable.Side) -> None:
    """The common scale of focal length, baseline, projector offset and field is unobservable.

    Exact for a projector that looks straight ahead from a position next to the left imager.
    """
    path = tmp_path / "dots.png"
    drawn = cv2.GaussianBlur(np.random.default_rng(1).random((288, 384), np.float32), (0, 0), 2.0)
    assert cv2.imwrite(str(path), (6e4 * drawn).astype(np.uint16))
    straight: dict[str, object] = {
        "projector.pattern": str(path),
        "projector.rotation_deg": [0.0, 0.0, 0.0],
        "projector.position_m": [0.03, 0.002, 0.0],
    }
    sensor, stage = small(**straight), MitsubaScene(scenes.tabletop(0))
    pinhole, scale = Pinhole.from_camera(sensor), 1.01
    wide = parameters.with_values(
        sensor,
        [
            ("fx_px", sensor.fx_px / scale),
            ("baseline_m", sensor.baseline_m * scale),
            ("projector.position_m.x", 0.03 * scale),
            ("projector.position_m.y", 0.002 * scale),
            (parameters.FIELD, parameters.value(sensor, parameters.FIELD) * scale),
        ],
    )
    images = [
        differentiable_image.form(
            differentiable.trace(stage, device, side, reference=pinhole)
        ).image
        for device in (sensor, wide)
    ]
    where = differentiable.trace(stage, sensor, side, reference=pinhole).clear
    ratio = images[1][where] / images[0][where]
    # Even light changes slightly with the angles; the dots must not.
    assert np.abs(ratio / cv2.blur(ratio[:, None], (1, 1)).ravel() - 1).max() < 1e-6
    assert np.std(ratio) < 4e-3
    shifted = differentiable.trace(
        stage, parameters.with_values(wide, [("fx_px", sensor.fx_px)]), side, reference=pinhole
    )
    moved = differentiable_image.form(shifted).image[where] / images[0][where]
    assert np.std(moved) > 5 * np.std(ratio)


def test_columns_by_reference_agree_with_differences() -> None:
    """Derivatives by focal length and principal point of a surface that depends on them."""
    sensor, stage = small(), MitsubaScene(scenes.tabletop(0))
    pinhole = Pinhole.from_camera(small(fx_px=121.0, fy_px=119.0, cx_px=80.9))
    for name in ("fx_px", "cx_px", "cy_px", "baseline_m"):
        traced = differentiable.trace(stage, sensor, "right", reference=pinhole)
        column = traced.linear((name,)).columns[name]
        ends = [
            differentiable.trace(stage, with_step(sensor, name, way), "right", reference=pinhole)
            for way in (STEPS[name], -STEPS[name])
        ]
        difference = (ends[0].linear().image - ends[1].linear().image) / (2 * STEPS[name])
        agree(difference, column, inside(traced, *ends))


def test_undifferentiable_scenes_are_refused(stage: MitsubaScene) -> None:
    sensor = small()
    traced = differentiable.trace(stage, sensor, "left")
    for ask in (traced.linear, traced.flow):
        with pytest.raises(InputError, match="parameter must be a known name; got 'gain'"):
            ask(("gain",))
    for ask in (differentiable_image.form, differentiable_image.flow):
        with pytest.raises(InputError, match="parameter must be a known name"):
            ask(traced, ("gain",))
    with pytest.raises(InputError, match="geometry must be stated whole"):
        differentiable.trace(stage, small(baseline_error=0.01), "left")
    for change in (
        {"model_error": ModelError(scale=1.01)},
        {"motion": Motion(velocity_m_s=(0.1, 0.0, 0.0))},
    ):
        wrong = MitsubaScene(dataclasses.replace(stage.scene, **change))
        assert isinstance(wrong.scene, Scene)
        with pytest.raises(InputError, match="to be differentiated"):
            differentiable.trace(wrong, sensor, "left")


def test_a_variant_without_derivatives_is_refused(
    stage: MitsubaScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(backend, "is_jit", lambda: False)
    with pytest.raises(backend.BackendError, match="gradients must be computed in a compiled"):
        differentiable.trace(stage, small(), "left")
