"""Model of one scene under diagnosis: geometry, sensor, captured data, and their simulation."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.scenes import estimated, fit_scene
from starling.diagnosis.scenes.estimated import Estimates
from starling.diagnosis.scenes.fit_scene import Nuisances
from starling.diagnosis.scenes.observation import (
    NOT_CAPTURED,
    DepthObservation,
    FullObservation,
    SceneObservation,
    StereoObservation,
    add_exposure_noise,
    common_content,
    device_depth,
    expect,
    infrared_observation,
    match_pairs,
    quantise_depth,
    read_observation,
    with_dropped_bits,
    without_extra_bits,
)
from starling.diagnosis.scenes.request import Request, Source, simulation
from starling.diagnosis.scenes.shelf import MOST_HELD, Shelved
from starling.diagnosis.scenes.strata import Strata, projector_tangents, stratify
from starling.diagnosis.transfer import transfer
from starling.diagnosis.transfer.transfer import Pair, SimulatedPairs, TransferBase
from starling.learning.data.example import Physics
from starling.learning.data.simulated import summary
from starling.patterns.errors import refuse
from starling.sim import simulate
from starling.sim.captures.capture import CapturedScene
from starling.sim.captures.writer import info_of
from starling.sim.commands.simulate_captures import scene_seed
from starling.sim.effects import named
from starling.sim.effects import setting as setting
from starling.sim.effects.effect import Value
from starling.sim.imaging.noiseless import noiseless
from starling.sim.render.layers import Layers
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.scene import Scene
from starling.sim.sensor import edits
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.memory import Memory

# Coarse rendering suffices: the diagnosis uses differences, in which rendering noise cancels.
_SAMPLES = 4  # Paths per pixel of indirect light.
_STEP_PX = 2.0  # Image motion between the moments of one exposure.
_FINER_BITS = 8  # Extra bits of simulated images that must not be quantised.
_NOISELESS = (  # Settings that remove noise and speckle.
    *((f"imager.{name}", 0.0) for name in ("shot_noise", "read_noise_e", "dsnu_e")),
    *((f"imager.{name}", 0.0) for name in ("prnu", "pattern_contrast")),
    ("projector.speckle_contrast", 0.0),
)

_Bases = dict[int, tuple[list[TransferBase], list[TransferBase]]]
_RenderKey = tuple[int | None, tuple[tuple[str, Value], ...]]  # Seed of faulty dots, effects.


@dataclass(kw_only=True, eq=False, repr=False)
class SceneModel:
    """One scene with what was captured of it; its base is rendered once."""

    name: str
    room: str
    sensor: Sensor  # The base, with the nuisance parameters fitted to this scene.
    frames: int  # Repeats of a simulated observation.
    nuisances: Nuisances  # Fitted to this scene; effects depart from them.
    scene: Shelved[Scene] = Shelved()
    strata: Shelved[Strata] = Shelved()
    real: Shelved[SceneObservation] = Shelved()  # The captured observation.
    against: Shelved[SceneObservation | None] = Shelved()  # Captured reference; None: simulated.
    estimates: Shelved[Estimates] = Shelved()  # Alternative scenes that the captures also permit.
    _layers: Shelved[Layers] = Shelved()
    _memory: Shelved[Memory] = Shelved(changes=True)  # Matching costs of the captured pairs.
    # The last rendering with effects: it serves several noise seeds and devices.
    _last: Shelved[dict[_RenderKey, Layers]] = Shelved(changes=True)
    _bases: Shelved[_Bases] = Shelved(changes=True)  # Of the transfer to pairs, by noise seed.

    def request(self, settings: Mapping[str, Value], *, seed: int, device: int = 0) -> Request:
        """Request a simulation of those outputs that were captured.

        Args:
            settings: value by effect.
            seed: seed of the noise.
            device: number of another device; 0 for the captured one.
        """
        source = Source.INFRARED
        if isinstance(self.real, DepthObservation):
            source = Source.BOTH if isinstance(self.real, StereoObservation) else Source.DEPTH
        return simulation(source, settings, seed=seed, device=device)

    def observe(self, request: Request) -> SceneObservation:
        """Simulate or measure what is requested.

        Raises:
            InputError: if the sensor cannot have the requested effects.
        """
        match request.source:
            case Source.CAPTURED:
                return self.real
            case Source.REFERENCE:
                return self.reference
            case Source.REEXPOSED:
                rng = np.random.default_rng(self._noise_seed(request.seed))
                reference = expect(self.reference, StereoObservation)
                return add_exposure_noise(reference, self.sensor, rng)
            case Source.REMATCHED:
                return self._rematch(request)
            case _:
                return self._with_estimate(request)._with_device(request)._simulate(request)

    @property
    def reference(self) -> SceneObservation:
        """Captured reference observation; it exists only if two captures are compared."""
        if self.against is None:
            raise ValueError(f"scene {self.name} is compared with simulation")
        return self.against

    def physics(self, settings: Mapping[str, Value], *, seeds: Sequence[int]) -> Physics:
        """Summarise simulations of several noise seeds as input features for `learning`.

        Depth is the device's if it was captured, else our matcher's.
        """
        sensor, scene, layers = self._apply(settings)
        if not isinstance(self.real, DepthObservation):
            sensor = without_extra_bits(sensor)
        noise_seeds = map(self._noise_seed, seeds)
        shots = [simulate.expose(layers, scene, sensor, seed=seed) for seed in noise_seeds]
        return summary(shots, sensor)

    def scene_settings(self, settings: Mapping[str, Value]) -> dict[str, Value]:
        """Convert settings from the common base of all scenes to this scene's fitted base."""
        return fit_scene.shift_settings(settings, self.nuisances)

    def _noise_seed(self, seed: int) -> int:
        """Derive a noise seed of this scene that differs from those of simulated captures."""
        return scene_seed(seed, f"diagnosis of {self.name}")

    def _with_estimate(self, request: Request) -> SceneModel:
        """Replace the scene by an alternative estimate, if it has as many."""
        if not 0 < request.estimate <= len(self.estimates):
            return self
        scene = self.estimates[request.estimate - 1]()
        layers = _render(_stage(scene), self.sensor)
        return dataclasses.replace(self, scene=scene, _layers=layers, _last={}, _bases={})

    def _with_device(self, request: Request) -> SceneModel:
        """Replace the device by another of its kind, with other fixed patterns and faulty dots."""
        if not request.device:
            return self
        projector = self.sensor.projector
        sensor = dataclasses.replace(
            self.sensor,
            unit=self.sensor.unit + request.device,
            projector=dataclasses.replace(
                projector, faults_seed=projector.faults_seed + request.device
            ),
        )
        layers = _render(_stage(self.scene), sensor) if projector.faulty else self._layers
        return dataclasses.replace(self, sensor=sensor, _layers=layers, _bases={})

    def _simulate(self, request: Request) -> SceneObservation:
        if request.source is Source.INFRARED and isinstance(self.against, StereoObservation):
            return self._transfer(self.against, request)
        sensor, scene, layers = self._apply(request.settings)
        seed = self._noise_seed(request.seed)
        pairs = [
            simulate.infrared(layers, scene, sensor, seed=seed, frame=frame)
            for frame in range(self.frames)
        ]
        if request.source is Source.DEPTH:
            return DepthObservation(device_px=device_depth(sensor, pairs))
        infrared = infrared_observation(sensor, pairs)
        if request.source is Source.INFRARED:
            return infrared
        return infrared.with_depth(device_depth(sensor, pairs))

    def _rematch(self, request: Request) -> FullObservation:
        """Match the captured images with effects on matcher and post-processing."""
        sensor = _sensor_with(self.sensor, request.effects)
        pairs = expect(self.real, StereoObservation)
        maps = match_pairs(pairs.left, pairs.right, sensor, memory=self._memory)
        return pairs.with_depth(quantise_depth(maps, sensor))

    def _apply(self, settings: Mapping[str, Value]) -> tuple[Sensor, Scene, Layers]:
        """Apply effects to sensor and scene, and render."""
        settings = self.scene_settings(settings)
        sensor = _sensor_with(self.sensor, tuple(settings.items()))
        scene = setting.on_scene(self.scene, settings)
        return sensor, scene, self._rendered(scene, sensor, settings)

    def _rendered(self, scene: Scene, sensor: Sensor, settings: Mapping[str, Value]) -> Layers:
        """Return the noiseless layers; those of the base unless an effect changes rendering."""
        rendered = tuple(sorted(settings.items()))
        if scene.motion.still:  # With motion, rendering depends on the exposure as well.
            rendered = tuple(item for item in rendered if named(item[0].partition(".")[0]).rerender)
        if not rendered:
            return self._layers
        key = sensor.projector.faults_seed if sensor.projector.faulty else None, rendered
        if key not in self._last:
            self._last.clear()
            self._last[key] = _render(_stage(self.scene).with_scene(scene), sensor)
        return self._last[key]

    def _transfer(self, captured: StereoObservation, request: Request) -> StereoObservation:
        """Transfer effects from simulated pairs onto captured pairs."""
        seed = request.seed
        if seed not in self._bases:
            self._bases.clear()
            _, base = self._unquantised_pairs({}, seed)
            self._bases[seed] = transfer.transfer_bases(captured.levels, base)
        sensor, changed = self._unquantised_pairs(request.settings, seed)
        ceiling = max(2**sensor.left.bit_depth - 1, int(captured.left.max()))
        images = transfer.transfer_pairs(self._bases[seed], changed, ceiling=ceiling)
        dtype = np.uint8 if ceiling < 2**8 else np.uint16
        left, right = (np.stack(side).astype(dtype) for side in images)
        ours_px = match_pairs(left[:1], right[:1], sensor)
        return StereoObservation(left=left, right=right, ours_px=ours_px)

    def _unquantised_pairs(
        self, settings: Mapping[str, Value], seed: int
    ) -> tuple[Sensor, SimulatedPairs]:
        """Simulate pairs [DN] with more bits than the output images have."""
        sensor, scene, layers = self._apply(settings)
        fine = with_dropped_bits(sensor, _FINER_BITS)
        scale = np.float32(2.0 ** (sensor.left.bit_depth - fine.left.matched_bits))

        def expose(camera: Sensor, frame: int) -> Pair:
            noise_seed = self._noise_seed(seed)
            pair = simulate.infrared(layers, scene, camera, seed=noise_seed, frame=frame)
            assert pair.matched_right is not None
            return pair.matched_left * scale, pair.matched_right * scale

        noise_free = expose(edits.with_values(fine, _NOISELESS), 0)
        pairs = [expose(fine, frame) for frame in range(self.frames)]
        return sensor, SimulatedPairs(pairs, noise_free)


@lru_cache(maxsize=4)
def _sensor_with(base: Sensor, settings: tuple[tuple[str, Value], ...]) -> Sensor:
    """Apply effects to a sensor; cached because all scenes need the same sensors in turn."""
    return setting.on_sensor(base, dict(settings))


@lru_cache(maxsize=MOST_HELD)
def _stage(scene: Scene) -> MitsubaScene:
    """Load a scene in Mitsuba; the last ones are cached because effects render them again."""
    return MitsubaScene(scene)


def _render(stage: MitsubaScene, sensor: Sensor) -> Layers:
    return simulate.render_layers(stage, sensor, samples=_SAMPLES, step_px=_STEP_PX)


def load_scene_model(
    captured: CapturedScene,
    sensor: Sensor,
    *,
    against: CapturedScene | None = None,
    fitted: Nuisances | None = None,
    even_ambient: bool = False,
) -> SceneModel:
    """Build the model of a captured scene.

    Args:
        captured: captured scene with reference depth or a `scene.toml`.
        sensor: the base.
        against: capture of the same scene by the base; it is the reference of the comparison, and
            geometry and light are taken from it.
        fitted: nuisance parameters from an earlier fit; None fits them.
        even_ambient: as in `starling.sim.scene.captured.captured_scene.estimate_light`.

    Raises:
        InputError: if the sensor has another image size, or if an image is damaged. Also if neither
            geometry nor reference depth is known, if neither a pair nor depth was captured, or if
            both captures have nothing in common.
    """
    reference = captured if against is None else against
    size = reference.info.shape
    if size != (sensor.height, sensor.width):
        rule = f"must be of the sensor's size, {sensor.height} x {sensor.width}"
        raise refuse(f"scene {captured.name}", rule, size, "Give the sensor of these captures.")
    base = read_observation(reference, sensor)
    fitted = fit_scene.fit_geometry(reference, sensor) if fitted is None else fitted
    fitted = {**fitted, **fit_scene.recorded_exposure(reference, base.exposures, sensor)}
    reference = fit_scene.correct_reference(reference, fitted)
    sensor = fit_scene.apply_to_sensor(sensor, fitted)
    # The light estimate needs dots at their true place, so it comes after the geometry.
    scene, estimates = estimated.load_scene(reference, sensor, even_ambient=even_ambient)
    scene, fitted = fit_scene.fit_light(reference, scene, sensor, fitted)
    model = build_scene_model(
        scene,
        sensor,
        name=reference.name,
        room=reference.room,
        truth_m=reference.truth_m(),
        real=base,
        frames=base.repeats,
        estimates=estimates,
        fitted=fitted,
    )
    return model if against is None else with_capture(model, captured, against=base)


def with_capture(
    model: SceneModel, captured: CapturedScene, *, against: SceneObservation | None
) -> SceneModel:
    """Replace the captured observation of a scene model by another capture of the scene.

    Args:
        model: model of the scene.
        captured: other capture of the scene.
        against: reference observation; None compares with simulation.

    Raises:
        InputError: as `load_scene_model`.
    """
    real = read_observation(captured, model.sensor)
    if against is not None:
        real, against = common_content(real, against)
    memory = Memory(_pair_count(real, against))
    return dataclasses.replace(
        model, real=real, against=against, frames=real.repeats, _memory=memory, _bases={}
    )


def build_scene_model(
    scene: Scene,
    sensor: Sensor,
    *,
    name: str,
    room: str,
    truth_m: NDArray[np.float32] | None,
    real: SceneObservation = NOT_CAPTURED,
    frames: int,
    estimates: Estimates = (),
    fitted: Nuisances | None = None,
) -> SceneModel:
    """Build the model of a scene from its parts.

    Args:
        scene: geometry, materials and light.
        sensor: the base.
        name: name of the scene; noise seeds are derived from it.
        room: room of the scene; scenes of one room are not independent.
        truth_m: (h, w) reference depth; None takes the rendered depth.
        real: captured observation; none for a scene that is only simulated.
        frames: repeats of a simulated observation.
        estimates: alternative scenes that the captures also permit.
        fitted: nuisance parameters that scene and sensor contain; None if there are none.

    Raises:
        InputError: if depth is unknown everywhere.
    """
    layers = _render(_stage(scene), sensor)
    truth_m = layers.truth.depth_m if truth_m is None else truth_m
    if not np.isfinite(truth_m).any():
        raise refuse(f"scene {name}", "must have reference depth", "none", "Leave it out.")
    info = info_of(sensor, source="diagnosis", licence="-", notes="")
    return SceneModel(
        name=name,
        room=room,
        scene=scene,
        sensor=sensor,
        strata=stratify(
            info.disparity_px(truth_m),
            noiseless(layers, scene, sensor)["left"],
            info,
            body=layers.left.body,
            projector=projector_tangents(truth_m, sensor),
        ),
        real=real,
        frames=frames,
        against=None,
        estimates=estimates,
        nuisances=fitted or {},
        _layers=layers,
        _memory=Memory(_pair_count(real, None)),
        _last={},
        _bases={},
    )


def _pair_count(real: SceneObservation, against: SceneObservation | None) -> int:
    """Count the captured pairs whose matching costs are cached."""
    return sum(len(item.left) for item in (real, against) if isinstance(item, StereoObservation))
