"""Skylight reflected by surfaces: `starling.sim.render.skylight` and Mitsuba's BSDFs agree.

**Rationale.** Tables of skylight and the BSDFs for projector light must describe one material.

**Expected behaviour.** Sampling of Mitsuba's BSDFs gives the tabulated reflection of an even sky,
and of a sky with a gradient. Rendered plates agree with the table.

**What it does not prove.** Occlusion of the sky by bodies: see `test_sky_occlusion_laws.py`.
"""

from __future__ import annotations

import numpy as np
import pytest

from starling.sim.geometry import frames
from starling.sim.render import backend, bsdf, direct, mitsuba_scene, skylight
from starling.sim.scene.builtin import solids
from starling.sim.scene.scene import Ambient, Body, Finish, Material, Scene
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values

SAMPLES = 1 << 18
COSINES = (1.0, 0.75, 0.5, 0.25)
VIEWER = np.array([0.0, 0.0, -1.0])  # Direction of the middle pixel's ray.


def plate(material: Material, turn_deg: float = 0.0):
    pose = frames.pose((0, 0, 1.0), (turn_deg, 0, 0))
    return solids.body("plate", solids.plane(20, 20), material, pose)


def facing(turn_deg: float) -> np.ndarray:
    """The plate's normal."""
    return frames.pose((0, 0, 0), (turn_deg, 0, 0))[:3, :3] @ (0, 0, -1)


def surface(kind, reflectance: float, roughness: float) -> Material:
    return Material(name="m", kind=kind, reflectance=reflectance, roughness=roughness)


def sampled(material: Material, cosine: float) -> np.ndarray:
    """A, V along the normal, and V along the mirror direction, by sampling Mitsuba's BSDF."""
    mi, dr = backend.mitsuba(), backend.drjit()
    plain = mi.load_dict(bsdf.from_body(plate(material), Finish()))
    rays = mi.PCG32(size=SAMPLES)
    si = dr.zeros(mi.SurfaceInteraction3f, SAMPLES)
    si.wi = mi.Vector3f(float(np.sqrt(1 - cosine**2)), 0, cosine)
    place = mi.Point2f(rays.next_float32(), rays.next_float32())
    sample, weight = plain.sample(mi.BSDFContext(), si, rays.next_float32(), place)
    share, way = np.array(weight[0], float), np.array(sample.wo, float).reshape(3, -1)
    return np.array([share.mean(), (share * way[2]).mean(), -(share * way[0]).mean()])


def table(body: Body, *, gloss: float = 0.0, metal: float = 0.0) -> np.ndarray:
    measured = skylight.body_table(body, Finish(gloss=gloss, metal=metal, roughness=0.3))
    assert measured is not None
    return measured


def tabled(material: Material, cosine: float) -> np.ndarray:
    coefficients = table(plate(material))
    return skylight.interpolate(coefficients, np.array(cosine), np.array(material.reflectance))


@pytest.mark.parametrize("cosine", COSINES)
@pytest.mark.parametrize(
    ("kind", "reflectance", "roughness"),
    [
        ("metal", 0.6, 0.25),
        ("metal", 0.87, 0.08),
        ("glossy", 0.06, 0.1),
        ("glossy", 0.5, 0.15),
        ("glossy", 0.6, 0.08),
    ],
)
def test_facet_sums_agree_with_mitsubas_sampling(kind, reflectance, roughness, cosine):
    """To 3 % of the light; the largest error is a coat's base at grazing angles."""
    material = surface(kind, reflectance, roughness)
    measured = tabled(material, cosine)
    np.testing.assert_allclose(measured, sampled(material, cosine), atol=0.03 * measured[0] + 1e-3)


def seen(material: Material, turn_deg: float, ambient: Ambient) -> float:
    small = [("width", 80), ("height", 60), ("fx_px", 80.0), ("fy_px", 80.0)]
    sensor = with_values(presets.load("d435"), [*small, ("cx_px", 40.0), ("cy_px", 30.0)])
    scene = Scene(name="plate", bodies=(plate(material, turn_deg),), ambient=ambient)
    return float(direct.layers(mitsuba_scene.MitsubaScene(scene), sensor).left.ambient[30, 40])


@pytest.mark.parametrize("turn_deg", [0.0, 30.0, 60.0])
def test_metal_mirrors_the_sky(turn_deg):
    """A nearly smooth metal reflects R (1 + g m . up) / pi from the mirror direction m."""
    metal, normal = surface("metal", 1.0, 0.01), facing(turn_deg)
    mirrored = 2 * (normal @ VIEWER) * normal - VIEWER
    for up in ((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)):
        measured = seen(metal, turn_deg, Ambient(gradient=0.8, up=up))
        expected = (1 + 0.8 * mirrored @ up) / np.pi
        assert measured == pytest.approx(expected, rel=0.02, abs=0.002)


@pytest.mark.parametrize(("kind", "turn_deg"), [("metal", 40.0), ("glossy", 70.0)])
def test_rendered_plates_agree_with_the_table(kind, turn_deg):
    material = surface(kind, 0.4, 0.2)
    even, along, across = tabled(material, float(np.cos(np.deg2rad(turn_deg))))
    assert seen(material, turn_deg, Ambient(gradient=0.0)) * np.pi == pytest.approx(even, rel=0.01)
    normal = facing(turn_deg)
    ahead = (normal @ VIEWER) * normal - VIEWER
    ahead /= np.linalg.norm(ahead)
    for up in (normal, ahead):
        tilted = seen(
            material, turn_deg, Ambient(gradient=0.5, up=(float(up[0]), float(up[1]), float(up[2])))
        )
        expected = even + 0.5 * (along * (up @ normal) + across * (up @ ahead))
        assert tilted * np.pi == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("kind", ["diffuse", "mirror", "glass"])
def test_matt_bodies_mirrors_and_glass_have_no_table(kind):
    assert (
        skylight.body_table(plate(surface(kind, 0.5, 0.1)), Finish(of="other", gloss=1.0)) is None
    )


def test_shares_of_a_finish_mix_tables():
    bare = surface("diffuse", 0.5, 0.1)
    coat, metal = (table(plate(surface(kind, 0.5, 0.3))) for kind in ("glossy", "metal"))
    mixed = table(plate(bare), gloss=0.4, metal=0.25)
    matt = np.zeros_like(coat)
    matt[:, 1], matt[:, 3] = 1, skylight.MATT_TILT
    np.testing.assert_allclose(mixed, 0.75 * (0.6 * matt + 0.4 * coat) + 0.25 * metal)
