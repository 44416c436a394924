"""Mirrors, glass and finishes, compared with laws of optics."""

import dataclasses

import cv2
import numpy as np
import pytest
import scipy.ndimage
import scipy.optimize

from starling.sim.geometry import frames
from starling.sim.render import backend, bsdf, direct, mitsuba_scene, scalar
from starling.sim.render.backend import BackendError
from starling.sim.scene.builtin import solids
from starling.sim.scene.scene import Ambient, Body, Finish, Material, Mesh, Scene, Sun
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Projector

EVEN = Ambient(gradient=0.0)
WHITE = Material(name="white", reflectance=0.6)
INDEX = 1.5
FACE = ((INDEX - 1) / (INDEX + 1)) ** 2  # Reflectance of one face of glass at normal incidence.


@pytest.fixture
def even(tmp_path):
    """A small camera whose projector, at the left imager, lights the whole field evenly."""
    path = tmp_path / "even.png"
    cv2.imwrite(str(path), np.full((64, 96), 200, np.uint8))
    part = Projector(pattern=str(path), fov_x_deg=100.0, fov_y_deg=80.0)
    return small(projector=part)


def small(**changes):
    base = dataclasses.replace(
        presets.load("d435"),
        width=160,
        height=120,
        fx_px=200.0,
        fy_px=200.0,
        cx_px=79.5,
        cy_px=59.5,
    )
    return dataclasses.replace(base, **changes)


def plate(name, distance_m, material=WHITE, *, size_m=8.0, turn_deg=(0.0, 0.0, 0.0), x_m=0.0):
    sheet = solids.plane(size_m, size_m)
    return solids.body(name, sheet, material, frames.pose((x_m, 0, distance_m), turn_deg))


def pane(thickness_m=0.005, *, turn_deg=0.0, distance_m=0.5):
    glass = Material(name="glass", kind="glass", ior=INDEX)
    slab = solids.box((4, 4, thickness_m))
    return solids.body("pane", slab, glass, frames.pose((0, 0, distance_m), (0, turn_deg, 0)))


def rendered(*bodies, sensor=None, subpixels=2, **changes):
    scene = Scene(name="test", bodies=bodies, **{"ambient": EVEN, **changes})
    return direct.layers(mitsuba_scene.MitsubaScene(scene), sensor or small(), subpixels=subpixels)


def middle(image):
    return float(image[55:65, 75:85].mean())


def same(a, b):
    """Whether two renderings have equal bits."""
    views = [(getattr(a, side), getattr(b, side)) for side in ("left", "right")]
    names = ("projector_direct", "ambient", "other", "depth_m", "body")
    return all(
        np.array_equal(getattr(x, name), getattr(y, name), equal_nan=name == "depth_m")
        for x, y in views
        for name in names
    )


# Finish ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["diffuse", "glossy", "metal"])
def test_shares_of_nothing_are_identity(kind):
    """A finish of other bodies, or with shares of 0, changes no bit."""
    surface = Material(name="x", kind=kind, reflectance=0.4)
    plain = rendered(plate("wall", 1.0, surface))
    elsewhere = Finish(of="cup", gloss=0.5, metal=0.5, transparency=0.5, reflectance_scale=0.5)
    assert same(rendered(plate("wall", 1.0, surface), finish=elsewhere), plain)
    assert same(rendered(plate("wall", 1.0, surface), finish=Finish(roughness=0.7)), plain)


@pytest.mark.parametrize(("share", "kind"), [("gloss", "glossy"), ("metal", "metal")])
def test_a_share_of_one_is_that_material(share, kind):
    finish = Finish(**{share: 1.0, "roughness": 0.2})
    other = Material(name="x", kind=kind, reflectance=WHITE.reflectance, roughness=0.2)
    assert same(rendered(plate("wall", 1.0), finish=finish), rendered(plate("wall", 1.0, other)))


@pytest.mark.parametrize("share", ["gloss", "metal"])
def test_shares_mix_linearly(even, share):
    """Radiance is the mixture (1 - s) of one material and s of the other, for all lights.

    The mixture is a model. A real partial coat also dims the material below it.
    """
    none, half, full = (
        rendered(plate("wall", 1.0), sensor=even, finish=Finish(**{share: s, "roughness": 0.3}))
        for s in (0.0, 0.4, 1.0)
    )
    for layer in ("projector_direct", "ambient"):
        ends = [middle(getattr(layers.left, layer)) for layers in (none, full)]
        expected = 0.6 * ends[0] + 0.4 * ends[1]
        assert middle(getattr(half.left, layer)) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("reflectance", [0.06, 0.4, 0.6])
@pytest.mark.parametrize("roughness", [0.1, 0.15, 0.3])
def test_a_coated_surface_returns_its_reflectance(reflectance, roughness):
    """Reflectance for light along the normal, and for uniform light from all directions."""
    mi, dr = backend.mitsuba(), backend.drjit()
    material = Material(name="m", kind="glossy", reflectance=reflectance, roughness=roughness)
    plain = mi.load_dict(bsdf.from_body(plate("wall", 1.0, material), Finish()))
    rays, count = mi.PCG32(size=1 << 18), 1 << 18
    si = dr.zeros(mi.SurfaceInteraction3f, count)
    si.wi = mi.Vector3f(0, 0, 1)
    sample = mi.Point2f(rays.next_float32(), rays.next_float32())
    _, weight = plain.sample(mi.BSDFContext(), si, rays.next_float32(), sample)
    assert float(np.mean(np.array(weight[0]))) == pytest.approx(reflectance, rel=0.02)
    sky = rendered(plate("wall", 1.0, material)).left.ambient
    assert middle(sky) * np.pi == pytest.approx(reflectance, rel=1e-3)


def test_unreachable_coat_reflectances_are_clipped():
    assert bsdf.base_albedo(0.01, 0.1) == 0 and bsdf.base_albedo(1.0, 0.3) == 1
    texture = np.array([[0.1, 0.5]], np.float32)
    each = [bsdf.base_albedo(float(value), 0.15) for value in texture[0]]
    assert bsdf.base_albedo(texture, 0.15) == pytest.approx(np.array([each]))


@pytest.mark.parametrize("scale", [0.0, 0.5, 1.5, 3.0])
def test_reflectance_scale_is_linear_up_to_one(even, scale):
    paint = np.full((4, 4), WHITE.reflectance, np.float32)
    body = plate("wall", 1.0)
    mesh = dataclasses.replace(body.mesh, uv=np.zeros((4, 2), np.float32))
    flat = dataclasses.replace(body, mesh=mesh, texture=paint)
    for wall in (plate("wall", 1.0), flat):
        seen = rendered(wall, sensor=even, finish=Finish(reflectance_scale=scale)).left
        expected = min(WHITE.reflectance * scale, 1)
        assert middle(seen.ambient) * np.pi == pytest.approx(expected, rel=1e-5)
        unit = middle(rendered(plate("wall", 1.0), sensor=even).left.projector_direct) / 0.6
        assert middle(seen.projector_direct) == pytest.approx(expected * unit, rel=1e-4)


@pytest.mark.parametrize("share", [0.3, 0.7, 1.0])
def test_a_transparent_pane(even, share):
    """Radiance = (1 - t) front + t background; the projector's light passes the pane twice: t^2.

    A real thin pane also reflects, and its transmission depends on the angle. Glass models both.
    """
    front, back = plate("pane", 0.5, Material(name="dark", reflectance=0.2)), plate("wall", 1.0)
    alone = {name: rendered(body, sensor=even).left for name, body in (("f", front), ("b", back))}
    seen = rendered(front, back, sensor=even, finish=Finish(of="pane", transparency=share)).left
    for layer, passes in (("ambient", 1), ("projector_direct", 2)):
        near, far = (middle(getattr(alone[name], layer)) for name in "fb")
        expected = (1 - share) * near + share**passes * far
        assert middle(getattr(seen, layer)) == pytest.approx(expected, rel=2e-3)
    assert middle(seen.depth_m) == pytest.approx(0.5)  # The truth belongs to the first surface.


# Glass and mirrors -------------------------------------------------------------------------------


@pytest.mark.parametrize("panes", [1, 2])
def test_glass_passes_what_fresnel_leaves(even, panes):
    """Each pane passes (1 - R)^2 along its normal, both ways, R = ((n - 1) / (n + 1))^2.

    Test and program ignore multiple reflections inside a pane. They would give a transmission of
    (1 - R) / (1 + R), 0.2 % more for n = 1.5.
    """
    sheets = [pane(distance_m=0.4 + 0.2 * i) for i in range(panes)]
    bare = rendered(plate("wall", 1.0), sensor=even).left.projector_direct
    seen = rendered(plate("wall", 1.0), *sheets, sensor=even).left.projector_direct
    assert middle(seen) / middle(bare) == pytest.approx((1 - FACE) ** (4 * panes), rel=0.01)


@pytest.mark.parametrize(("panes", "beyond"), [(4, True), (5, False)])
def test_surfaces_behind_eight_faces_are_seen_and_lit(even, panes, beyond):
    """Light passes 8 faces, as of two bottles, but no more."""
    sheets = [pane(distance_m=0.4 + 0.1 * i) for i in range(panes)]
    bare = rendered(plate("wall", 1.0), sensor=even).left.projector_direct
    seen = rendered(plate("wall", 1.0), *sheets, sensor=even).left.projector_direct
    share = (1 - FACE) ** (4 * panes) if beyond else 0
    assert middle(seen) / middle(bare) == pytest.approx(share, rel=0.01)


def test_glass_reflects_the_sky():
    """The first face also reflects a share R of the sky, whose radiance is 1 / pi."""
    seen = rendered(plate("wall", 1.0), pane()).left.ambient
    expected = (1 - FACE) ** 2 * WHITE.reflectance + FACE
    assert middle(seen) * np.pi == pytest.approx(expected, rel=0.002)


def test_the_sun_shines_through_glass():
    sun = Sun(irradiance_w_m2=10.0, towards=(0.0, 0.0, -1.0))
    bare = rendered(plate("wall", 1.0), sun=sun).left.other
    seen = rendered(plate("wall", 1.0), pane(), sun=sun).left.other
    assert middle(seen) / middle(bare) == pytest.approx((1 - FACE) ** 4, rel=0.002)


@pytest.mark.parametrize("turn_deg", [25.0, -40.0])
def test_a_tilted_slab_shifts_the_image(turn_deg):
    """A slab shifts the view by t sin(a) (1 - cos(a) / sqrt(n^2 - sin^2 a)) (Snell's law).

    The test covers refraction of the view at two faces. Projector light is not refracted.
    """
    sensor = small(fx_px=400.0, fy_px=400.0, height=40, cy_px=19.5)
    thickness, distance = 0.05, 1.0
    ball = solids.sphere(0.01)
    ball.apply_translation((0, 0, distance))
    spot = solids.body("spot", ball, WHITE)
    slab = pane(thickness, turn_deg=turn_deg, distance_m=0.4)
    positions = []
    for bodies in ((spot,), (spot, slab)):
        with_spot = rendered(*bodies, sensor=sensor, subpixels=6).left.ambient
        far = plate("far", 50.0, Material(name="black", reflectance=0.0), size_m=1.0)
        image = with_spot - rendered(far, *bodies[1:], sensor=sensor, subpixels=6).left.ambient
        positions.append((image * np.arange(sensor.width)).sum() / image.sum())
    ray = 0.0  # Viewing angle of the middle, which adds to the slab's tilt.
    for _ in range(30):
        ray = np.arcsin(slab_shift(thickness, np.deg2rad(turn_deg) + ray) / distance)
    expected = -sensor.fx_px * np.tan(ray)
    assert positions[1] - positions[0] == pytest.approx(expected, rel=0.01)


def slab_shift(thickness_m, angle):
    sine, cosine = np.sin(angle), np.cos(angle)
    return thickness_m * sine * (1 - cosine / np.sqrt(INDEX**2 - sine**2))


def painted(distance_m, *, size_m=6.0):
    """A sheet that faces +z, with a texture of a few centimetres."""
    rng = np.random.default_rng(0)
    noise = scipy.ndimage.gaussian_filter(rng.standard_normal((400, 400)), 1.5)
    paint = np.clip(0.5 + 0.2 * noise / noise.std(), 0, 1).astype(np.float32)
    half = size_m / 2
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32) * half
    mesh = Mesh(
        vertices=corners + np.float32([0, 0, distance_m]),
        faces=np.array([[0, 1, 2], [0, 2, 3]], np.uint32),
        uv=np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32),
    )
    return Body(name="painted", mesh=mesh, material=WHITE, texture=paint)


def disparity_px(left, right, near):
    """Least-squares shift between two images, searched near `near` [px]."""
    window = np.s_[20:-20, 50:-20]

    def misfit(shift):
        moved = scipy.ndimage.shift(right, (0, shift), order=3, mode="nearest")
        return float(((moved - left)[window] ** 2).mean())

    bounds = (near - 3, near + 3)
    return np.squeeze(scipy.optimize.fminbound(misfit, *bounds, xtol=1e-4))


def test_stereo_measures_the_virtual_image():
    """A mirror image is at the distance of the mirror plus the object's distance to it.

    The disparity is measured by shifting one image onto the other, without a matcher.
    """
    sensor = small(width=320, height=160, cx_px=159.5, cy_px=79.5, fx_px=400.0, fy_px=400.0)
    mirror = Material(name="mirror", kind="mirror", reflectance=0.9)
    layers = rendered(plate("mirror", 0.6, mirror), painted(-0.4), sensor=sensor, subpixels=4)
    distance = 0.6 + (0.6 + 0.4)
    measured = disparity_px(
        layers.left.ambient, layers.right.ambient, sensor.focal_baseline_px_m / distance
    )
    assert sensor.focal_baseline_px_m / measured == pytest.approx(distance, rel=0.01)
    assert np.nanmedian(layers.truth.depth_m) == pytest.approx(0.6)


@pytest.mark.parametrize("reflectance", [0.5, 1.0])
def test_a_mirror_dims_by_its_reflectance(reflectance):
    mirror = Material(name="mirror", kind="mirror", reflectance=reflectance)
    seen = rendered(plate("mirror", 0.6, mirror), plate("wall", -0.5)).left.ambient
    assert middle(seen) * np.pi == pytest.approx(reflectance * WHITE.reflectance, rel=1e-5)
    towards_sky = rendered(plate("mirror", 0.6, mirror)).left.ambient
    assert middle(towards_sky) * np.pi == pytest.approx(reflectance, rel=1e-5)


def test_mirrors_throw_shadows_and_glass_does_not(even):
    """The truth's `lit` agrees with the light; depth does not distinguish the surfaces."""
    wall = plate("wall", 1.0)
    sensor = dataclasses.replace(
        even, projector=dataclasses.replace(even.projector, position_m=(0.3, 0.0, 0.0))
    )
    mirror, glass = Material(name="m", kind="mirror"), Material(name="g", kind="glass")
    for material, passes in ((mirror, False), (glass, True)):
        blind = solids.body(
            "blind",
            solids.box((0.1, 0.4, 0.01)),
            material,
            frames.pose((0.15, 0, 0.5)),
        )
        layers = rendered(wall, blind, sensor=sensor)
        assert bool(layers.truth.lit[60, 80]) is passes
        assert (layers.left.projector_direct[60, 80] > 0) == passes


def test_shapes_with_their_own_bsdf_are_followed():
    """Mirrors and glass from a Mitsuba file are recognised by their BSDF flags."""
    mi = backend.mitsuba()
    place = mi.ScalarTransform4f().translate([0, 0, 0.6]).rotate([0, 1, 0], 180).scale(4)
    conductor = {"type": "twosided", "bsdf": {"type": "conductor", "specular_reflectance": 0.7}}
    for bsdf_dict, expected in ((conductor, 0.7), ({"type": "dielectric", "int_ior": INDEX}, FACE)):
        shape = mi.load_dict({"type": "rectangle", "to_world": place, "bsdf": bsdf_dict})
        scene = Scene(name="shapes", shapes=(shape,), ambient=EVEN)
        seen = direct.layers(mitsuba_scene.MitsubaScene(scene), small()).left.ambient
        assert middle(seen) * np.pi == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize(
    ("material", "finish"),
    [
        (Material(name="m", kind="mirror", reflectance=1.0), Finish()),
        (Material(name="g", kind="glass"), Finish()),
        (Material(name="w", reflectance=1.0), Finish(transparency=0.5)),
        (Material(name="w", reflectance=1.0), Finish(gloss=0.5)),
        (Material(name="w", reflectance=1.0), Finish(metal=0.5)),
        (Material(name="w", reflectance=0.9), Finish(reflectance_scale=20.0)),
    ],
)
def test_nothing_returns_more_than_it_gets(material, finish):
    """Furnace test: under an even sky of radiance 1 / pi no pixel of a ball exceeds it.

    A ball shows all angles. Indirect ambient light is not included.
    """
    ball = solids.body("ball", solids.sphere(0.2), material, frames.pose((0, 0, 0.7)), smooth=True)
    wall = plate("wall", 1.5, Material(name="w", reflectance=1.0))
    touched = dataclasses.replace(finish, of="ball")
    seen = rendered(ball, wall, finish=touched).left.ambient
    assert seen.max() * np.pi <= 1 + 1e-4


# Compiled variants only ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("material", "changes", "named"),
    [
        (Material(name="m", kind="mirror"), {}, "material mirror"),
        (Material(name="g", kind="glass"), {}, "material glass"),
        (WHITE, {"finish": Finish(transparency=0.5)}, "scene.finish.transparency"),
        (WHITE, {"finish": Finish(gloss=0.5)}, "scene.finish.gloss"),
        (WHITE, {"finish": Finish(metal=0.5)}, "scene.finish.metal"),
        (WHITE, {"ambient": Ambient(occlusion=0.5)}, "scene.ambient.occlusion"),
        (WHITE, {"sun": Sun(irradiance_w_m2=1.0)}, "scene.sun.irradiance_w_m2"),
        (WHITE, {"other_projector": Projector(power_w=1.0)}, "scene.other_projector.power_w"),
    ],
)
def test_the_scalar_variant_refuses_unsupported_scenes(material, changes, named):
    mi_scene = mitsuba_scene.MitsubaScene(
        Scene(name="test", bodies=(plate("wall", 1.0, material),), **changes)
    )
    with pytest.raises(BackendError, match=rf"^{named} must be absent in scalar_rgb; .*LLVM"):
        scalar.layers(mi_scene, small(), subpixels=1)


def test_a_finish_of_no_effect_changes_no_bsdf():
    body = plate("wall", 1.0)
    assert bsdf.from_body(body, Finish()) == {
        "type": "twosided",
        "bsdf": {"type": "diffuse", "reflectance": {"type": "spectrum", "value": 0.6}},
    }
