"""Temporal filter: a running mean over frames, and old depth that stands in for missing depth."""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors

# Persistence mode: an old value stands if at least `needed` of the `last` frames before this one
# had the pixel. Mode 0 never lets it stand, mode 8 always.
_PERSISTENCE = {1: (8, 8), 2: (2, 3), 3: (2, 4), 4: (2, 8), 5: (1, 2), 6: (1, 5), 7: (1, 8)}
_ALWAYS = 8


@dataclass(frozen=True, kw_only=True, slots=True)
class History:
    """What the temporal filter keeps of the frames before; each (h, w)."""

    disparity_px: NDArray[np.float32]  # The last value [px], NaN where there never was one.
    seen: NDArray[np.uint8]  # Bit k: the pixel agreed with its history k + 1 frames ago.


def stands(persistence: int) -> NDArray[np.bool_]:
    """Say for every history of eight frames whether the old value stands in for a missing one.

    Args:
        persistence: librealsense's mode: 0 never, 1 valid in 8 of the last 8 frames, 2 in 2 of 3,
            3 in 2 of 4, 4 in 2 of 8, 5 in 1 of 2, 6 in 1 of 5, 7 in 1 of 8, 8 always.

    Returns:
        (256,) bool, by `History.seen`.
    """
    if persistence not in _PERSISTENCE:
        return np.full(256, persistence == _ALWAYS)
    needed, last = _PERSISTENCE[persistence]
    frames = np.unpackbits(np.arange(256, dtype=np.uint8)[:, None], axis=1, bitorder="little")
    return frames[:, :last].sum(axis=1) >= needed


def smooth(
    disparity_px: NDArray[np.float32],
    past: History | None,
    *,
    alpha: float,
    delta_px: float,
    persistence: int,
) -> tuple[NDArray[np.float32], History | None]:
    """Average a frame with its past, and fill what is missing from it.

    Where the new value differs from the old by less than `delta_px`, out = alpha new +
    (1 - alpha) old, and out is the old value of the next frame. A larger change is taken over at
    once and its history begins anew. Noise of a static scene falls to alpha / (2 - alpha) of its
    variance, and successive frames become correlated by 1 - alpha.

    Args:
        disparity_px: (h, w) [px], NaN = none.
        past: from the frame before; None for the first frame.
        alpha: share of the new frame; 1 gives the input itself and keeps no history.
        delta_px: changes of at least this much are taken over at once [px].
        persistence: see `stands`.

    Returns:
        (h, w) [px] and the history for the next frame.

    Raises:
        InputError: if `past` is of another size.

    Source: librealsense, temporal filter.
    """
    if alpha == 1.0:
        return disparity_px, None
    new = np.ascontiguousarray(disparity_px, np.float32)
    if past is None:
        return disparity_px, History(disparity_px=new, seen=np.isfinite(new).astype(np.uint8))
    if past.disparity_px.shape != new.shape:
        raise errors.refuse(
            "past",
            f"must be of the frame's own size {new.shape}",
            past.disparity_px.shape,
            "Begin with past=None where the size or the decimation changes.",
        )
    out, kept = np.empty_like(new), np.empty_like(new)
    seen = np.empty(new.shape, np.uint8)
    _blend(
        new.ravel(),
        past.disparity_px.ravel(),
        past.seen.ravel(),
        np.float32(alpha),
        np.float32(delta_px),
        stands(persistence),
        out.ravel(),
        kept.ravel(),
        seen.ravel(),
    )
    return out, History(disparity_px=kept, seen=seen)


@nb.njit(nogil=True, cache=True)
def _blend(new, old, seen, alpha, delta, stand, out, kept, seen_now):  # pragma: no cover - compiled
    rest = np.float32(1) - alpha
    for i in range(new.size):
        value, before = new[i], old[i]
        if value != value:  # Missing: what stands in is no new observation.
            out[i] = before if stand[seen[i]] else np.float32(np.nan)
            kept[i] = before
            seen_now[i] = np.uint8(seen[i] << 1)
        elif abs(value - before) < delta:
            out[i] = kept[i] = alpha * value + rest * before
            seen_now[i] = np.uint8((seen[i] << 1) | 1)
        else:  # The first value here, or a jump.
            out[i] = kept[i] = value
            seen_now[i] = 1
