"""Path tracing of the projector's light of two or more bounces.

Without a compiler, `starling.sim.render.scalar` uses Mitsuba's path tracer instead.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from starling.sim.arrays import Image
from starling.sim.render import backend
from starling.sim.render.lights import Lights, towards_viewer
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.render.rays import JitCamera, pixels

_ROULETTE_FROM = 3  # First bounce with Russian roulette.
_LONGEST = 512  # Most bounces; in white rooms one path in 10^11 would be longer.
_GOES_ON = 0.95  # Largest probability of continuing a path.
# Steps of the R2 sequence: powers of the plastic number's inverse in 32-bit fixed point.
_SPREAD = (0xC13FA9A9, 0x91E10DA5)


@dataclass(frozen=True, kw_only=True, slots=True)
class Surfaces:
    """Surfaces at the pixel centres, each (h, w); zeros where there is none."""

    albedo: Image  # 1 on mirrors and glass.
    depth_m: Image  # z along the camera's axis.
    normal: Image  # (h, w, 3), camera frame, towards the camera.


def radiance(
    mi_scene: MitsubaScene, camera: JitCamera, lights: Lights, samples: int, seed: int
) -> Image:
    """Radiance of the projector's light after two or more bounces.

    Paths start at the surface that a pixel sees and scatter by the BSDFs. Each further surface
    adds its direct projector light. Paths end by Russian roulette, which is unbiased. The first
    directions follow the R2 sequence, which spreads neighbouring samples evenly.

    Args:
        mi_scene: Scene in Mitsuba.
        camera: Camera, whose pixels are sampled at random positions.
        lights: Lights; only the projector with 1 W counts.
        samples: Paths per pixel.
        seed: Seed of the paths.

    Returns:
        (h, w) [W m^-2 sr^-1], mean over each pixel's paths.

    Source: Pharr, Jakob and Humphreys, Physically Based Rendering, 4th ed., secs. 13.2 and 2.2.4;
    Roberts, The unreasonable effectiveness of quasirandom sequences, 2018.
    """
    mi, dr = backend.mitsuba(), backend.drjit()
    width, height = camera.size
    count = width * height * samples
    state = mi.UInt64(seed)
    dr.make_opaque(state)  # Another seed must not recompile kernels.
    rng = mi.PCG32(size=count, initstate=state)
    start = spread(dr.arange(mi.UInt32, count), _random_shift(seed))
    pixel = dr.arange(mi.UInt32, count) // samples
    row = pixel // width
    corner = mi.Vector2f(mi.Float(pixel - row * width), mi.Float(row)) - 0.5
    ray = camera.ray(corner + mi.Vector2f(rng.next_float32(), rng.next_float32()))
    if mi_scene.specular is None:
        radiances = _scattered(mi_scene, lights, mi_scene.mitsuba.ray_intersect(ray), start, rng)
    else:
        dr.eval(rng)

        def shade(si: Any, active: Any) -> list[Any]:
            si.t = dr.select(active, si.t, dr.inf)
            return [_scattered(mi_scene, lights, si, start, mi.PCG32(rng))]

        radiances = mi_scene.specular.trace(mi_scene.mitsuba, ray, shade, lambda _: [mi.Float(0)])[
            0
        ]
    mean = dr.block_sum(radiances, samples) / samples
    return np.asarray(mean.numpy().reshape(height, width), np.float32)


def spread(index: Any, shift: Any = 0) -> Any:
    """Points (Point2f) of the R2 sequence in the unit square.

    Args:
        index: Numbers of the points (UInt32).
        shift: Offset of all points in 32-bit fixed point (Vector2u), or 0.
    """
    mi = backend.mitsuba()
    offsets = (shift, shift) if isinstance(shift, int) else shift
    x, y = ((index * step + offset) >> 8 for step, offset in zip(_SPREAD, offsets, strict=True))
    return mi.Point2f(mi.Float(x), mi.Float(y)) * 2.0**-24


def _random_shift(seed: int) -> Any:
    """Offset of the R2 sequence by a seed (Vector2u)."""
    shift = backend.mitsuba().Vector2u(
        *np.random.default_rng(seed).integers(2**32, size=2).tolist()
    )
    backend.drjit().make_opaque(shift)
    return shift


def _scattered(mi_scene: MitsubaScene, lights: Lights, si: Any, start: Any, rng: Any) -> Any:
    """Indirect light reflected by surface points, one path each; `start` sets its direction."""
    mi, dr = backend.mitsuba(), backend.drjit()
    flag = mi.BSDFFlags
    rough = mi.BSDFContext()  # Straight and mirrored light is excluded.
    rough.type_mask = int(flag.Diffuse) | int(flag.Glossy)

    def scattered(context: Any, si: Any, position: Any, active: Any, rng: Any) -> tuple[Any, Any]:
        bsdf = si.bsdf()
        sample, weight = bsdf.sample(context, si, rng.next_float32(), position, active)
        return si.spawn_ray(si.to_world(sample.wo)), weight[0]

    def more(active: Any, *_: Any) -> Any:
        return active

    def step(
        active: Any, bounce: Any, ray: Any, weight: Any, total: Any, rng: Any
    ) -> tuple[Any, ...]:
        si = mi_scene.mitsuba.ray_intersect(ray, active)
        active = active & si.is_valid()
        lit = lights.reflected(mi_scene, si)[0]
        total = dr.select(active, total + weight * lit, total)
        position = mi.Point2f(rng.next_float32(), rng.next_float32())
        ray, factor = scattered(mi.BSDFContext(), si, position, active, rng)
        weight = weight * factor
        odds = dr.select(bounce >= _ROULETTE_FROM, dr.minimum(weight, _GOES_ON), 1)
        active &= (rng.next_float32() < odds) & (weight > 0) & (bounce < _LONGEST)
        return active, bounce + 1, ray, weight / dr.maximum(odds, 1e-6), total, rng

    first = si.is_valid()
    ray, weight = scattered(rough, si, start, first, rng)
    state = (
        first & (weight > 0),
        dr.ones(mi.UInt32, dr.width(weight)),
        ray,
        weight,
        dr.zeros(mi.Float, dr.width(weight)),
        rng,
    )
    return dr.while_loop(state, more, step, label="interreflection")[4]


def surfaces(mi_scene: MitsubaScene, camera: JitCamera) -> Surfaces:
    """Find the surfaces at a camera's pixel centres."""
    mi, dr = backend.mitsuba(), backend.drjit()
    si = mi_scene.mitsuba.ray_intersect(camera.ray(pixels(camera.size)))
    hit, place = si.is_valid(), camera.place
    albedo = mi_scene.albedo(si)
    flags = si.bsdf().flags()
    clear = (flags & int(mi.BSDFFlags.Delta)) != 0
    albedo = dr.select(hit, dr.select(clear, 1, albedo), 0)
    normal = towards_viewer(si)
    columns = (
        albedo,
        dr.select(hit, place.local(si.p).z, 0),
        *(dr.select(hit, dr.dot(axis, normal), 0) for axis in (place.x, place.y, place.z)),
    )
    dr.eval(*columns)
    shape = camera.size[::-1]
    white, depth, *axes = (np.asarray(c.numpy().reshape(shape), np.float32) for c in columns)
    return Surfaces(albedo=white, depth_m=depth, normal=np.stack(axes, axis=-1))
