"""A scene under diagnosis: what is known of it, what was captured, and how it is simulated."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.scenes import estimated, projector_frame
from starling.diagnosis.scenes import fit_scene as nuisances
from starling.diagnosis.scenes.estimated import Estimates
from starling.diagnosis.scenes.fit_scene import Nuisances
from starling.diagnosis.scenes.observation import (
    Maps,
    Reading,
    alike,
    as_captured,
    exposed_again,
    matched,
    measured,
    read,
    with_bits,
    written,
)
from starling.diagnosis.scenes.strata import Ground, ground
from starling.diagnosis.transfer import transfer
from starling.diagnosis.transfer.transfer import Exposed, Known, Pair
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
from starling.sim.render.mitsuba_scene import Stage
from starling.sim.scene.scene import Scene
from starling.sim.sensor import edits
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.memory import Memory

# A difference is asked for, and noise is common.
_SAMPLES = 4  # Paths of indirect light,
_STEP_PX = 2.0  # and image motion between the moments of one exposure.
_FINER_BITS = 8  # That codes are simulated with where they are not to be rounded.
_STILL = (  # What an image has beside its scene, at its neutral.
    ("imager.shot_noise", 0.0),
    ("imager.read_noise_e", 0.0),
    ("imager.prnu", 0.0),
    ("imager.dsnu_e", 0.0),
    ("projector.speckle_contrast", 0.0),
)


_Rendered = tuple[int | None, tuple[tuple[str, Value], ...]]  # Faulty dots, and effects.


@dataclass(slots=True, eq=False)
class Subject:
    """One scene; its base is rendered once."""

    name: str
    room: str
    scene: Scene
    sensor: Sensor  # The base, with what was fitted to this scene.
    ground: Ground
    real: Reading
    frames: int  # Of a simulated reading.
    against: Reading | None  # What the real one is compared with; None: with simulated ones.
    estimates: Estimates  # What else the scene may be, as far as its captures tell.
    nuisances: Nuisances  # Fitted to this scene; what effects set departs from them.
    _stage: Stage = field(repr=False)
    _layers: Layers = field(repr=False)
    _memory: Memory = field(repr=False)  # Of the captured pairs' searches.
    # Rendered last with effects set: draws of noise share it, and so do other devices of the kind.
    _last: dict[_Rendered, Layers] = field(default_factory=dict, repr=False)
    # Captured pairs and simulated ones without effects, by seed, for effects to be laid on.
    _known: dict[int, tuple[list[Known], list[Known]]] = field(default_factory=dict, repr=False)

    def simulate(self, settings: Mapping[str, Value], *, seed: int) -> Reading:
        """Simulate the scene with effects set; equal seeds share all noise.

        Beside other captures that is those captures, with what effects do laid onto them.

        Args:
            settings: value by effect's name, as `starling.sim.effects.setting.apply` takes them.
            seed: of noise.
        """
        if self.against is None or self.against.left is None or self.against.right is None:
            sensor, pairs = self._pairs(settings, seed)
            return _put_out(sensor, pairs)
        return self._beside(self.against, settings, seed)

    def measure(self, settings: Mapping[str, Value], *, seed: int) -> Reading:
        """Simulate what a device without infrared gives; its matcher reads all bits that it has."""
        sensor, pairs = self._pairs(settings, seed)
        return Reading(left=None, right=None, ours_px=None, device_px=_measured(sensor, pairs))

    def capture(self, settings: Mapping[str, Value], *, seed: int) -> Reading:
        """Simulate all that a device gives: infrared as it is put out, and its own depth."""
        sensor, pairs = self._pairs(settings, seed)
        return dataclasses.replace(_put_out(sensor, pairs), device_px=_measured(sensor, pairs))

    def like_captured(self, settings: Mapping[str, Value], *, seed: int) -> Reading:
        """Simulate what was captured: infrared where it was, depth of the device's own likewise."""
        if self.real.left is None:
            return self.measure(settings, seed=seed)
        if self.real.device_px is None:
            return self.simulate(settings, seed=seed)
        return self.capture(settings, seed=seed)

    def otherwise(self, number: int) -> Subject:
        """The scene as another of its estimates has it.

        Args:
            number: of the estimate, from 0.
        """
        scene = self.estimates[number]()
        stage = Stage(scene)
        layers = _traced(stage, self.sensor)
        return dataclasses.replace(
            self, scene=scene, _stage=stage, _layers=layers, _last={}, _known={}
        )

    def another(self, number: int) -> Subject:
        """The scene before another device of the kind: other fixed patterns, other faulty dots.

        Args:
            number: of the device, from 1.
        """
        projector = self.sensor.projector
        sensor = dataclasses.replace(
            self.sensor,
            unit=self.sensor.unit + number,
            projector=dataclasses.replace(projector, faults_seed=projector.faults_seed + number),
        )
        layers = self._layers
        if projector.faulty:
            layers = _traced(self._stage, sensor)
        return dataclasses.replace(self, sensor=sensor, _layers=layers, _known={})

    def expose_again(self, *, seed: int) -> Reading:
        """What the captures are compared with, with the noise of one more exposure.

        Args:
            seed: of that noise.
        """
        assert self.against is not None
        rng = np.random.default_rng(self._noise(seed))
        return exposed_again(self.against, self.sensor, rng)

    def rematch(self, settings: Mapping[str, Value]) -> Reading:
        """Match the captured pair again, as it was put out, by a matcher with effects set.

        Args:
            settings: value by effect's name.
        """
        sensor = _on_sensor(self.sensor, tuple(settings.items()))
        pair = self.real
        assert pair.left is not None and pair.right is not None
        maps = matched(pair.left, pair.right, sensor, memory=self._memory)
        return dataclasses.replace(pair, device_px=written(maps, sensor))

    def physics(self, settings: Mapping[str, Value], *, seeds: Sequence[int]) -> Physics:
        """What readings of several seeds say together, for `learning` to build on.

        Their depth is that of `capture` where the device's own was captured, else of `simulate`.
        """
        sensor, scene, layers = self._set(settings)
        if self.real.device_px is None:
            sensor = as_captured(sensor)
        own = map(self._noise, seeds)
        return summary([simulate.expose(layers, scene, sensor, seed=seed) for seed in own], sensor)

    def own(self, settings: Mapping[str, Value]) -> dict[str, Value]:
        """What effects, set from the base that all scenes have in common, set in this one."""
        return nuisances.own(settings, self.nuisances)

    def _noise(self, seed: int) -> int:
        """Seed of a scene's noise, which no simulated capture of that scene shares."""
        return scene_seed(seed, f"diagnosis of {self.name}")

    def _set(self, settings: Mapping[str, Value]) -> tuple[Sensor, Scene, Layers]:
        settings = self.own(settings)
        sensor = _on_sensor(self.sensor, tuple(settings.items()))
        scene = setting.on_scene(self.scene, settings)
        return sensor, scene, self._rendered(scene, sensor, settings)

    def _rendered(self, scene: Scene, sensor: Sensor, settings: Mapping[str, Value]) -> Layers:
        """What is rendered, noise apart: that of the base where no effect changes it."""
        shown = tuple(sorted(settings.items()))
        if scene.motion.still:  # Else all that exposure follows from has a part in it.
            shown = tuple(one for one in shown if named(one[0].partition(".")[0]).rerender)
        if not shown:
            return self._layers
        key = sensor.projector.faults_seed if sensor.projector.faulty else None, shown
        if key not in self._last:
            self._last.clear()
            self._last[key] = _traced(self._stage.of(scene), sensor)
        return self._last[key]

    def _pairs(
        self, settings: Mapping[str, Value], seed: int
    ) -> tuple[Sensor, list[simulate.Pair]]:
        sensor, scene, layers = self._set(settings)
        own = self._noise(seed)
        return sensor, [
            simulate.infrared(layers, scene, sensor, seed=own, frame=frame)
            for frame in range(self.frames)
        ]

    def _beside(self, captured: Reading, settings: Mapping[str, Value], seed: int) -> Reading:
        """Captured pairs with what effects do to simulated ones."""
        if seed not in self._known:
            self._known.clear()
            _, without = self._exact({}, seed)
            self._known[seed] = transfer.known(captured.levels, without)
        sensor, changed = self._exact(settings, seed)
        assert captured.left is not None
        ceiling = max(2**sensor.left.bit_depth - 1, int(captured.left.max()))
        laid = transfer.pairs_laid_on(self._known[seed], changed, ceiling=ceiling)
        codes = np.uint8 if ceiling < 2**8 else np.uint16
        left, right = (np.stack(side).astype(codes) for side in laid)
        ours_px = matched(left[:1], right[:1], sensor)
        return Reading(left=left, right=right, ours_px=ours_px, device_px=None)

    def _exact(self, settings: Mapping[str, Value], seed: int) -> tuple[Sensor, Exposed]:
        """Simulated pairs [DN], with the bits that codes lack."""
        sensor, scene, layers = self._set(settings)
        fine = with_bits(sensor, _FINER_BITS)
        scale = np.float32(2.0 ** (sensor.left.bit_depth - fine.left.matched_bits))

        def taken(by: Sensor, frame: int) -> Pair:
            pair = simulate.infrared(layers, scene, by, seed=self._noise(seed), frame=frame)
            assert pair.matched_right is not None
            return pair.matched_left * scale, pair.matched_right * scale

        still = taken(edits.with_values(fine, _STILL), 0)
        return sensor, Exposed([taken(fine, frame) for frame in range(self.frames)], still)


@lru_cache(maxsize=4)
def _on_sensor(base: Sensor, settings: tuple[tuple[str, Value], ...]) -> Sensor:
    """Set effects; kept, as all scenes are asked for the same ones in turn."""
    return setting.on_sensor(base, dict(settings))


def _traced(stage: Stage, sensor: Sensor) -> Layers:
    return simulate.rendered(stage, sensor, samples=_SAMPLES, step_px=_STEP_PX)


def _put_out(sensor: Sensor, pairs: Sequence[simulate.Pair]) -> Reading:
    left = np.stack([pair.left for pair in pairs])
    right = np.stack([pair.right for pair in pairs if pair.right is not None])
    ours_px = matched(left[:1], right[:1], sensor)
    return Reading(left=left, right=right, ours_px=ours_px, device_px=None)


def _measured(sensor: Sensor, pairs: Sequence[simulate.Pair]) -> Maps:
    left = np.stack([pair.matched_left for pair in pairs])
    right = np.stack([pair.matched_right for pair in pairs if pair.matched_right is not None])
    return written(measured(left, right, sensor), sensor)


def subject(
    captured: CapturedScene,
    sensor: Sensor,
    *,
    against: CapturedScene | None = None,
    fitted: Nuisances | None = None,
) -> Subject:
    """Make a subject of a captured scene.

    Args:
        captured: with reference depth or a `scene.toml`.
        sensor: the base.
        against: the same scene captured by the base, which it is then compared with; what is known
            of the scene is taken from here.
        fitted: nuisances that were fitted to it before; None fits them.

    Raises:
        InputError: if the sensor is of another size, neither geometry nor reference depth is known,
            an image is damaged, nothing was captured that depth could be told from, or both
            captures have nothing in common.
    """
    known_by = captured if against is None else against
    size = known_by.info.shape
    if size != (sensor.height, sensor.width):
        rule = f"must be of the sensor's size, {sensor.height} x {sensor.width}"
        raise refuse(f"scene {captured.name}", rule, size, "Give the sensor of these captures.")
    if fitted is None:
        fitted = nuisances.of_geometry(known_by, sensor)
    known_by, sensor = nuisances.put_right(known_by, fitted), nuisances.on_sensor(sensor, fitted)
    scene, estimates = estimated.scene(known_by, sensor)  # Last: dots tell of light where they lie.
    if estimates:
        fitted = {**fitted, **nuisances.of_light(known_by, scene, sensor)}
    base = read(known_by, sensor)
    made = of_scene(
        scene,
        sensor,
        name=known_by.name,
        room=known_by.room,
        truth_m=known_by.truth_m(),
        real=base,
        frames=base.repeats,
        estimates=estimates,
        fitted=fitted,
    )
    return made if against is None else retaken(made, captured, against=base)


def retaken(of: Subject, captured: CapturedScene, *, against: Reading | None) -> Subject:
    """Take over all that is known of a scene for another capture of it.

    Args:
        of: the scene.
        captured: its other capture.
        against: what that is compared with; None: with simulated readings.

    Raises:
        InputError: as `subject`.
    """
    real = read(captured, of.sensor)
    if against is not None:
        real, against = alike(real, against)
    memory = Memory(_searches(real, against))
    return dataclasses.replace(
        of, real=real, against=against, frames=real.repeats, _memory=memory, _known={}
    )


def of_scene(
    scene: Scene,
    sensor: Sensor,
    *,
    name: str,
    room: str,
    truth_m: NDArray[np.float32] | None,
    real: Reading,
    frames: int,
    estimates: Estimates = (),
    fitted: Nuisances | None = None,
) -> Subject:
    """Make a subject of a scene whatever it comes from.

    Args:
        scene: geometry, materials and light.
        sensor: the base.
        name: of the scene; noise is drawn by it.
        room: scenes of one room are no independent evidence.
        truth_m: (h, w) reference depth; None takes the rendered one.
        real: what was captured.
        frames: repeats of a simulated reading.
        estimates: what else the scene may be, as far as its captures tell.
        fitted: nuisances, which sensor and scene have; None: none.

    Raises:
        InputError: if no depth is known anywhere.
    """
    stage = Stage(scene)
    layers = _traced(stage, sensor)
    if truth_m is None:
        truth_m = layers.truth.depth_m
    if not np.isfinite(truth_m).any():
        raise refuse(f"scene {name}", "must have reference depth", "none", "Leave it out.")
    info = info_of(sensor, source="diagnosis", licence="-", notes="")
    return Subject(
        name=name,
        room=room,
        scene=scene,
        sensor=sensor,
        ground=ground(
            info.disparity_px(truth_m),
            noiseless(layers, scene, sensor)["left"],
            info,
            body=layers.left.body,
            projector=projector_frame.tangents(truth_m, sensor),
        ),
        real=real,
        frames=frames,
        against=None,
        estimates=estimates,
        nuisances=fitted or {},
        _stage=stage,
        _layers=layers,
        _memory=Memory(_searches(real, None)),
    )


def _searches(real: Reading, against: Reading | None) -> int:
    """How many pairs are matched again and again."""
    pairs = (real, against)
    return sum(len(one.left) for one in pairs if one is not None and one.left is not None)
