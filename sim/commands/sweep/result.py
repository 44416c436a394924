"""Result of a sweep."""

from __future__ import annotations

from dataclasses import dataclass

from starling.sim.commands.sweep import axes
from starling.sim.commands.sweep.axes import Camera
from starling.sim.commands.sweep.figures import Figures, law_m


@dataclass(frozen=True, kw_only=True, slots=True)
class Sweep:
    """Figures of every camera at every distance."""

    cameras: tuple[Camera, ...]  # The base comes first.
    distances_m: tuple[float, ...]  # Ascending.
    figures: tuple[tuple[Figures, ...], ...]  # By camera, then by distance.
    reference: int  # Index of the distance at which the law's disparity noise is measured.

    @property
    def sigma_d_px(self) -> float:
        """Disparity noise of the law [px]: the base camera's, at the reference distance."""
        return self.figures[0][self.reference].noise_px

    def name(self, camera: Camera) -> str:
        """Name of a camera: its differences from the base."""
        return axes.name_of(camera, self.cameras[0])

    def law_m(self, camera: Camera) -> list[float]:
        """Depth noise [m] at every distance, by the law z^2 / (f b) sigma_d."""
        sigma = self.sigma_d_px
        return [law_m(camera.sensor, z, sigma) for z in self.distances_m]

    def figures_of(self, camera: Camera) -> tuple[Figures, ...]:
        """Return the figures of one camera at every distance."""
        return self.figures[self.cameras.index(camera)]
