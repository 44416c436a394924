"""Light of two bounces and more along random paths, and the surfaces it is seen on, by own rays.

Where no compiler is, `starling.sim.render.paths_scalar` does the same with Mitsuba's path tracer.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from starling.sim.render import backend
from starling.sim.render.layers import Image
from starling.sim.render.lights import Lights, towards_viewer
from starling.sim.render.mitsuba_scene import Stage
from starling.sim.render.rays import Camera, pixels

_ROULETTE_FROM = 3  # Bounce from which dim paths end at random.
_LONGEST = 512  # Bounces; in white rooms one path in 10^11 would be longer.
_GOES_ON = 0.95  # Most that the odds of going on may be.
# Powers of the plastic number's inverse in 32-bit fixed point: steps of the R2 sequence.
_SPREAD = (0xC13FA9A9, 0x91E10DA5)


@dataclass(frozen=True, kw_only=True, slots=True)
class Surfaces:
    """What pixels' centres see, each (h, w); zeros where there is no surface."""

    albedo: Image  # 1 where a mirror or glass shows something else.
    depth_m: Image  # z along the camera's axis.
    normal: Image  # (h, w, 3), camera frame, towards the camera.


def radiance(stage: Stage, camera: Camera, lights: Lights, samples: int, seed: int) -> Image:
    """Radiance that a camera receives of the projector's light after two bounces and more.

    From what a pixel sees, paths go on as the surfaces scatter, and at every further surface the
    projector's light is gathered. They end by Russian roulette, so no bounce is left out. First
    directions of neighbours are spread evenly (R2 sequence), so that a low-pass has less to do.

    Args:
        stage: the scene.
        camera: whose pixels are sampled at random positions.
        lights: whose projector counts, of 1 W.
        samples: paths a pixel.
        seed: of the paths.

    Returns:
        (h, w) [W m^-2 sr^-1], the mean of each pixel's paths.

    Source: Pharr, Jakob and Humphreys, Physically Based Rendering, 4th ed., secs. 13.2 and 2.2.4;
    Roberts, The unreasonable effectiveness of quasirandom sequences, 2018.
    """
    mi, dr = backend.mitsuba(), backend.drjit()
    width, height = camera.size
    count = width * height * samples
    state = mi.UInt64(seed)
    dr.make_opaque(state)  # Another seed compiles nothing.
    rng = mi.PCG32(size=count, initstate=state)
    start = _spread(count, seed)
    pixel = dr.arange(mi.UInt32, count) // samples
    row = pixel // width
    corner = mi.Vector2f(mi.Float(pixel - row * width), mi.Float(row)) - 0.5
    ray = camera.ray(corner + mi.Vector2f(rng.next_float32(), rng.next_float32()))
    if stage.specular is None:
        seen = _scattered(stage, lights, stage.mitsuba.ray_intersect(ray), start, rng)
    else:
        dr.eval(rng)

        def shade(si: Any, active: Any) -> list[Any]:
            si.t = dr.select(active, si.t, dr.inf)
            return [_scattered(stage, lights, si, start, mi.PCG32(rng))]

        seen = stage.specular.seen(stage.mitsuba, ray, shade, lambda _: [mi.Float(0)])[0]
    mean = dr.block_sum(seen, samples) / samples
    return np.asarray(mean.numpy().reshape(height, width), np.float32)


def _spread(count: int, seed: int) -> Any:
    """Points (Point2f) of the R2 sequence, shifted by the seed."""
    mi, dr = backend.mitsuba(), backend.drjit()
    shift = mi.Vector2u(*np.random.default_rng(seed).integers(2**32, size=2).tolist())
    dr.make_opaque(shift)
    index = dr.arange(mi.UInt32, count)
    x, y = ((index * step + by) >> 8 for step, by in zip(_SPREAD, shift, strict=True))
    return mi.Point2f(mi.Float(x), mi.Float(y)) * 2.0**-24


def _scattered(stage: Stage, lights: Lights, si: Any, start: Any, rng: Any) -> Any:
    """Indirect light that surface points return, one path each, first direction by `start`."""
    mi, dr = backend.mitsuba(), backend.drjit()
    flag = mi.BSDFFlags
    rough = mi.BSDFContext()  # What goes straight on, or is mirrored, is not scattered here.
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
        si = stage.mitsuba.ray_intersect(ray, active)
        active = active & si.is_valid()
        lit = lights.returned(stage, si)[0]
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


def surfaces(stage: Stage, camera: Camera) -> Surfaces:
    """Find the surfaces that a camera's pixels see."""
    mi, dr = backend.mitsuba(), backend.drjit()
    si = stage.mitsuba.ray_intersect(camera.ray(pixels(camera.size)))
    hit, place = si.is_valid(), camera.place
    albedo = stage.albedo(si)
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
