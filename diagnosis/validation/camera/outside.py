"""Effects that no page knows: a diagnosis must say that it is none of its own."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.draws import Draws
from starling.diagnosis.validation.camera.light import Light, View
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.camera.scene_light import Arriving

Image = NDArray[np.float64]

_GHOST_BLUR_PX = 3.0
_BANDS = 2.7  # Periods of the mains over the image's height.
_TURNS = 12  # Directions that astigmatic spots are made of.
_NARROW_PX = 0.35  # Width of an astigmatic spot across its direction.
_RAMP_STEP = 0.37  # Of its period, from frame to frame.
_PRINT_BLUR = 0.012  # Of the image's width, under a finger print.
_BLOCK_PX = 8


def displace_body(arriving: Arriving, light: Light, strengths: Strengths, draws: Draws) -> Arriving:
    """Move one body in the right image, as if its model stood at another scale.

    Its disparity is larger by the strength [px]; what it uncovers shows what lies beside it.
    """
    offset_px = strengths.of("body_offset")
    chosen = _a_body(light.left, draws)
    if offset_px == 0.0 or chosen is None:
        return arriving
    was = light.right.body == chosen
    rows, columns = np.indices(was.shape).astype(np.float64)
    source = columns + offset_px
    now = ndimage.map_coordinates(was.astype(np.float64), [rows, source], order=1) > 0.5
    nearest = ndimage.distance_transform_edt(was, return_distances=False, return_indices=True)
    beside = tuple(np.asarray(nearest))

    def move(image: Image) -> Image:
        moved = ndimage.map_coordinates(image, [rows, source], order=3, mode="nearest")
        return np.where(now, np.clip(moved, 0.0, None), image[beside])

    return Arriving(laser_e=move(arriving.laser_e), rest_e=move(arriving.rest_e))


def _a_body(view: View, draws: Draws) -> int | None:
    """Choose a body that is large enough to be seen and not most of the image, if there is one."""
    numbers, counts = np.unique(view.body[view.body > 0], return_counts=True)
    share = counts / view.body.size
    fit = numbers[(share > 0.01) & (share < 0.4)]
    if not len(fit):
        return None
    return int(draws.of_scene("body_offset").choice(fit))


def ghost(light_e: Image, share: float) -> Image:
    """Add a dim, soft copy of the image, mirrored through its centre: light reflected in a lens."""
    if share == 0.0:
        return light_e
    return light_e + share * ndimage.gaussian_filter(light_e[::-1, ::-1], _GHOST_BLUR_PX)


def lamps(light_e: Image, view: View, share: float, draws: Draws) -> Image:
    """Add lamps that follow the mains while rows are exposed one after another.

    Args:
        light_e: Light at the lens (h, w).
        view: Tells how surfaces look under even light.
        share: Mean of the lamps' light over the mean of the other.
        draws: The phase is a frame's, the same in both imagers.
    """
    if share == 0.0:
        return light_e
    phase = draws.of_frame("mains_banding").uniform(0.0, 2.0 * math.pi)
    rows = np.arange(len(light_e))[:, None] / len(light_e)
    beat = 1.0 + np.sin(2.0 * math.pi * _BANDS * rows + phase)
    under = view.ambient_e / max(float(view.ambient_e.mean()), 1e-12)
    return light_e + share * float(light_e.mean()) * beat * under


def astigmatism(light_e: Image, sigma_px: float, nominal: Nominal) -> Image:
    """Blur along one direction that turns with the place in the field, more so off the axis."""
    if sigma_px == 0.0:
        return light_e
    across, down = nominal.tangents()
    angle = np.arctan2(down, across) + 0.25 * math.pi
    place = np.mod(angle / math.pi, 1.0) * _TURNS
    amount = np.clip(2.0 * nominal.radius(), 0.0, 1.0)
    out = light_e * (1.0 - amount)
    for turn in range(_TURNS):
        away = np.abs(np.mod(place - turn + 0.5 * _TURNS, _TURNS) - 0.5 * _TURNS)
        share = np.clip(1.0 - away, 0.0, None) * amount
        spot = _stroke(sigma_px, math.pi * turn / _TURNS)
        out += share * ndimage.convolve(light_e, spot, mode="nearest")
    return out


def _stroke(sigma_px: float, angle: float) -> Image:
    reach = math.ceil(3.0 * sigma_px)
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    along = x * math.cos(angle) + y * math.sin(angle)
    aside = y * math.cos(angle) - x * math.sin(angle)
    spot = np.exp(-0.5 * (along / sigma_px) ** 2 - 0.5 * (aside / _NARROW_PX) ** 2)
    return spot / spot.sum()


def finger_print(light_e: Image, depth: float, side: str, draws: Draws) -> Image:
    """Let a smear on one of the lenses dim and soften a patch of its image.

    Args:
        light_e: Light at the lens (h, w).
        depth: Share of the light that is lost, and of the rest that is blurred, in the middle.
        side: Which imager this is.
        draws: Where the smear is, and on which lens.
    """
    if depth == 0.0:
        return light_e
    rng = draws.of_device("finger_print")
    smeared = "left" if rng.random() < 0.5 else "right"
    if side != smeared:
        return light_e
    height, width = light_e.shape
    ragged = ndimage.gaussian_filter(rng.standard_normal(light_e.shape), 0.04 * width)
    ragged /= float(ragged.std())
    x, y = rng.uniform(0.3, 0.7, 2)
    far = np.hypot(
        (np.arange(width)[None, :] / width - x) * width / height,
        np.arange(height)[:, None] / height - y,
    )
    patch = depth / (1.0 + np.exp((far - 0.3 + 0.06 * ragged) / 0.04))
    soft = ndimage.gaussian_filter(light_e, _PRINT_BLUR * width)
    return (1.0 - 0.5 * patch) * ((1.0 - patch) * light_e + patch * soft)


def ramp(light_e: Image, share: float, frame: int) -> Image:
    """Let the brightness rise from row to row and start afresh at a row that rolls over frames."""
    if share == 0.0:
        return light_e
    rows = np.arange(len(light_e)) / len(light_e)
    tooth = 2.0 * np.mod(rows + 0.3 + _RAMP_STEP * frame, 1.0) - 1.0
    return light_e * (1.0 + share * tooth)[:, None]


def column_rain(
    charge_e: Image, share: float, full_well_e: float, side: str, draws: Draws
) -> Image:
    """Let a share of the columns be bright from a pixel downwards, ever less so."""
    if share == 0.0:
        return charge_e
    rng = draws.of_device(f"{side}/column_rain")
    height, width = charge_e.shape
    wet = rng.random(width) < share
    begin = rng.uniform(0.0, 0.8, width) * height
    level = rng.uniform(0.2, 0.8, width) * full_well_e
    down = np.arange(height)[:, None] - begin
    streak = np.where((down >= 0) & wet, level * np.exp(-down / (0.4 * height)), 0.0)
    return np.minimum(charge_e + streak, full_well_e)


def compress(dn: Image, step_dn: float) -> Image:
    """Cut away detail in blocks of 8x8 pixels, as a picture's compression does.

    Args:
        dn: Digital numbers (h, w).
        step_dn: Step of a block's coarsest waves [DN]; that of the finest is three times as large.
    """
    if step_dn == 0.0:
        return dn
    height, width = dn.shape
    pad = ((0, -height % _BLOCK_PX), (0, -width % _BLOCK_PX))
    padded = np.pad(dn, pad, mode="edge")
    rows, columns = padded.shape[0] // _BLOCK_PX, padded.shape[1] // _BLOCK_PX
    blocks = padded.reshape(rows, _BLOCK_PX, columns, _BLOCK_PX)
    waves = np.asarray(fft.dctn(blocks, axes=(1, 3), norm="ortho"))
    order = np.arange(_BLOCK_PX)
    steps = step_dn * (1.0 + (order[:, None] + order[None, :]) / (_BLOCK_PX - 1.0))
    steps = steps[None, :, None, :]
    kept = fft.idctn(np.rint(waves / steps) * steps, axes=(1, 3), norm="ortho")
    return np.asarray(kept).reshape(padded.shape)[:height, :width]
