"""Concave faces of mesh files: the mesh reader cuts every face into a fan of triangles."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray


def warn_of_concave(
    path: Path, points: NDArray[np.float64], polygons: Iterable[NDArray[np.integer]]
) -> None:
    """Warn of faces that a fan of triangles about the first corner leaves.

    Args:
        path: mesh file.
        points: (n, 3) vertices of the file.
        polygons: (m, corners) vertices of faces, each array of equally many corners.
    """
    with np.errstate(all="ignore"):  # Huge vertices are judged elsewhere.
        count = sum(_count_concave(points, corners) for corners in polygons)
    if count:
        warnings.warn(
            f"{path}: {count} concave faces are cut wrongly. Triangulate the mesh on export.",
            stacklevel=4,
        )


def _count_concave(points: NDArray[np.float64], corners: NDArray[np.integer]) -> int:
    spokes = points[corners[:, 1:]] - points[corners[:, :1]]
    areas = np.cross(spokes[:, :-1], spokes[:, 1:])  # (m, triangles, 3), twice the area.
    covered = np.linalg.norm(areas, axis=2).sum(axis=1)
    true = np.linalg.norm(areas.sum(axis=1), axis=1)
    opposed = np.einsum("ntk,nk->nt", areas, areas.sum(axis=1)) < 0  # Bent faces have none.
    return int((opposed.any(axis=1) & (covered > 1.001 * true)).sum())
