"""From depth images to infrared images: light of both views, lens, electronics."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from starling.sim.batch import handoff, imaging, light, metering, views
from starling.sim.batch.batch_scene import BatchScene
from starling.sim.batch.handoff import launch
from starling.sim.batch.rig import ExposureRule, LightRig, Side, SideRig

wp: Any = handoff.import_warp()


@dataclass(frozen=True, slots=True)
class SliceDraws:
    """Random streams of the environments of a slice."""

    seed: int
    frame: int
    first: int  # Number of the slice's first environment.

    def stream(self, stage: str, effect: str, frame: int) -> int:
        """Seed of one effect, for Warp's generators; see `randomness.generator`."""
        words = [self.seed, frame, zlib.crc32(stage.encode()), zlib.crc32(effect.encode())]
        word = np.random.SeedSequence(words).generate_state(1)
        return int(word.view(np.int32)[0])


@dataclass(frozen=True, slots=True, eq=False)
class LitView:
    """Surfaces and light of one imager, each (n, h, w)."""

    disparity: Any  # [px], 0 without a surface.
    reflectance: Any
    light: Any  # vec2: radiance of projector and sky [W m^-2 sr^-1].
    lit: Any  # 1 where the projector's light arrives.


@dataclass(frozen=True, slots=True, eq=False)
class Formed:
    """An image on an imager."""

    radiance: Any  # (n, h, w) [W m^-2 sr^-1]
    mean: Any  # (n,)
    metered: Any  # (n,) mean of the part that auto exposure meters.


@dataclass(frozen=True, slots=True, eq=False)
class Codes:
    """Digital images of one imager, each (n, h, w)."""

    delivered: Any
    matched: Any  # uint16 of at most ten bits, the matcher's.


def light_views(scene: BatchScene, rig: LightRig) -> tuple[LitView, LitView]:
    """Warp depth images into the right view, and light both views."""
    shape, device = scene.depth.shape, scene.depth.device
    left, right = _views(shape, device), _views(shape, device)
    launch(views.fill_disparity, shape, device, scene.depth, rig.focal_baseline, left.disparity)
    scale = rig.reflectance_scale
    if isinstance(scene.reflectance, float):
        left.reflectance.fill_(min(scene.reflectance * scale, 1.0))
    else:
        shares = (scene.reflectance, scale, left.reflectance)
        launch(light.scale_reflectance, shape, device, *shares)
    seen = wp.zeros(shape, dtype=wp.uint64, device=device)
    launch(views.see, shape, device, left.disparity, 1.0, 0, seen)
    known = (left.disparity, left.reflectance, _rendered(scene.right_depth, rig, device))
    launch(views.fill_right, shape, device, seen, *known, right.disparity, right.reflectance)
    for view in (left, right):
        surfaces = (view.disparity, view.reflectance, rig.camera)
        sky = (scene.irradiance, scene.gradient, scene.up)
        launch(light.light_by_sky, shape, device, *surfaces, *sky, view.light)
    n, h, w = shape
    seen = wp.empty((n, h, w + 2 * rig.margin), dtype=wp.uint64, device=device)
    rendered = _rendered(scene.projector_depth, rig, device)
    for beam, levels in rig.beams:
        seen.zero_()
        if rendered.shape[0]:
            launch(views.see_rendered, shape, device, rendered, rig.margin, seen)
        else:
            launch(views.see, shape, device, left.disparity, beam.place, rig.margin, seen)
        for place, view in ((0.0, left), (1.0, right)):
            surfaces = (view.disparity, view.reflectance, rig.camera, place)
            emitter = (beam, levels, seen, rig.margin, rig.power)
            launch(light.light_by_beam, shape, device, *surfaces, *emitter, view.light, view.lit)
    return left, right


def _rendered(depth: Any, rig: LightRig, device: Any) -> Any:
    """Disparities (n, h, w) of depth images; () without images."""
    if depth is None:
        return wp.empty((0, 0, 0), dtype=float, device=device)
    disparity = wp.empty(depth.shape, dtype=float, device=device)
    launch(views.fill_disparity, depth.shape, device, depth, rig.focal_baseline, disparity)
    return disparity


def _views(shape: tuple[int, ...], device: Any) -> LitView:
    disparity, reflectance, radiance = (
        wp.empty(shape, dtype=dtype, device=device) for dtype in (float, float, wp.vec2)
    )
    return LitView(disparity, reflectance, radiance, wp.zeros(shape, dtype=wp.uint8, device=device))


def form(view: LitView, side: Side, rig: SideRig, draws: SliceDraws) -> Formed:
    """Form the image of a view on its imager."""
    shape, device = view.light.shape, view.light.device
    n, h, w = shape
    levels = len(rig.steps)
    blurred = wp.empty((levels, *shape), dtype=wp.vec2, device=device)
    for level in range(levels):
        launch(imaging.spread_rows, shape, device, view.light, rig.weights, level, blurred)
    normal = wp.empty((0, 0, 0), dtype=float, device=device)
    if len(rig.quantiles):
        border = len(rig.taps) - 1
        normal = wp.empty((n, h + border, w + border), dtype=float, device=device)
        seed = draws.stream("optics", f"speckle {side}", 0)  # Frames share the speckle.
        launch(imaging.draw_normal, normal.shape, device, seed, draws.first, normal)
    focused = wp.empty(shape, dtype=wp.vec2, device=device)
    spot = (rig.weights, rig.steps, rig.spot)
    launch(imaging.focus, shape, device, blurred, view.disparity, *spot, focused)
    radiance = wp.empty(shape, dtype=float, device=device)
    grain = (normal, rig.taps, rig.quantiles)
    launch(imaging.form, shape, device, focused, rig.shift, *grain, rig.shading, radiance)
    mean = _mean(radiance, (slice(0, h), slice(0, w)))
    whole = rig.metered == (slice(0, h), slice(0, w))
    return Formed(radiance, mean, mean if whole else _mean(radiance, rig.metered))


def _mean(radiance: Any, part: tuple[slice, slice]) -> Any:
    """Mean (n,) of the same rows and columns of all images."""
    n, device = radiance.shape[0], radiance.device
    rows, columns = part
    height, width = rows.stop - rows.start, columns.stop - columns.start
    sums = wp.empty((n, height), dtype=wp.float64, device=device)
    mean = wp.empty(n, dtype=float, device=device)
    ends = wp.vec4i(rows.start, rows.stop, columns.start, columns.stop)
    launch(metering.sum_rows, sums.shape, device, radiance, ends, sums)
    launch(metering.average, n, device, sums, width, mean)
    return mean


@dataclass(frozen=True, slots=True, eq=False)
class Exposures:
    """Exposure of each environment, each (n,)."""

    exposure_s: Any
    gain: Any  # Of the left imager.


def expose(left: Formed, rule: ExposureRule, exposures: Exposures) -> None:
    """Fill the exposures of both imagers, from the left image."""
    numbers = (rule.veil, rule.aim, rule.signal, rule.longest_s, wp.vec2(*rule.gains))
    filled = (exposures.exposure_s, exposures.gain)
    means = (left.mean, left.metered)
    launch(metering.expose, left.mean.shape, left.mean.device, *means, *numbers, *filled)


def read_out(
    formed: Formed,
    exposures: Exposures,
    side: Side,
    rig: SideRig,
    draws: SliceDraws,
    delivered: Any,
) -> Codes:
    """Convert an image to codes, with all noise of the imager.

    Args:
        formed: the image.
        exposures: exposure of each environment.
        side: which imager.
        rig: its electronics.
        draws: random streams.
        delivered: (n, h, w) is filled with the codes that the device delivers.
    """
    shape, device = formed.radiance.shape, formed.radiance.device
    signal = wp.empty(shape, dtype=float, device=device)
    matched = wp.empty(shape, dtype=wp.uint16, device=device)
    seeds = [draws.stream("imager", f"{noise} {side}", draws.frame) for noise in ("noise", "row")]
    n, h, w = shape
    normal = wp.empty((0, 0, 0), dtype=float, device=device)
    if len(rig.colour):
        border = len(rig.colour) - 1
        normal = wp.empty((n, h + border, w + border), dtype=float, device=device)
        launch(imaging.draw_normal, normal.shape, device, seeds[0], draws.first, normal)
    exposure = (exposures.exposure_s, exposures.gain)
    image = (formed.radiance, formed.mean, *exposure, rig.die, rig.fixed, normal, rig.colour)
    launch(imaging.collect, shape, device, *image, *seeds, draws.first, signal)
    converter = (rig.smoothing, rig.die, delivered, matched)
    launch(imaging.digitise, shape, device, signal, *converter)
    return Codes(delivered, matched)
