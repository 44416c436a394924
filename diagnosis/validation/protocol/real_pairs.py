"""Captures of a real camera with effects injected into their infrared pairs.

The reference of a case is the same pair without an effect. There is one real capture per scene, and
an identical copy would not measure false positives. Both sides therefore get the noise of one more
exposure by the photon transfer law, drawn independently. They then differ as two exposures of the
same camera and scene do. This measures false positives due to noise, but not those due to other
changes between captures, such as light, temperature or a moved tripod. Both sides are noisier than
the camera by a factor of sqrt(2), and the real noise is common to both.

The depth of the device does not change with the injected effects, so captures hold infrared only.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from starling.diagnosis.validation.camera import inject, nominal
from starling.diagnosis.validation.camera.catalogue import ROWS
from starling.diagnosis.validation.camera.errors import WithheldError, refusal
from starling.diagnosis.validation.camera.imager import Codes
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol import files, limits, programs, seal
from starling.diagnosis.validation.protocol.case import Case
from starling.diagnosis.validation.protocol.limits import DetectionLimits
from starling.sim.captures import capture
from starling.sim.captures.capture import CapturedScene

# Seed of the random choice of scenes, before the set number. Earlier checks used 0x5EA1_0F_4EA1 to
# 0x5EA1_0F_4EA5.
_SCENE_SEED = 0x5EA1_0F_4EA6
_WITHOUT = 0  # Seed of the pairs without effects; a scene has the same pair in all sets.


@dataclass(frozen=True, kw_only=True, slots=True)
class RealPairs:
    """Scenes of one set, drawn with a seed of its number: a source of captures of cases."""

    upwards: ClassVar[frozenset[str]] = inject.INCREASE_ONLY  # These cannot be removed.

    folder: Path
    number: int  # Number of the scene set.
    scenes: int  # Number of scenes.
    captures: Path
    believed: str  # Sensor file or preset of the camera of the captures.
    mode: str = ""  # Mode of that camera; empty is the sensor's own.

    @property
    def sensor(self) -> Path:
        """Sensor file of the nominal camera with the geometry of the captures."""
        return self.folder / "camera" / programs.SENSOR

    @property
    def camera(self) -> Nominal:
        """The nominal camera, for this package."""
        return nominal.read(self._nominal)

    @property
    def against(self) -> Path:
        """The pairs without effects."""
        return self.folder / "without effects"

    @property
    def cache(self) -> Path:
        """Cache of all sets, because sets share scenes."""
        return self.folder.parent / "cache"

    @property
    def effects(self) -> frozenset[str]:
        """Injectable effects, except those of the camera itself whose strength is not known.

        The strength is known for effects whose neutral is a setting of the camera. Effects that
        automatic exposure compensates are excluded too, because an exposed image cannot show them.
        """
        measured = {row.name for row in ROWS.values() if isinstance(row.neutral, str)}
        existing = nominal.read_existing_effects(self._nominal)
        compensated = inject.LEVELS if "auto_exposure" in existing else frozenset()
        return inject.EFFECTS - (existing - measured) - compensated

    @property
    def _nominal(self) -> Path:
        return self.folder / "camera" / nominal.FILE

    def prepare(self) -> None:
        """Write the camera and the pairs without effects if they do not exist.

        Raises:
            WithheldError: if there are too few scenes, or a scene has no valid infrared pair. Also
                if existing files are of other captures, another sensor or other code.
        """
        exists = self.against.exists()
        inputs = {
            "captures": seal.path_digest(self.captures),
            "sensor": seal.sensor_digest(Path(self.believed)),
            **({"mode": self.mode} if self.mode else {}),
        }
        seal.record_inputs(self.folder, inputs, exists=exists)
        if not exists:
            shutil.rmtree(self._nominal.parent, ignore_errors=True)
            flags = {
                **{"--captures": self.captures, "--sensor": self.believed},
                "--mode": self.mode or None,
            }
            programs.run("captured_camera", self._nominal.parent, flags=flags)
            part = self.folder / ".part"
            shutil.rmtree(part, ignore_errors=True)
            self._write({}, _WITHOUT, part)
            part.rename(self.against)

    def limits(self) -> DetectionLimits:
        """Measure or read the detection limits of effects in these scenes.

        The limits come from a set without cases. Its scenes may also be in other sets, because
        there are few captures.

        Raises:
            WithheldError: as for `prepare`, or if the diagnosis fails or lacks an effect, or
                another run uses the folder.
        """
        path = self.folder / "limits.json"
        with files.exclusive(self.folder):
            if not path.exists():
                self.prepare()
                known = sorted(name for name in self.effects if ROWS[name].kind != "outside")
                flags = {
                    **{"--sensor": self.sensor, "--cache": self.cache, "--out": path},
                    **{"--against-itself": (), "--effects": tuple(known)},
                }
                programs.run("detection", self.against, flags=flags)
        return limits.read(path, required=self.effects)

    def write_captures(self, cases: Sequence[Case], out: Path) -> None:
        """Write the pairs with the effects of each case.

        Raises:
            WithheldError: if the captures cannot be read, or an effect cannot be injected.
        """
        for case in cases:
            self._write(case.settings, case.seed, out / case.name)

    def _write(self, settings: Mapping[str, float], seed: int, out: Path) -> None:
        camera = self.camera
        files.copy(self.captures, out, ("capture.toml",))
        for scene in draw_scenes(_scenes(self.captures), self.scenes, self.number):
            known = tuple(path.name for path in scene.path.iterdir() if path.is_file())
            files.copy(scene.path, out / scene.name, known)
            pair = inject.inject(
                *_pair(scene), settings, camera, seed=seed, scene=scene.name, exposed_again=True
            )
            files.write_image(out / scene.name / "0" / "ir_left.png", pair.left)
            files.write_image(out / scene.name / "0" / "ir_right.png", pair.right)


@contextmanager
def _input_errors() -> Iterator[None]:
    """Convert errors of the capture reader to errors of this package."""
    try:
        yield
    except capture.errors.InputError as error:
        raise WithheldError(str(error)) from error


def _scenes(captures: Path) -> Sequence[CapturedScene]:
    with _input_errors():
        return capture.open_set(captures).scenes


def _pair(scene: CapturedScene) -> tuple[Codes, Codes]:
    """Return the first infrared pair of a scene."""
    with _input_errors():
        frame = scene.frame(scene.frames[0])
    if frame.ir_left is None or frame.ir_right is None:
        name = f"scene {scene.name}"
        raise refusal(name, "must hold an infrared pair", scene.path, "Leave it out.")
    return frame.ir_left, frame.ir_right


def draw_scenes(scenes: Sequence[CapturedScene], count: int, number: int) -> list[CapturedScene]:
    """Draw scenes at random. No room repeats before all rooms have been drawn.

    Args:
        scenes: Scenes of a capture set.
        count: Number of scenes to draw.
        number: Number of the scene set, which seeds the draw.

    Returns:
        The scenes, sorted by name.

    Raises:
        WithheldError: if there are too few scenes.
    """
    if len(scenes) < count:
        raise refusal("captures", f"must hold {count} scenes", len(scenes), "Take more.")
    rng = np.random.Generator(np.random.SFC64([_SCENE_SEED, number]))
    shuffled = [scenes[i] for i in rng.permutation(len(scenes))]
    rooms: dict[str, list[CapturedScene]] = {}
    for scene in shuffled:
        rooms.setdefault(scene.room, []).append(scene)
    turn = {scene.name: i for room in rooms.values() for i, scene in enumerate(room)}
    drawn = sorted(shuffled, key=lambda scene: turn[scene.name])[:count]
    return sorted(drawn, key=lambda scene: scene.name)
