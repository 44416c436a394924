"""Temporal filter: a running mean over frames; old depth can replace missing depth."""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors

# Persistence mode -> (needed, last): an old value replaces a missing one if the pixel was valid in
# at least `needed` of the `last` previous frames. Mode 0 never replaces, mode 8 always.
_PERSISTENCE = {1: (8, 8), 2: (2, 3), 3: (2, 4), 4: (2, 8), 5: (1, 2), 6: (1, 5), 7: (1, 8)}
_ALWAYS = 8
_ADVICE = "Pass `history` of the last frame."


@dataclass(frozen=True, kw_only=True, slots=True)
class History:
    """State of the temporal filter after the previous frames, each (h, w)."""

    disparity_px: NDArray[np.float32]  # The last value [px], NaN if there was never one.
    seen: NDArray[np.uint8]  # Bit k: the pixel agreed with its history k + 1 frames ago.

    def __post_init__(self) -> None:
        sizes = set()
        for field, kind in (("disparity_px", np.float32), ("seen", np.uint8)):
            name = f"{field} of History"
            image = errors.instance(name, getattr(self, field), np.ndarray, _ADVICE)
            sizes.add(image.shape)
            if image.ndim != 2 or image.dtype != kind or len(sizes) > 1:
                rule = f"must be (h, w) {np.dtype(kind)}, both of one size"
                raise errors.refuse(name, rule, f"{image.shape} {image.dtype}", _ADVICE)


def persistence_table(persistence: int) -> NDArray[np.bool_]:
    """Return, for every history of eight frames, whether the old value replaces a missing one.

    Args:
        persistence: librealsense's mode: 0 never, 1 valid in 8 of the last 8 frames, 2 in 2 of 3,
            3 in 2 of 4, 4 in 2 of 8, 5 in 1 of 2, 6 in 1 of 5, 7 in 1 of 8, 8 always.

    Returns:
        (256,) bool, indexed by `History.seen`.
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
    """Average a frame with the previous frames, and fill missing pixels from them.

    If |new - old| < `delta_px`, out = alpha new + (1 - alpha) old, and out is the next frame's old
    value. A larger change replaces the old value and restarts its history. In a static scene the
    noise variance falls to the share alpha / (2 - alpha), and the correlation of successive frames
    becomes 1 - alpha.

    Args:
        disparity_px: (h, w) [px], NaN = none.
        past: history of the previous frame; None for the first frame.
        alpha: weight of the new frame; 1 returns the input array and no history.
        delta_px: changes of at least this replace the old value [px].
        persistence: see `persistence_table`.

    Returns:
        (h, w) [px] and the history for the next frame.

    Raises:
        InputError: if `past` is no history, or has another size.

    Source: librealsense, temporal filter.
    """
    if past is not None and not isinstance(past, History):
        rule = "must be a history or None"
        raise errors.refuse("past", rule, type(past).__name__, _ADVICE)
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
    out, stored = np.empty_like(new), np.empty_like(new)
    seen = np.empty(new.shape, np.uint8)
    _blend(
        new.ravel(),
        past.disparity_px.ravel(),
        past.seen.ravel(),
        np.float32(alpha),
        np.float32(delta_px),
        persistence_table(persistence),
        out.ravel(),
        stored.ravel(),
        seen.ravel(),
    )
    return out, History(disparity_px=stored, seen=seen)


@nb.njit(nogil=True, cache=True)
def _blend(
    new, old, seen, alpha, delta, stand, out, stored, seen_now
):  # pragma: no cover - compiled
    rest = np.float32(1) - alpha
    for i in range(new.size):
        value, before = new[i], old[i]
        if value != value:  # Missing; a replaced value is no new observation.
            out[i] = before if stand[seen[i]] else np.float32(np.nan)
            stored[i] = before
            seen_now[i] = np.uint8(seen[i] << 1)
        elif abs(value - before) < delta:
            out[i] = stored[i] = alpha * value + rest * before
            seen_now[i] = np.uint8((seen[i] << 1) | 1)
        else:  # The first value here, or a jump.
            out[i] = stored[i] = value
            seen_now[i] = 1
