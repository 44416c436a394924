"""Colours of vertices as an image: each triangle has a square of 2 x 2 pixels of its own.

Corners of a triangle lie at three pixel centres of its square. The fourth pixel continues the
plane through them, so that bilinear interpolation is linear over the triangle. It is cut to [0, 1],
which bends the interpolation of triangles with very different corners.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from starling.sim.arrays import Image
from starling.sim.scene.scene import Mesh


def paint(mesh: Mesh, vertex_rgb: NDArray[np.float32]) -> tuple[Mesh, Image]:
    """Return a mesh whose triangles share no vertices, with uv, and the image of its colours.

    Args:
        mesh: triangles.
        vertex_rgb: (n, 3) linear colours.

    Returns:
        Mesh with uv, and the image (h, w, 3) in [0, 1].
    """
    corners = mesh.faces.ravel()
    count = len(mesh.faces)
    columns = int(np.ceil(np.sqrt(count)))
    rows = -(-count // columns)
    place = np.arange(count)
    left, top = 2 * (place % columns), 2 * (place // columns)  # Pixel of the square's corner.
    a, b, c = (np.clip(vertex_rgb[mesh.faces[:, corner]], 0, 1) for corner in range(3))
    image = np.zeros((2 * rows, 2 * columns, 3), np.float32)
    image[top, left], image[top, left + 1], image[top + 1, left] = a, b, c
    image[top + 1, left + 1] = np.clip(b + c - a, 0, 1)
    u = np.stack([left + 0.5, left + 1.5, left + 0.5], axis=1) / (2 * columns)
    v = np.stack([top + 0.5, top + 0.5, top + 1.5], axis=1) / (2 * rows)
    painted = dataclasses.replace(
        mesh,
        vertices=mesh.vertices[corners],
        faces=np.arange(3 * count, dtype=np.uint32).reshape(-1, 3),
        normals=None if mesh.normals is None else mesh.normals[corners],
        uv=np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float32),
    )
    return painted, image
