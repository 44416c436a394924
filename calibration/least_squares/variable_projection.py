"""Variable projection by tiles: eliminate unknown reflectance, ambient light and gain locally.

An image is cut into square tiles. In each tile, weighted linear least squares fits a plane and the
predicted layers of light to the observed levels,

    y = c0 + c1 x + c2 y + sum_k a_k T_k + noise.

This removes the unknown reflectance, ambient light, gain, black level and falloff. The remaining
information is the position and shape of the dots. Residual and derivatives are projected onto the
orthogonal complement of the tile's basis.

`starling.calibration.least_squares.tiles` eliminates only a reflectance that several images share,
and works on products of columns. Here each image has its own strengths, and robust weights need the
residuals of single pixels.

Sources: Golub and Pereyra, SIAM J. Numer. Anal. 10(2), 1973 (variable projection); Kaufman, BIT 15,
1975 (the derivative without its second term, which is small where residuals are).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors

Array = NDArray[np.float32]
_PLANE = 3  # Number of basis columns of the plane: 1, x, y.
_LEAST_SHARE = 0.35  # Minimum share of used pixels in a tile.
_RIDGE = 1e-6  # Eigenvalue below which a direction of the unit-norm basis is dropped.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class EliminatedTiles:
    """Fit of an image's tiles: n tiles of m pixels, k layers."""

    residual: Array  # (n, m) weighted, observed minus fitted; 0 for unused pixels.
    amplitude: Array  # (n, k) strength of each layer, >= 0.
    used: NDArray[np.bool_]  # (n,) used tiles.
    pixels: int  # Number of used pixels.
    freedom: int  # Degrees of freedom: used pixels minus fitted coefficients.
    _root: Array  # (n, m) square roots of the weights.
    _basis: Array  # (n, m, k + 3) orthonormal, weighted.
    _size: int

    def reweighted(self, weight: Array) -> Array:
        """Return the residuals (n, m) with other weights (h, w); 0 for unused pixels."""
        root = np.sqrt(cut(np.asarray(weight, np.float32), self._size))
        ratio = root / np.where(self._root > 0, self._root, np.float32(np.inf))
        return np.asarray(self.residual * ratio, np.float32)

    def project(self, columns: Sequence[Sequence[Array]]) -> Array:
        """Compute the derivative of the residual by each parameter.

        Args:
            columns: for each parameter, the derivatives of all k layers, (h, w) each.

        Returns:
            (n, m, p).
        """
        n, m = self.residual.shape
        derivative = np.empty((n, m, len(columns)), np.float32)
        for number, layers in enumerate(columns):
            change = np.zeros((n, m), np.float32)
            for k, layer in enumerate(layers):
                change += self.amplitude[:, k, None] * cut(layer, self._size)
            derivative[:, :, number] = -self._root * change
        derivative -= self._basis @ (self._basis.transpose(0, 2, 1) @ derivative)
        return derivative


def cut(image: NDArray, size_px: int) -> NDArray:
    """Cut (h, w) into tiles (n, size^2), row by row; incomplete tiles are dropped."""
    rows, columns = (length // size_px for length in image.shape)
    parts = image[: rows * size_px, : columns * size_px]
    parts = parts.reshape(rows, size_px, columns, size_px).swapaxes(1, 2)
    return parts.reshape(rows * columns, size_px * size_px)


def join(parts: NDArray, shape: tuple[int, ...], size_px: int) -> NDArray:
    """Assemble tiles (n, size^2) to an image (h, w), 0 outside complete tiles."""
    rows, columns = (length // size_px for length in shape)
    image = np.zeros(shape, parts.dtype)
    tiles = parts.reshape(rows, columns, size_px, size_px).swapaxes(1, 2)
    image[: rows * size_px, : columns * size_px] = tiles.reshape(rows * size_px, columns * size_px)
    return image


def centres(shape: tuple[int, ...], size_px: int) -> NDArray[np.float64]:
    """Return image coordinates (x, y) of the tiles' centres (n, 2), in the order of `cut`."""
    rows, columns = (length // size_px for length in shape)
    y, x = np.mgrid[:rows, :columns]
    return (np.stack([x, y], axis=-1).reshape(-1, 2) + 0.5) * size_px - 0.5


def eliminate(
    observed: Array, layers: Sequence[Array], weight: Array, *, size_px: int
) -> EliminatedTiles:
    """Fit a plane and layers of light to each tile.

    A layer with a negative strength is removed from its tile.

    Args:
        observed: (h, w) [DN], linear in light.
        layers: k predicted images (h, w) of any scale.
        weight: (h, w) inverse variances [1 / DN^2], 0 for unused pixels.
        size_px: side of a tile.

    Raises:
        InputError: if the images differ in shape, or are smaller than a tile.

    Source: Golub and Pereyra (1973), sec. 2.
    """
    shapes = {np.shape(image) for image in (observed, weight, *layers)}
    if len(shapes) != 1:
        raise errors.refuse(
            "observed, layers and weight", "must share one shape", shapes, "Take one view."
        )
    errors.in_interval("size_px", size_px, 4, min(observed.shape), "Give a tile's side [px].")
    root = np.sqrt(cut(np.asarray(weight, np.float32), size_px))
    counted = (root > 0).sum(axis=1)
    used = counted >= max(_LEAST_SHARE * size_px**2, _PLANE + len(layers) + 1)
    root = root * used[:, None]
    level = root * cut(np.asarray(observed, np.float32), size_px)
    light = [cut(np.asarray(layer, np.float32), size_px) for layer in layers]
    basis, scale = _basis(root, light, size_px)
    fitted, spread = _fit(basis, level)
    negative = fitted[:, _PLANE:] < 0
    if negative.any():
        basis[:, :, _PLANE:] *= ~negative[:, None, :]
        fitted, spread = _fit(basis, level)
    amplitude = np.where(negative, 0, np.maximum(fitted[:, _PLANE:], 0) / scale)
    orthonormal = basis @ spread
    residual = level - (orthonormal @ (orthonormal.transpose(0, 2, 1) @ level[..., None]))[..., 0]
    pixels = int(counted[used].sum())
    return EliminatedTiles(
        residual=residual,
        amplitude=amplitude.astype(np.float32),
        used=used,
        pixels=pixels,
        freedom=pixels - int(used.sum()) * (_PLANE + len(layers)) + int(negative[used].sum()),
        _root=root,
        _basis=orthonormal,
        _size=size_px,
    )


def _basis(root: Array, light: list[Array], size_px: int) -> tuple[Array, Array]:
    """Return the weighted basis (n, m, k + 3) of unit columns, and the layers' norms (n, k).

    Layers are centred at their weighted mean. This keeps the span and improves conditioning.
    """
    axis = np.linspace(-1, 1, size_px, dtype=np.float32)
    y, x = (a.ravel() for a in np.meshgrid(axis, axis, indexing="ij"))
    total = np.maximum((root**2).sum(axis=1, keepdims=True), 1e-30)
    centred = [part - ((root**2) * part).sum(axis=1, keepdims=True) / total for part in light]
    flat = [np.broadcast_to(part, root.shape) for part in (np.ones_like(x), x, y)]
    basis = np.stack([root * part for part in (*flat, *centred)], axis=-1)
    norm = np.maximum(np.linalg.norm(basis, axis=1, keepdims=True), 1e-20)
    return basis / norm, norm[:, 0, _PLANE:]


def _fit(basis: Array, level: Array) -> tuple[NDArray[np.float64], Array]:
    """Return coefficients (n, k + 3) and the orthonormalising matrix (n, k + 3, k + 3)."""
    gram = (basis.transpose(0, 2, 1) @ basis).astype(np.float64)
    value, vector = np.linalg.eigh(gram)
    inverse = np.where(value > _RIDGE, 1 / np.sqrt(np.maximum(value, _RIDGE)), 0)
    spread = vector * inverse[:, None, :]
    moments = (basis.transpose(0, 2, 1) @ level[..., None]).astype(np.float64)
    fitted = (spread @ (spread.transpose(0, 2, 1) @ moments))[..., 0]
    return fitted, spread.astype(np.float32)
