"""Limits of a diagnosis: one sentence for each thing that its captures cannot show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from starling.diagnosis.scenes.fit_scene import (
    AUTO_EXPOSURE,
    EXPOSURE,
    GAIN,
    SCALE,
    SHIFT,
    TURN,
)
from starling.diagnosis.scenes.observation import DepthObservation, StereoObservation
from starling.diagnosis.scenes.scene_model import SceneModel
from starling.diagnosis.scenes.selection import (
    FEWEST_ROOMS,
    ROOMS_PER_TEST_ROOM,
    SceneSelection,
)
from starling.diagnosis.which.candidates import LEFT_OUT, Segment, effects_on_bodies
from starling.sim import effects

_LISTED = 6  # Longest list of families that is written out.
_SEGMENT_NAMES = {
    Segment.IMAGE: "images",
    Segment.DEPTH: "matcher and filters",
    Segment.WHOLE: "depth",
}


def list_limits(
    device: str,
    scenes: SceneSelection,
    families: Sequence[str] | None,
    untried: Sequence[Segment],
    *,
    compatible: bool,
) -> list[str]:
    """List the limits of a diagnosis.

    Args:
        device: name in the captures of the base, or of the diagnosed set if there is no base set.
        scenes: selected scenes; at least one is complete.
        families: families of effects that were tried; None if all were.
        untried: segments on which none of these families acts.
        compatible: whether one sensor can have all accepted effects.

    Returns:
        One sentence for each limit.
    """
    limits = [
        *_selection(device, scenes.complete, scenes.unpaired, families, untried),
        *_incomplete(scenes.complete, [scene.name for scene in scenes.incomplete]),
        *_rooms(scenes.complete, held_out=bool(scenes.held_out)),
        *_contents(scenes.complete),
        *_light(scenes.complete),
        *_plugin_scenes(scenes),
        "Not tried, as single static frames of one size do not show them: "
        f"{', '.join(sorted(LEFT_OUT))}.",
    ]
    if not compatible:
        limits.append(
            "The effects accepted for images and for depth exclude each other in one sensor. So "
            "the gap reduction is not evaluated, and no sensor with all of them is written."
        )
    return limits


def _selection(
    device: str,
    scene_models: Sequence[SceneModel],
    unpaired: Sequence[str],
    families: Sequence[str] | None,
    untried: Sequence[Segment],
) -> Iterator[str]:
    sensor_name = scene_models[0].sensor.name
    if device != sensor_name:
        captures = "These captures" if scene_models[0].against is None else "The other captures"
        yield f"{captures} name a {device} as their device; the given sensor is a {sensor_name}."
    if families is not None:
        yield from _tried(set(families))
    for segment in untried:
        name = _SEGMENT_NAMES[segment]
        yield f"None of them acts on {name}: a gap there is not attributed."
    if unpaired:
        yield f"Only one of the two sets has these scenes; they are ignored: {', '.join(unpaired)}."


def _tried(families: set[str]) -> Iterator[str]:
    """Name the families that were tried, or those that were not, whichever list is short."""
    known = {effect.family for effect in effects.table()}
    others = sorted(known - families)
    if len(families) <= _LISTED:
        yield f"Only effects of these families were tried: {', '.join(sorted(families))}."
    elif len(others) > _LISTED:
        yield f"Effects of {len(families)} of the {len(known)} families were tried, as asked."
    elif others:
        yield f"Effects of these families were not tried: {', '.join(others)}."


def _incomplete(scene_models: Sequence[SceneModel], incomplete: Sequence[str]) -> Iterator[str]:
    if incomplete:
        paired = all(isinstance(scene.real, StereoObservation) for scene in scene_models)
        measured = all(isinstance(scene.real, DepthObservation) for scene in scene_models)
        contents = [
            *(["infrared pairs"] if paired else []),
            *(["device depth"] if measured else []),
        ]
        yield (
            f"Diagnosed are scenes that hold {' and '.join(contents)}; these do not and are "
            f"ignored: {', '.join(incomplete)}."
        )


def _rooms(scene_models: Sequence[SceneModel], *, held_out: bool) -> Iterator[str]:
    if len({scene.room for scene in scene_models}) < FEWEST_ROOMS:
        yield "Only one room: nothing can be held out, so no effect is named."
    elif not held_out:
        yield f"Fewer than {ROOMS_PER_TEST_ROOM} rooms: the gap reduction is not measured."


def _contents(scene_models: Sequence[SceneModel]) -> Iterator[str]:
    depth_only = [
        scene.name for scene in scene_models if not isinstance(scene.real, StereoObservation)
    ]
    if depth_only:
        yield (
            f"No infrared{_scenes(depth_only, scene_models)}: effects on the image and effects of "
            "matcher and filters are not separable."
        )
    lit = [
        scene.name
        for scene in scene_models
        if scene.sensor.projector.power_w == 0
        and isinstance(scene.real, StereoObservation)
        and not scene.real.unlit
    ]
    if lit:
        yield (
            f"The given sensor has its projector off, and no pair{_scenes(lit, scene_models)} is "
            "named as captured so (ir_left_off.png, ir_right_off.png): the ordinary pairs are used."
        )
    pairs_alone = [
        scene.name for scene in scene_models if not isinstance(scene.real, DepthObservation)
    ]
    if pairs_alone:
        yield (
            f"No device depth{_scenes(pairs_alone, scene_models)}: matcher and filters are not "
            "diagnosed."
        )
    single = [scene.name for scene in scene_models if scene.frames < 2]
    if single:
        names = _scenes(single, scene_models)
        yield f"Only one frame{names}: temporal noise is not measured there."
    moved = [
        scene.name
        for scene in scene_models
        if scene.real.moved or (scene.against is not None and scene.against.moved)
    ]
    if moved:
        yield (
            f"Repeats of {', '.join(moved)} differ by more than noise and flicker, as if the scene "
            "had moved: their temporal noise may be wrong."
        )


def _plugin_scenes(scenes: SceneSelection) -> Iterator[str]:
    """Name the effects that do not act on the shapes of a Mitsuba XML."""
    plugins = [scene.name for scene in scenes.complete if not scene.scene.bodies]
    if not plugins:
        return
    names = ", ".join(effects_on_bodies())
    if scenes.training[0].scene.bodies:
        yield f"Shapes of {', '.join(plugins)} keep the XML's materials, despite effects: {names}."
    else:
        yield f"Not tried, as shapes of an XML keep their materials: {names}."


def _light(scene_models: Sequence[SceneModel]) -> Iterator[str]:
    estimated = [scene for scene in scene_models if scene.estimates]
    if any(isinstance(scene.real, StereoObservation) for scene in estimated):
        yield (
            "Reflectance and ambient light were estimated from these images: they partly absorb "
            "light, exposure, gain, vignetting and reflectance, which are not separable."
        )
    elif estimated:
        yield (
            "Reflectance and ambient light are unknown, and without images one value of each was "
            "assumed: light, exposure, gain and reflectance are not separable."
        )
    elif len({repr(scene.scene.ambient) for scene in scene_models}) > 1:
        yield "Scenes differ in ambient light: its tried values depart from the first scene's."
    yield from _fitted(scene_models)
    yield from _exposures(scene_models)


def _moved_references(scene_models: Sequence[SceneModel]) -> Iterator[str]:
    """Report the largest correction of a reference pose."""
    fitted = [scene.nuisances for scene in scene_models if TURN[0] in scene.nuisances]
    if fitted:
        turn, shift = (
            max(
                float(np.linalg.norm([nuisances[name].value for name in names]))
                for nuisances in fitted
            )
            for names in (TURN, SHIFT)
        )
        yield (
            f"References were moved to fit disparity, by up to {1e3 * shift:.1f} mm and "
            f"{turn:.2f} degree: this partly absorbs offset, scale and tilt of the camera."
        )


def _fitted(scene_models: Sequence[SceneModel]) -> Iterator[str]:
    yield from _moved_references(scene_models)
    fitted = {name for scene in scene_models for name in scene.nuisances}
    names = sorted(fitted - {*TURN, *SHIFT, EXPOSURE, GAIN, AUTO_EXPOSURE})
    if names:
        spans = []
        for name in names:
            values = [
                scene.nuisances[name].value for scene in scene_models if name in scene.nuisances
            ]
            spans.append(f"{name} {_span(values)}")
        tried = any(scene.against is not None for scene in scene_models)
        yield (
            f"Fitted to each scene separately: {', '.join(spans)}. "
            + ("Effects depart from that." if tried else "So these are not tried as effects.")
        )
    unmatched = [
        scene.name
        for scene in scene_models
        if scene.estimates
        and isinstance(scene.real, StereoObservation)
        and scene.sensor.projector.power_w > 0
        and SCALE not in scene.nuisances
    ]
    if unmatched:
        yield (
            f"Dots{_scenes(unmatched, scene_models)} do not match this sensor's pattern at any "
            "scale: features of dot positions then show that the pattern is another one."
        )


def _exposures(scene_models: Sequence[SceneModel]) -> Iterator[str]:
    recorded = [
        scene for scene in scene_models if {EXPOSURE, GAIN, AUTO_EXPOSURE} & scene.nuisances.keys()
    ]
    if recorded:
        exposure_s, gain = (
            _span([getattr(scene.sensor.left, name) for scene in recorded])
            for name in ("exposure_s", "gain")
        )
        names = _scenes([scene.name for scene in recorded], scene_models)
        yield (
            f"frame.json gives the exposure{names}: {exposure_s} s at gain {gain}. It replaces "
            "the given sensor's."
        )


def _span(values: Sequence[float]) -> str:
    """Write the least and the largest value; one number if they are equal."""
    return " to ".join(dict.fromkeys(f"{end:.5g}" for end in (min(values), max(values))))


def _scenes(names: Sequence[str], scene_models: Sequence[SceneModel]) -> str:
    """Name the scenes, unless a limit concerns all of them."""
    return f" of {', '.join(names)}" if len(names) < len(scene_models) else ""
