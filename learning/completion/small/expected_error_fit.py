"""Fit of the expected error to errors in rooms that the network was not trained on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from starling.learning.completion.data.pairs import Pair
from starling.learning.completion.method import Image
from starling.learning.completion.small.expected_error import GroupError, change_m, group_masks
from starling.patterns.errors import refuse

Values = NDArray[np.float64]

_LEAST_SCALE = 1.0  # A few rooms do not justify a sigma below the network's own.
_LEAST_M = 1e-5  # Least sigma of a pixel [m].
_START_SHARE = 0.1  # Share of the second term in the variance at the start.
_BOUNDS = ((2 * np.log(_LEAST_SCALE), 12.0), (-25.0, 12.0))  # Of ln scale^2 and ln shift^2.
_PIXELS = 30_000  # Pixels of a group that are drawn from a frame.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class RoomErrors:
    """Errors at pixels of one group in one room; (n,) each [m]."""

    error: Values  # Absolute error.
    own_sigma: Values  # Sigma of the network.
    change: Values  # See `change_m`.


def sampled_errors(
    pair: Pair, depth_m: Image, own_sigma_m: Image, *, seed: int
) -> Iterator[tuple[str, RoomErrors]]:
    """Draw pixels with known truth from each group of one frame.

    Args:
        pair: frame with ground truth.
        depth_m: (h, w) completed depth [m].
        own_sigma_m: (h, w) sigma of the network [m].
        seed: seed of the draw.

    Yields:
        Name of a group and its errors; groups without pixels are left out.
    """
    rng = np.random.default_rng(seed)
    truth_m = pair.truth()
    for name, where in group_masks(pair.valid, depth_m == pair.depth_m).items():
        pixels = np.flatnonzero(where & np.isfinite(truth_m))
        if not pixels.size:
            continue
        if pixels.size > _PIXELS:
            pixels = rng.choice(pixels, _PIXELS, replace=False)
        images = (np.abs(depth_m - truth_m), own_sigma_m, change_m(depth_m, name))
        error, own_sigma, change = (image.ravel()[pixels].astype(np.float64) for image in images)
        yield name, RoomErrors(error=error, own_sigma=own_sigma, change=change)


def fit(rooms: Sequence[RoomErrors]) -> GroupError:
    """Fit scale and shift by the likelihood of a normal law; each room has the same weight.

    Raises:
        InputError: if there is no room, or a room has no pixel.
    """
    if not rooms or not all(room.error.size for room in rooms):
        counts = [room.error.size for room in rooms]
        raise refuse("rooms", "must each have pixels of the group", counts, "Leave others out.")
    squares = np.concatenate([np.stack([room.own_sigma, room.change]) ** 2 for room in rooms], 1)
    error = np.concatenate([room.error**2 for room in rooms])
    weight = np.concatenate([np.full(room.error.size, 1 / room.error.size) for room in rooms])
    weight /= len(rooms)

    def loss(logs: Values) -> tuple[float, Values]:
        factors = np.exp(logs)
        variance = factors @ squares + _LEAST_M**2
        slope = squares @ (weight * (1 / variance - error / variance**2))
        return float((weight * (np.log(variance) + error / variance)).sum()), slope * factors

    mean_change = (weight * squares[1]).sum() + _LEAST_M**2
    start = [_BOUNDS[0][0] + 0.1, np.log(_START_SHARE * (weight * error).sum() / mean_change)]
    start = np.clip(start, *np.transpose(_BOUNDS))
    logs = optimize.minimize(loss, start, jac=True, method="L-BFGS-B", bounds=_BOUNDS).x
    scale, shift = np.exp(logs / 2)
    return GroupError(scale=round(float(scale), 3), shift_px=round(float(shift), 3))


def ratios(group: GroupError, room: RoomErrors) -> Values:
    """Errors over sigma (n,)."""
    sigma = np.hypot(group.scale * room.own_sigma, group.shift_px * room.change)
    return room.error / np.maximum(sigma, _LEAST_M)


def left_out(rooms: Sequence[RoomErrors]) -> list[Values]:
    """Errors over sigma of each room, with sigma fitted to the other rooms.

    Raises:
        InputError: if there are fewer than two rooms; see also `fit`.
    """
    if len(rooms) < 2:
        raise refuse("rooms", "must be at least two", len(rooms), "Add rooms.")
    return [
        ratios(fit([*rooms[:number], *rooms[number + 1 :]]), room)
        for number, room in enumerate(rooms)
    ]


def half_width(room_ratios: Sequence[Values], level: float) -> float:
    """Half-width of the interval that holds a share of the errors of every room left out [sigma].

    Split-conformal with rooms as units, because pixels of a room share errors. If rooms are
    exchangeable, a further room is covered with probability n / (n + 1) for n rooms.

    Args:
        room_ratios: errors over sigma of each room, see `left_out`.
        level: the share, 0 to 1.
    """
    return max(float(np.quantile(ratio, level)) for ratio in room_ratios)
