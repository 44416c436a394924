"""Captures of rendered light: by this package's camera, with depth of a matcher."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from starling.diagnosis.validation.camera import device, nominal
from starling.diagnosis.validation.camera.catalogue import ROWS
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol import limits, programs, seal, shoot
from starling.diagnosis.validation.protocol.case import Case
from starling.diagnosis.validation.protocol.limits import Limits
from starling.diagnosis.validation.protocol.tier import Tier


@dataclass(frozen=True, kw_only=True, slots=True)
class Rendered:
    """Builtin scenes of one set, and their light. See `source.Source`."""

    folder: Path
    number: int
    tier: Tier
    blender: Path  # Python with `bpy`, for light by Cycles.

    @property
    def light(self) -> Path:
        """Folder of linear light."""
        return self.folder / "light"

    @property
    def sensor(self) -> Path:
        """What the camera is believed to be."""
        return self._starlings / programs.SENSOR

    @property
    def camera(self) -> Nominal:
        """The same in this package's words."""
        return nominal.read(self.light / nominal.FILE)

    @property
    def against(self) -> None:
        """None: simulation."""
        return

    @property
    def cache(self) -> Path:
        """One for the set, whose scenes are its own."""
        return self.folder / "cache"

    @property
    def effects(self) -> frozenset[str]:
        """All of the table."""
        return frozenset(ROWS)

    @property
    def upwards(self) -> frozenset[str]:
        """None."""
        return frozenset()

    @property
    def _starlings(self) -> Path:
        cycles = self.tier.source == "cycles"
        return self.folder / "light by Starling" if cycles else self.light

    def prepare(self) -> None:
        """Make the light, if it is not there.

        Raises:
            WithheldError: if a renderer fails, or light that is there is of other scenes or code.
        """
        names, size = self.tier.names(self.number), (self.tier.width, self.tier.height)
        of = {"by": self.tier.source, "scenes": names, "size": size}
        there = self._starlings.exists()
        seal.made(self.folder, of, there=there)
        if not there:
            programs.light(self._starlings, names, *size)
        if self._starlings != self.light:
            programs.cycles(self._starlings, self.light, self.blender)

    def limits(self) -> Limits:
        """Those of this package's camera.

        Raises:
            WithheldError: if they cannot be read, or are not told of every effect.
        """
        return limits.read(of=self.effects)

    def take(self, cases: Sequence[Case], out: Path) -> None:
        """Take infrared pairs of cases, and depth.

        Raises:
            WithheldError: if a program fails or a case cannot be taken.
        """
        camera = self.camera
        for one in cases:
            shoot.shoot(self.light, one, out / one.name, frames=self.tier.frames)
            if self.tier.measures(one.number):
                device.measure(out / one.name, camera)
        if self.tier.matcher == "starling":
            programs.depth(out, self.sensor)
        for one in cases:
            shoot.post(out / one.name, one, camera)
