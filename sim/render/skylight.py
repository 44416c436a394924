"""What coated and metal surfaces return of an open sky, over the angle they are seen at.

A sky of radiance (1 + g w . up) / pi in direction w lays 1 W m^-2 on a surface that faces its
middle. A surface of BRDF f sends (A + g up . V) / pi of it to the viewer, with A = int f cos dw and
V = int f cos w dw over the directions w that light comes from. Matt ones return their reflectance
R alike to all sides: A = R, V = 2/3 R n. Metal mirrors the part of the sky that is there, most at
grazing angles; so does a coat, which lets the rest through to a matt ground.

Microfacets are GGX's, their shadowing Smith's, as `starling.sim.render.bsdf` has them of Mitsuba; light that is
scattered between them is lost. Each of A, V along the normal n, and V along the way that a mirror
sends the viewer's ray is linear in R.

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

from starling.sim.render import backend, bsdf, coat
from starling.sim.scene.scene import Body, Finish

_NODES = 33  # Cosines of the viewing angle, even from 0 to 1.
_COLUMNS = 6  # A, V along n, V along the mirrored way: each at R = 0, and its slope over R.
MATT_TILT = 2 / 3  # V . n / A of a matt surface.

_GRID = 64  # Slopes, and azimuths, of the microfacets that are summed over.
_LEAST_COSINE = 1e-2  # In place of a surface seen from its side.
_ALL = 1.0  # No ground under a coat is as bright as a reflectance near 1 would ask for.

Table = NDArray[np.float64]  # (_NODES, _COLUMNS)


def of(body: Body, finish: Finish) -> Table | None:
    """What a body returns by `(A, V)`; None of one that is matt all over, or a mirror, or glass."""
    if not bsdf.mirrors(body, finish):
        return None
    own = {"glossy": _coated, "metal": _metal}.get(body.material.kind)
    table = _matt() if own is None else own(body.material.roughness)
    if not bsdf.changes(body, finish):
        return table
    for share, laid in ((finish.gloss, _coated), (finish.metal, _metal)):
        if share:
            table = (1 - share) * table + share * laid(finish.roughness)
    return table


def looked_up(
    table: Table, cosine: NDArray[np.floating], albedo: NDArray[np.floating]
) -> NDArray[np.float64]:
    """A, and V along the normal and along the mirrored way (3, ...), of points of one body.

    Args:
        table: the body's.
        cosine: of the viewing angle, 0..1.
        albedo: reflectance R.
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
    """Fresnel's share rises from R at normal incidence to 1 at grazing, by Schlick's law."""
    table = np.empty((_NODES, _COLUMNS))
    for row, lobe in zip(table, _lobes(alpha), strict=True):
        rising = (1 - lobe.cosine) ** 5
        row[0::2] = lobe.gathered(rising)
        row[1::2] = lobe.gathered(1 - rising)
    return table


@lru_cache(maxsize=64)
def _coated(alpha: float) -> Table:
    """A coat, and what of the ground's light comes through it; R holds along the normal.

    Under a reflectance that no ground makes so dark (`coat.beneath`) it would be below black.
    """
    lobes = _lobes(alpha)
    thrown = np.stack([one.gathered(_fresnel(one.cosine, coat.IOR)) for one in lobes])
    through = 1 - thrown[:, 0] / np.array([one.gathered(1.0)[0] for one in lobes])
    cosine = np.linspace(0, 1, _NODES)
    tilt = float((through * cosine**2).sum() / (through * cosine).sum())
    share = through / through[-1]
    ground = np.stack([share, share * tilt, np.zeros(_NODES)], axis=1)
    table = np.empty((_NODES, _COLUMNS))
    table[:, 0::2] = thrown - ground * thrown[-1, 0]
    table[:, 1::2] = ground
    return table


@dataclass(frozen=True, slots=True, eq=False)
class _Lobe:
    """Microfacets that mirror light to the viewer, drawn as often as they are seen to."""

    cosine: NDArray[np.float64]  # Of the viewer's angle to each.
    weight: NDArray[np.float64]  # Share of light that each sends on, were it a perfect mirror.
    along: NDArray[np.float64]  # Where its light comes from: component along n,
    across: NDArray[np.float64]  # and along the way that a flat mirror would send the viewer's ray.

    def gathered(self, share: NDArray[np.float64] | float) -> NDArray[np.float64]:
        """A and both components of V, with a share of light mirrored by each facet."""
        sent = self.weight * share
        return np.array([sent.mean(), (sent * self.along).mean(), (sent * self.across).mean()])


def _lobes(alpha: float) -> tuple[_Lobe, ...]:
    place = (np.arange(_GRID) + 0.5) / _GRID
    drawn, azimuth = np.meshgrid(place, np.pi * place)  # The other half mirrors this one.
    tangent2 = alpha**2 * drawn / (1 - drawn)  # Facets by D cos, eq. 35.
    up = 1 / np.sqrt(1 + tangent2)
    forth = np.sqrt(1 - up**2) * np.cos(azimuth)
    return tuple(
        _lobe(max(float(cosine), _LEAST_COSINE), alpha, up, forth)
        for cosine in np.linspace(0, 1, _NODES)
    )


def _lobe(
    viewer: float, alpha: float, up: NDArray[np.float64], forth: NDArray[np.float64]
) -> _Lobe:
    """Light of direction w to a viewer in the plane of x and z: f cos = F D G / (4 cos_o), and the
    solid angle of w is 4 (o . h) times the facet's.
    """
    aside = np.sqrt(1 - viewer**2)
    cosine = viewer * up + aside * forth
    along, across = 2 * cosine * up - viewer, aside - 2 * cosine * forth
    seen = (cosine > 0) & (along > 0)
    shadowed = _smith(viewer, alpha) * _smith(np.maximum(along, 1e-9), alpha)
    weight = np.where(seen, shadowed * cosine / (viewer * up), 0.0)
    return _Lobe(np.clip(cosine, 0, 1), weight, along, across)


def _smith(cosine: NDArray[np.float64] | float, alpha: float) -> NDArray[np.float64]:
    """Share of facets that is not hidden, of light that comes or goes at an angle: eq. 34."""
    tangent2 = 1 / np.square(cosine) - 1
    return 2 / (1 + np.sqrt(1 + alpha**2 * tangent2))


def _fresnel(cosine: NDArray[np.float64], ior: float) -> NDArray[np.float64]:
    """Reflectance of a clear surface for unpolarised light: eq. 22."""
    g = np.sqrt(ior**2 - 1 + cosine**2)
    first = ((g - cosine) / (g + cosine)) ** 2
    return 0.5 * first * (1 + ((cosine * (g + cosine) - 1) / (cosine * (g - cosine) + 1)) ** 2)


class Skylight:
    """What the surfaces of a scene that are not all matt return, for kernels."""

    def __init__(self, tables: Sequence[Table | None], handles: Sequence[int]) -> None:
        """Lay tables out by shape handle.

        Args:
            tables: of each shape, None of a matt one.
            handles: by which kernels know the shapes.
        """
        mi = backend.mitsuba()
        rows = np.tile(_matt().astype(np.float32), (max(handles) + 1, 1, 1))
        for handle, table in zip(handles, tables, strict=True):
            if table is not None:
                rows[handle] = table
        self._rows = mi.Float(rows.ravel())

    def returned(self, handle: Any, cosine: Any, albedo: Any, opaque: Any) -> tuple[Any, Any, Any]:
        """A, and V along the normal and along the mirrored way.

        Args:
            handle: UInt32, of the shapes that are seen.
            cosine: of the viewing angle, 0..1.
            albedo: reflectance R of each, what lets light straight through left out.
            opaque: share of each that lets none through.
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
