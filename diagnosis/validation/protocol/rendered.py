"""Captures of rendered light by the second camera, with depth of a matcher."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.validation.camera import matcher, nominal
from starling.diagnosis.validation.camera.catalogue import ROWS
from starling.diagnosis.validation.camera.imperfections import OTHER_MATCHER
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol import files, limits, programs, seal, shoot
from starling.diagnosis.validation.protocol.case import Case
from starling.diagnosis.validation.protocol.limits import DetectionLimits
from starling.diagnosis.validation.protocol.tier import Tier

UNIT_M = 0.001  # Unit of the depth files of the second matcher [m].
_PAIR = ("ir_left.png", "ir_right.png")


@dataclass(frozen=True, kw_only=True, slots=True)
class Rendered:
    """Builtin scenes of one set, and their light: a source of captures of cases."""

    against: ClassVar[None] = None  # The reference is the simulation.
    effects: ClassVar[frozenset[str]] = frozenset(ROWS)  # Effects that the captures can have.
    upwards: ClassVar[frozenset[str]] = frozenset()  # A rendered camera can have all strengths.

    folder: Path
    number: int  # Number of the scene set.
    tier: Tier
    blender: Path  # Python interpreter with `bpy`, for light by Cycles.

    @property
    def light(self) -> Path:
        """Folder of linear light."""
        return self.folder / "light"

    @property
    def sensor(self) -> Path:
        """Sensor file of the nominal camera, for the diagnosis."""
        return self._starling_light / programs.SENSOR

    @property
    def camera(self) -> Nominal:
        """The nominal camera, for this package."""
        return nominal.read(self.light / nominal.FILE)

    @property
    def cache(self) -> Path:
        """Cache of this scene set, which shares no scenes with other sets."""
        return self.folder / "cache"

    @property
    def _starling_light(self) -> Path:
        cycles = self.tier.source == "cycles"
        return self.folder / "light by Starling" if cycles else self.light

    def prepare(self) -> None:
        """Render the light if it does not exist.

        Raises:
            WithheldError: if a renderer fails, or existing light is of other scenes or code.
        """
        names, size = self.tier.scene_names(self.number), (self.tier.width, self.tier.height)
        inputs = {"by": self.tier.source, "scenes": names, "size": size}
        exists = self._starling_light.exists()
        seal.record_inputs(self.folder, inputs, exists=exists)
        if not exists:
            flags = {"--width": size[0], "--height": size[1]}
            programs.run("light_sets", self._starling_light, *names, flags=flags)
        if self._starling_light != self.light:
            flags = {"--blender": self.blender}
            programs.run("cycles_light", self._starling_light, self.light, flags=flags)

    def limits(self) -> DetectionLimits:
        """Return the detection limits of this package's camera.

        Raises:
            WithheldError: if they cannot be read, or lack an effect.
        """
        perfect = limits.read(required=self.effects)
        if not self.tier.imperfect:
            return perfect
        return perfect.and_limits(limits.read(limits.IMPERFECT_FILE))

    def write_captures(self, cases: Sequence[Case], out: Path) -> None:
        """Write infrared pairs and depth of cases.

        Raises:
            WithheldError: if a program fails or a case cannot be captured.
        """
        camera = self.camera
        for case in cases:
            shoot.shoot(self.light, case, out / case.name, frames=self.tier.frames)
            foreign = case.imperfections.get(OTHER_MATCHER, 0.0) > 0.0
            if foreign or self.tier.has_own_depth(case.number):
                match_captures(out / case.name, camera)
        if self.tier.matcher == "starling":
            programs.run("own_depth", out, flags={"--sensor": self.sensor})
        for case in cases:
            shoot.postprocess(out / case.name, case, camera)


def match_captures(captures: Path, camera: Nominal) -> None:
    """Match every infrared pair of a capture set with the second matcher and write `depth.png`.

    Args:
        captures: Folder of the capture set.
        camera: Its nominal camera.

    Raises:
        WithheldError: if a pair cannot be matched.
    """
    for left in sorted(captures.glob("*/*/ir_left.png")):
        ir_left, ir_right = (_read_image(left.with_name(name)) for name in _PAIR)
        depth_m = matcher.depth(ir_left, ir_right, camera)
        files.write_depth(left.with_name("depth.png"), depth_m, UNIT_M)


def _read_image(path: Path) -> NDArray[np.uint8] | NDArray[np.uint16]:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None  # `shoot` wrote this file.
    return image.astype(np.uint8) if image.dtype == np.uint8 else image.astype(np.uint16)
