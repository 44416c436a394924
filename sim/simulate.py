"""Simulate a sensor's reading of a scene: infrared pair, depth, and a reason for each hole."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Literal

from starling.patterns import errors
from starling.sim.arrays import Image
from starling.sim.causes import geometric_causes, photometric_causes
from starling.sim.geometry import motion
from starling.sim.imaging import imager
from starling.sim.imaging.imager import Infrared, mosaic
from starling.sim.imaging.lens_input import combine_light
from starling.sim.imaging.optics import image as optics
from starling.sim.imaging.texture import textured
from starling.sim.render import direct
from starling.sim.render.layers import Layers, ViewLayers
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene import visible
from starling.sim.scene.scene import Scene
from starling.sim.sensor.post import refuse_single_frame
from starling.sim.sensor.sensor import Imager, Sensor
from starling.sim.stereo.depth import DepthMap
from starling.sim.stereo.measurement import measure
from starling.sim.stereo.post.temporal import History
from starling.sim.stereo.registration import refuse_without, register

Side = Literal["left", "right"]
Quality = Literal["full", "draft"]
_SUBPIXELS: dict[Quality, int] = {"full": 2, "draft": 1}  # n of n x n positions in a pixel.


@dataclass(frozen=True, kw_only=True, slots=True)
class Shot:
    """One simulated reading of a sensor."""

    layers: Layers
    ir_left: Infrared
    ir_right: Infrared | None  # None: structured light, which has one imager.
    depth: DepthMap
    registered_m: Image | None  # Depth in the colour camera's image, if `post.registered`.
    exposure_s: float
    gain: float


@dataclass(frozen=True, kw_only=True, slots=True)
class InfraredPair:
    """One reading of the imagers, without depth."""

    left: Infrared
    right: Infrared | None  # None: structured light.
    matched_left: Infrared  # Includes the dropped bits that the matcher reads.
    matched_right: Infrared | None
    electrons: Image  # Expected electrons of the left imager before noise (h, w).
    exposure: imager.Exposure


def simulate(
    scene: Scene | MitsubaScene,
    sensor: Sensor,
    *,
    seed: int = 0,
    frame: int = 0,
    samples: int = 16,
    quality: Quality = "full",
) -> Shot:
    """Simulate one reading.

    Args:
        scene: Scene to observe. Pass a `MitsubaScene` to reuse one scene many times.
        sensor: Sensor that observes it.
        seed: Seed of the capture. Equal seeds give equal bits on one machine.
        frame: Frame number in a capture of several frames; each frame has its own noise.
        samples: Paths per coarse pixel of indirect light, if the scene has interreflection.
        quality: `draft` renders one position a pixel in place of four, which blurs edges less.

    Raises:
        InputError: if `quality` is unknown, `samples` is below 1, or the scene cannot be loaded.
            Also if the sensor has a temporal filter (see `sequence`), or registers depth without a
            colour camera.
    """
    refuse_impossible(sensor, 1)
    mi_scene = scene if isinstance(scene, MitsubaScene) else MitsubaScene(scene)
    layers = render_layers(mi_scene, sensor, samples=samples, seed=seed, quality=quality)
    return expose(layers, mi_scene.scene, sensor, seed=seed, frame=frame)


def sequence(
    scene: Scene | MitsubaScene,
    sensor: Sensor,
    *,
    frames: int,
    seed: int = 0,
    samples: int = 16,
    quality: Quality = "full",
) -> Iterator[Shot]:
    """Simulate several readings of a static scene, which is rendered once.

    Args:
        scene: As in `simulate`.
        sensor: As in `simulate`.
        frames: Number of readings.
        seed: As in `simulate`.
        samples: As in `simulate`.
        quality: As in `simulate`.

    Raises:
        InputError: as `simulate`, or for a temporal filter with a single frame. The check precedes
            rendering.
    """
    refuse_impossible(sensor, frames)
    return _readings(scene, sensor, frames=frames, seed=seed, samples=samples, quality=quality)


def refuse_impossible(sensor: Sensor, frames: int) -> None:
    """Refuse a pair or post-processing that cannot work; call it before rendering.

    Args:
        sensor: Sensor with its post-processing settings.
        frames: Number of consecutive frames of one scene.

    Raises:
        InputError: for imagers of different bits, a temporal filter on one frame, or registration
            without a colour camera.
    """
    left, right = ((part.bit_depth, part.dropped_bits) for part in (sensor.left, sensor.right))
    if sensor.kind == "stereo" and left != right:
        rule = f"must be {left[0]} and {left[1]}, as on the left"
        value, advice = f"{right[0]} and {right[1]}", "Set imager.bit_depth or imager.dropped_bits."
        raise errors.refuse("bit_depth and dropped_bits of right", rule, value, advice)
    refuse_single_frame(sensor.post, frames)
    if sensor.post.registered:
        refuse_without(sensor)


def _readings(
    scene: Scene | MitsubaScene,
    sensor: Sensor,
    *,
    frames: int,
    seed: int,
    samples: int,
    quality: Quality,
) -> Iterator[Shot]:
    mi_scene = scene if isinstance(scene, MitsubaScene) else MitsubaScene(scene)
    layers = render_layers(mi_scene, sensor, samples=samples, seed=seed, quality=quality)
    past = None
    for frame in range(frames):
        shot = expose(layers, mi_scene.scene, sensor, seed=seed, frame=frame, past=past)
        past = shot.depth.history
        yield shot


def expose(
    layers: Layers,
    scene: Scene,
    sensor: Sensor,
    *,
    seed: int = 0,
    frame: int = 0,
    past: History | None = None,
) -> Shot:
    """Compute a reading from rendered layers.

    Args:
        layers: Layers rendered with this sensor's geometry and projector.
        scene: Scene of the layers, for the strengths of its lights.
        sensor: Sensor: projector power, optics, imagers, matcher and post-processing.
        seed: Seed of the capture.
        frame: Frame number in the capture.
        past: `depth.history` of the previous frame, the state of a temporal filter.
    """
    seed = errors.whole_number("seed", seed, 0, 2**63 - 1)
    frame = errors.whole_number("frame", frame, 0, 2**63 - 1)
    pair = infrared(layers, scene, sensor, seed=seed, frame=frame)
    sensor = imager.at_gain(sensor, pair.exposure)
    causes = geometric_causes(layers.truth, sensor) | photometric_causes(
        sensor.left, pair.electrons, pair.left, exposure_s=pair.exposure.exposure_s
    )
    depth = measure(pair.matched_left, pair.matched_right, sensor, causes=causes, past=past)
    return Shot(
        layers=layers,
        ir_left=pair.left,
        ir_right=pair.right,
        depth=depth,
        registered_m=register(depth.depth_m, sensor) if sensor.post.registered else None,
        exposure_s=pair.exposure.exposure_s,
        gain=pair.exposure.gain,
    )


def infrared(
    layers: Layers, scene: Scene, sensor: Sensor, *, seed: int = 0, frame: int = 0
) -> InfraredPair:
    """Compute the infrared pair from rendered layers (arguments as `expose`)."""
    wavelength = sensor.projector.wavelength_nm
    views: dict[Side, ViewLayers] = {"left": layers.left}
    if layers.right is not None:
        views["right"] = layers.right
    imagers: dict[Side, Imager] = {"left": sensor.left, "right": sensor.right}

    def form_image(side: Side, device: Sensor = sensor) -> Image:
        view = textured(views[side], scene, device, side)
        bands = view.bands if imagers[side].mosaic != "none" else ()
        lights = [
            combine_light(band, scene, device, seed=seed, frame=frame) for band in bands or (view,)
        ]
        images = [optics.image(light, view.depth_m, device, side, seed=seed) for light in lights]
        return mosaic.sample(images)

    def metering_image() -> Image:
        """Image for exposure control, which averages the flicker over many frames."""
        if not (sensor.projector.flicker and sensor.left.auto_exposure_level):
            return images["left"]
        steady = dataclasses.replace(sensor.projector, flicker=0.0)
        return form_image("left", dataclasses.replace(sensor, projector=steady))

    def read_out(side: Side) -> imager.Readout:
        return imager.read_out(
            exposed[side],
            electrons[side],
            exposure_s=exposure.exposure_s,
            unit=sensor.unit,
            side=side,
            seed=seed,
            frame=frame,
        )

    # The libraries release Python's lock, so two threads are nearly twice as fast.
    with ThreadPoolExecutor(2) as pool:
        images = dict(zip(views, pool.map(form_image, views), strict=True))
        exposure = imager.choose_exposure(sensor.left, metering_image(), wavelength)
        device = imager.at_gain(sensor, exposure)
        exposed: dict[Side, Imager] = {"left": device.left, "right": device.right}
        electrons = {
            side: imager.mean_electrons(imagers[side], image, wavelength, exposure)
            for side, image in images.items()
        }
        read = dict(zip(views, pool.map(read_out, views), strict=True))
    right = read.get("right")
    return InfraredPair(
        left=read["left"].delivered,
        right=right and right.delivered,
        matched_left=read["left"].matched,
        matched_right=right and right.matched,
        electrons=electrons["left"],
        exposure=exposure,
    )


def render_layers(
    mi_scene: MitsubaScene,
    sensor: Sensor,
    *,
    samples: int = 16,
    seed: int = 0,
    step_px: float = motion.STEP_PX,
    quality: Quality = "full",
) -> Layers:
    """Render the layers that `expose` needs (arguments as in `simulate`).

    A sensor of visible light sees visible reflectances (`starling.sim.scene.visible`). If the
    sensor moves, the views of one exposure time are averaged. Between two of these views no point
    moves by more than `step_px`.
    """
    stages = [mi_scene.with_scene(scene) for scene in visible.views(mi_scene.scene, sensor)]
    return render_views(
        stages, sensor, samples=samples, seed=seed, step_px=step_px, quality=quality
    )


def render_views(
    stages: Sequence[MitsubaScene],
    sensor: Sensor,
    *,
    samples: int = 16,
    seed: int = 0,
    step_px: float = motion.STEP_PX,
    quality: Quality = "full",
) -> Layers:
    """As `render_layers`, of the scenes of `starling.sim.scene.visible.views` in Mitsuba."""
    samples = errors.whole_number("samples", samples, 1, 4096, "16 are enough for most scenes.")
    seed = errors.whole_number("seed", seed, 0, 2**63 - 1)
    errors.one_of("quality", quality, _SUBPIXELS)
    seen, *colours = stages
    exposure_s = sensor.left.exposure_s
    if sensor.left.auto_exposure_level and not seen.scene.motion.still:
        render = partial(direct.layers, seen, sensor, subpixels=_SUBPIXELS[quality])
        still = infrared(render(), seen.scene, sensor, seed=seed)
        exposure_s = still.exposure.exposure_s

    def rendered(mi_scene: MitsubaScene) -> Layers:
        layers = direct.layers(
            mi_scene, sensor, subpixels=_SUBPIXELS[quality], exposure_s=exposure_s, step_px=step_px
        )
        if mi_scene.scene.interreflection:
            from starling.sim.render import indirect

            layers = indirect.add(layers, mi_scene, sensor, samples=samples, seed=seed)
        return layers

    bands = [rendered(colour) for colour in colours]
    return rendered(seen).with_bands(bands)
