"""Where the captures of a set's cases come from."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol.case import Case
from starling.diagnosis.validation.protocol.limits import Limits


class Source(Protocol):
    """Makes captures of cases, of one set of scenes."""

    @property
    def folder(self) -> Path:
        """Where what its captures need lies."""
        ...

    @property
    def sensor(self) -> Path:
        """What the camera is believed to be."""
        ...

    @property
    def camera(self) -> Nominal:
        """The same in this package's words."""
        ...

    @property
    def against(self) -> Path | None:
        """Capture set that the cases are diagnosed against; None: against simulation."""
        ...

    @property
    def cache(self) -> Path:
        """Where the diagnosis keeps what effects do to the scenes."""
        ...

    @property
    def effects(self) -> frozenset[str]:
        """Names of those that its captures can have."""
        ...

    @property
    def upwards(self) -> frozenset[str]:
        """Names of those of which the camera can only be given more."""
        ...

    def prepare(self) -> None:
        """Make what all cases need, if it is not there."""
        ...

    def limits(self) -> Limits:
        """How strong effects have to be to be found, told before any case is drawn."""
        ...

    def take(self, cases: Sequence[Case], out: Path) -> None:
        """Write captures of cases to `out/NAME`, each as `Case.name` says."""
        ...
