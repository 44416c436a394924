"""Skylight reflected by coated and metal surfaces, tabulated over the viewing angle.

A sky of radiance (1 + g w . up) / pi in direction w has an irradiance of 1 W m^-2. A surface of
BRDF f reflects the radiance (A + g up . V) / pi, with A = int f cos dw and V = int f cos w dw over
the directions w of incoming light. A diffuse surface of reflectance R has A = R and V = 2/3 R n.
Metal reflects the sky around the mirror direction, most at grazing angles. So does a coat, which
transmits the remaining light to a diffuse base.

The microfacet model is that of `starling.sim.render.bsdf`: GGX with Smith shadowing. Multiple
scattering between facets is ignored. A, the component of V along the normal n, and its component
along the mirror direction are linear in R.

Source: Walter et al., Microfacet Models for Refraction, EGSR 2007, eqs. 20, 33, 34; Schlick, An
inexpensive BRDF model, 1994, eq. 15; Saunderson, J. Opt. Soc. Am. 32 (1942), eq. 2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.sim.render import backend, bsdf
from starling.sim.scene.scene import Body, Finish

_NODES = 33  # Number of cosines of the viewing angle, even from 0 to 1.
_COLUMNS = 6  # A, V along n, V along the mirror direction: each at R = 0, and its slope over R.
MATT_TILT = 2 / 3  # V . n / A of a diffuse surface.

_GRID = 64  # Number of slopes, and of azimuths, of the microfacets.
_LEAST_COSINE = 1e-2  # Lower limit of the viewing cosine.
_ALL = 1.0  # Upper limit of A; the base under a coat cannot reach reflectances near 1.

Table = NDArray[np.float64]  # (_NODES, _COLUMNS)


def body_table(body: Body, finish: Finish) -> Table | None:
    """Table of A and V of a body; None for diffuse bodies, mirrors and glass."""
    if not bsdf.is_shiny(body, finish):
        return None
    material_table = {"glossy": _coated, "metal": _metal}.get(body.material.kind)
    table = _matt() if material_table is None else material_table(body.material.roughness)
    if not bsdf.finish_applies(body, finish):
        return table
    for share, finish_table in ((finish.gloss, _coated), (finish.metal, _metal)):
        if share:
            table = (1 - share) * table + share * finish_table(finish.roughness)
    return table


def interpolate(
    table: Table, cosine: NDArray[np.floating], albedo: NDArray[np.floating]
) -> NDArray[np.float64]:
    """A, V along the normal, and V along the mirror direction (3, ...) at points of one body.

    Args:
        table: Table of the body.
        cosine: Cosine of the viewing angle, 0..1.
        albedo: Reflectance R.
    """
    nodes = np.linspace(0, 1, _NODES)
    columns = [np.interp(cosine, nodes, column) for column in table.T]
    even, along, across = (columns[n] + columns[n + 1] * albedo for n in range(0, _COLUMNS, 2))
    return np.stack([np.minimum(even, _ALL), along, across])


def _matt() -> Table:
    table = np.zeros((_NODES, _COLUMNS))
    table[:, 1], table[:, 3] = 1.0, MATT_TILT
    return table


@lru_cache(maxsize=64)
def _metal(alpha: float) -> Table:
    """Table of a metal; reflectance rises from R to 1 at grazing angles (Schlick)."""
    table = np.empty((_NODES, _COLUMNS))
    for row, lobe in zip(table, _lobes(alpha), strict=True):
        grazing = (1 - lobe.cosine) ** 5
        row[0::2] = lobe.integrate(grazing)
        row[1::2] = lobe.integrate(1 - grazing)
    return table


@lru_cache(maxsize=64)
def _coated(alpha: float) -> Table:
    """Table of a coat over a diffuse base, with reflectance R at normal incidence.

    If R is below the coat's own reflectance (see `bsdf.base_albedo`), A falls below the physical
    limit.
    """
    lobes = _lobes(alpha)
    specular = np.stack([lobe.integrate(_fresnel(lobe.cosine, bsdf.IOR)) for lobe in lobes])
    through = 1 - specular[:, 0] / np.array([lobe.integrate(1.0)[0] for lobe in lobes])
    cosine = np.linspace(0, 1, _NODES)
    tilt = float((through * cosine**2).sum() / (through * cosine).sum())
    share = through / through[-1]
    base = np.stack([share, share * tilt, np.zeros(_NODES)], axis=1)
    table = np.empty((_NODES, _COLUMNS))
    table[:, 0::2] = specular - base * specular[-1, 0]
    table[:, 1::2] = base
    return table


@dataclass(frozen=True, slots=True, eq=False)
class _Lobe:
    """Importance-sampled microfacets that reflect light to the viewer."""

    cosine: NDArray[np.float64]  # Cosine between viewer and facet normal.
    weight: NDArray[np.float64]  # Weight of each facet as a perfect mirror.
    along: NDArray[np.float64]  # Direction of the incoming light: component along n.
    across: NDArray[np.float64]  # Component along the mirror direction of the viewer.

    def integrate(self, share: NDArray[np.float64] | float) -> NDArray[np.float64]:
        """A and both components of V for facets of the given reflectance."""
        light = self.weight * share
        return np.array([light.mean(), (light * self.along).mean(), (light * self.across).mean()])


def _lobes(alpha: float) -> tuple[_Lobe, ...]:
    place = (np.arange(_GRID) + 0.5) / _GRID
    drawn, azimuth = np.meshgrid(place, np.pi * place)  # The other half is symmetric.
    tangent2 = alpha**2 * drawn / (1 - drawn)  # Sampling by D cos, eq. 35.
    up = 1 / np.sqrt(1 + tangent2)
    forth = np.sqrt(1 - up**2) * np.cos(azimuth)
    return tuple(
        _lobe(max(float(cosine), _LEAST_COSINE), alpha, up, forth)
        for cosine in np.linspace(0, 1, _NODES)
    )


def _lobe(
    viewer: float, alpha: float, up: NDArray[np.float64], forth: NDArray[np.float64]
) -> _Lobe:
    """Facets that reflect light to a viewer in the plane of x and z.

    f cos = F D G / (4 cos_o), and the solid angle of w is 4 (o . h) times the facet's.
    """
    aside = np.sqrt(1 - viewer**2)
    cosine = viewer * up + aside * forth
    along, across = 2 * cosine * up - viewer, aside - 2 * cosine * forth
    visible = (cosine > 0) & (along > 0)
    shadowed = _smith(viewer, alpha) * _smith(np.maximum(along, 1e-9), alpha)
    weight = np.where(visible, shadowed * cosine / (viewer * up), 0.0)
    return _Lobe(np.clip(cosine, 0, 1), weight, along, across)


def _smith(cosine: NDArray[np.float64] | float, alpha: float) -> NDArray[np.float64]:
    """Smith's share of visible facets for incoming or outgoing light, eq. 34."""
    tangent2 = 1 / np.square(cosine) - 1
    return 2 / (1 + np.sqrt(1 + alpha**2 * tangent2))


def _fresnel(cosine: NDArray[np.float64], ior: float) -> NDArray[np.float64]:
    """Fresnel reflectance of a dielectric for unpolarised light, eq. 22."""
    g = np.sqrt(ior**2 - 1 + cosine**2)
    first = ((g - cosine) / (g + cosine)) ** 2
    return 0.5 * first * (1 + ((cosine * (g + cosine) - 1) / (cosine * (g - cosine) + 1)) ** 2)


class Skylight:
    """Tables of reflected skylight of all shapes of a scene, for kernels."""

    def __init__(self, tables: Sequence[Table | None], handles: Sequence[int]) -> None:
        """Arrange tables by shape handle.

        Args:
            tables: Table of each shape, None for diffuse shapes.
            handles: Handles of the shapes in kernels.
        """
        mi = backend.mitsuba()
        rows = np.tile(_matt().astype(np.float32), (max(handles) + 1, 1, 1))
        for handle, table in zip(handles, tables, strict=True):
            if table is not None:
                rows[handle] = table
        self._rows = mi.Float(rows.ravel())

    def reflected(self, handle: Any, cosine: Any, albedo: Any, opaque: Any) -> tuple[Any, Any, Any]:
        """A, V along the normal, and V along the mirror direction.

        Args:
            handle: UInt32 handles of the visible shapes.
            cosine: Cosine of the viewing angle, 0..1.
            albedo: Reflectance R times `opaque`.
            opaque: Share of light that does not pass straight through.
        """
        mi, dr = backend.mitsuba(), backend.drjit()
        place = dr.clip(cosine, 0, 1) * (_NODES - 1)
        below = dr.minimum(mi.UInt32(place), _NODES - 2)
        share = place - mi.Float(below)
        first = (handle * _NODES + below) * _COLUMNS

        def column(number: int) -> Any:
            low, high = (
                dr.gather(mi.Float, self._rows, first + number + step) for step in (0, _COLUMNS)
            )
            return low + share * (high - low)

        even, along, across = (
            column(2 * part) * opaque + column(2 * part + 1) * albedo for part in range(3)
        )
        return dr.minimum(even, _ALL), along, across
