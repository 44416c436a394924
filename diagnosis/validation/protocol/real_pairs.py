"""Captures of a real camera, into whose infrared pairs effects are put.

Cases are diagnosed against the same pairs without an effect. A real scene is captured once, and a
copy that differs by nothing would tell nothing of false alarms. So both get the noise of one more
exposure, each its own, as photon transfer has it: two captures of the very same camera and scene
then differ by noise as two readings do, and by nothing else. That shows alarms at noise. It cannot
show alarms at what changes between two real captures otherwise: light, warmth, a touched tripod.
Both sides are noisier than the camera, by the root of two, and the real noise is common to them.

The device's own depth does not follow what is done to an image, so captures hold infrared alone.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from starling.diagnosis.validation.camera import inject, nominal
from starling.diagnosis.validation.camera.catalogue import ROWS
from starling.diagnosis.validation.camera.errors import WithheldError, refusal
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.camera.readout import Codes
from starling.diagnosis.validation.protocol import capture_files, limits, lock, programs, seal
from starling.diagnosis.validation.protocol.case import Case
from starling.diagnosis.validation.protocol.limits import Limits
from starling.sim.captures import capture
from starling.sim.captures.capture import CapturedScene

# Where the lot of scenes starts, before the set's number; 0x5EA1_0F_4EA1 to 4EA5 were opened.
_LOT = 0x5EA1_0F_4EA6
_WITHOUT = 0  # Seed of the pairs without effects: a scene's are the same in all sets.


@dataclass(frozen=True, kw_only=True, slots=True)
class RealPairs:
    """Scenes of one set, drawn by a lot that is fixed by its number. See `source.Source`."""

    folder: Path
    number: int
    scenes: int
    captures: Path
    believed: str  # Sensor file or preset of the captures' camera.

    @property
    def sensor(self) -> Path:
        """What the camera is believed to be, with the captures' geometry."""
        return self.folder / "camera" / programs.SENSOR

    @property
    def camera(self) -> Nominal:
        """The same in this package's words."""
        return nominal.read(self._nominal)

    @property
    def against(self) -> Path:
        """The pairs without effects."""
        return self.folder / "without effects"

    @property
    def cache(self) -> Path:
        """One for all sets, as scenes are of several."""
        return self.folder.parent / "cache"

    @property
    def effects(self) -> frozenset[str]:
        """Those that can be put into an image, but for what the camera has of them already.

        How much a camera has is told of those alone whose neutral is one of its settings. What an
        automatic exposure makes up for, an image that is exposed already cannot show.
        """
        told = {row.name for row in ROWS.values() if isinstance(row.neutral, str)}
        has = nominal.has(self._nominal)
        made_up = inject.LEVELS if "auto_exposure" in has else frozenset()
        return inject.EFFECTS - (has - told) - made_up

    @property
    def upwards(self) -> frozenset[str]:
        """Those that cannot be taken out of an image."""
        return inject.UPWARDS

    @property
    def _nominal(self) -> Path:
        return self.folder / "camera" / nominal.FILE

    def prepare(self) -> None:
        """Write the camera and the pairs without effects, if they are not there.

        Raises:
            WithheldError: if there are too few scenes, one is damaged or lacks an infrared pair, or
                what is there is of other captures, another sensor or code.
        """
        there = self.against.exists()
        of = {
            "captures": seal.content(self.captures),
            "sensor": seal.of_sensor(Path(self.believed)),
        }
        seal.made(self.folder, of, there=there)
        if not there:
            shutil.rmtree(self._nominal.parent, ignore_errors=True)
            programs.camera(self._nominal.parent, self.captures, self.believed)
            part = self.folder / ".part"
            shutil.rmtree(part, ignore_errors=True)
            self._write({}, _WITHOUT, part)
            part.rename(self.against)

    def limits(self) -> Limits:
        """Tell what is found of effects in these scenes.

        No case may be of this set then. Single scenes of it may be in others, as captures are few.

        Raises:
            WithheldError: as `prepare`, or if the diagnosis fails or says nothing of an effect, or
                another run works here.
        """
        path = self.folder / "limits.json"
        with lock.alone(self.folder):
            if not path.exists():
                self.prepare()
                known = sorted(name for name in self.effects if ROWS[name].kind != "outside")
                programs.limits(path, self.against, self.sensor, self.cache, known)
        return limits.read(path, of=self.effects)

    def take(self, cases: Sequence[Case], out: Path) -> None:
        """Put the effects of cases into the pairs.

        Raises:
            WithheldError: if the captures cannot be read, or a case's effects cannot be put into
                an image.
        """
        for one in cases:
            self._write(one.settings, one.seed, out / one.name)

    def _write(self, settings: Mapping[str, float], seed: int, out: Path) -> None:
        camera = self.camera
        capture_files.copy(self.captures, out, ("capture.toml",))
        for scene in lot(_scenes(self.captures), self.scenes, self.number):
            known = tuple(path.name for path in scene.path.iterdir() if path.is_file())
            capture_files.copy(scene.path, out / scene.name, known)
            left_dn, right_dn = _pair(scene)
            pair = inject.inject(
                left_dn,
                right_dn,
                settings,
                camera,
                seed=seed,
                scene=scene.name,
                exposed_again=True,
            )
            capture_files.write(out / scene.name / "0" / "ir_left.png", pair.left)
            capture_files.write(out / scene.name / "0" / "ir_right.png", pair.right)


@contextmanager
def _refused() -> Iterator[None]:
    """What captures refuse, in this package's way."""
    try:
        yield
    except capture.errors.InputError as error:
        raise WithheldError(str(error)) from error


def _scenes(captures: Path) -> Sequence[CapturedScene]:
    with _refused():
        return capture.open_set(captures).scenes


def _pair(scene: CapturedScene) -> tuple[Codes, Codes]:
    """The first infrared pair of a scene."""
    with _refused():
        frame = scene.frame(scene.frames[0])
    if frame.ir_left is None or frame.ir_right is None:
        name = f"scene {scene.name}"
        raise refusal(name, "must hold an infrared pair", scene.path, "Leave it out.")
    return frame.ir_left, frame.ir_right


def lot(scenes: Sequence[CapturedScene], count: int, number: int) -> list[CapturedScene]:
    """Draw scenes, of as many rooms as there are before any room comes again.

    Args:
        scenes: Of a capture set.
        count: How many are drawn.
        number: Of the set; equal numbers draw alike.

    Returns:
        Scenes by name.

    Raises:
        WithheldError: if there are too few.
    """
    if len(scenes) < count:
        raise refusal("captures", f"must hold {count} scenes", len(scenes), "Take more.")
    rng = np.random.Generator(np.random.SFC64([_LOT, number]))
    shuffled = [scenes[place] for place in rng.permutation(len(scenes))]
    rooms: dict[str, list[CapturedScene]] = {}
    for scene in shuffled:
        rooms.setdefault(scene.room, []).append(scene)
    place = {one.name: turn for of in rooms.values() for turn, one in enumerate(of)}
    drawn = sorted(shuffled, key=lambda one: place[one.name])[:count]
    return sorted(drawn, key=lambda one: one.name)
