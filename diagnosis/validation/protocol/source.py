"""Interface of the sources of captures: rendered light or real pairs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol.case import Case
from starling.diagnosis.validation.protocol.limits import DetectionLimits


class CaptureSource(Protocol):
    """Source of the captures of cases of one scene set."""

    @property
    def folder(self) -> Path:
        """Folder of the inputs of the captures."""
        ...

    @property
    def sensor(self) -> Path:
        """Sensor file of the nominal camera, for the diagnosis."""
        ...

    @property
    def camera(self) -> Nominal:
        """The nominal camera, for this package."""
        ...

    @property
    def against(self) -> Path | None:
        """Reference capture set of the diagnosis; None compares with the simulation."""
        ...

    @property
    def cache(self) -> Path:
        """Folder of the diagnosis' cached simulations."""
        ...

    @property
    def effects(self) -> frozenset[str]:
        """Names of the effects that the captures can have."""
        ...

    @property
    def upwards(self) -> frozenset[str]:
        """Names of the effects whose strength can only increase."""
        ...

    def prepare(self) -> None:
        """Make the inputs of all cases if they do not exist."""
        ...

    def limits(self) -> DetectionLimits:
        """Return the detection limits. They are known before any case is drawn."""
        ...

    def write_captures(self, cases: Sequence[Case], out: Path) -> None:
        """Write the captures of each case to `out/NAME`, where NAME is `Case.name`."""
        ...
