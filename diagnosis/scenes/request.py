"""Request for one observation of a scene, simulated or measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from starling.sim.effects.effect import Value


class Source(Enum):
    """Source of an observation."""

    INFRARED = "infrared"  # Simulated pairs; effects transferred onto reference pairs if captured.
    DEPTH = "depth"  # Simulated device depth; the device's matcher reads all bits.
    BOTH = "both"  # Simulated pairs and device depth.
    REMATCHED = "rematched"  # Captured pairs, matched by our matcher with effects.
    REEXPOSED = "reexposed"  # Reference pairs with the temporal noise of one more exposure.
    CAPTURED = "captured"  # Capture under diagnosis.
    REFERENCE = "reference"  # Capture that it is compared with.


_SIMULATED = {Source.INFRARED, Source.DEPTH, Source.BOTH}
_CAPTURED = {Source.REEXPOSED, Source.CAPTURED, Source.REFERENCE}


@dataclass(frozen=True, kw_only=True, slots=True)
class Request:
    """What to simulate or measure of a scene; equal requests give equal observations."""

    source: Source
    effects: tuple[tuple[str, Value], ...] = ()  # Value by effect, in the order of the names.
    seed: int = 0  # Seed of the noise.
    device: int = 0  # Number of another device of the same kind; 0: the captured one.
    estimate: int = 0  # Number of an alternative estimate of the scene; 0: the likely scene.

    def __post_init__(self) -> None:
        """Refuse what a source cannot have."""
        if self.source in _CAPTURED and self.effects:
            raise ValueError(f"{self.source} has no effects")
        if self.source not in _SIMULATED and (self.device or self.estimate):
            raise ValueError(f"{self.source} has no other device or estimate")

    @property
    def settings(self) -> dict[str, Value]:
        """Value by effect, as `starling.sim.effects.setting.apply` takes them."""
        return dict(self.effects)


def simulation(
    source: Source, settings: Mapping[str, Value], *, seed: int = 0, device: int = 0
) -> Request:
    """Request a simulation with effects.

    Args:
        source: simulated images or depth, or captured images that are matched again.
        settings: value by effect.
        seed: seed of the noise; equal seeds give equal noise.
        device: number of another device, with other fixed patterns and faulty dots.
    """
    effects = tuple(sorted(settings.items()))
    return Request(source=source, effects=effects, seed=seed, device=device)


CAPTURED = Request(source=Source.CAPTURED)
REFERENCE = Request(source=Source.REFERENCE)
