"""Effects outside the diagnosis' table. The correct verdict on them is an unknown effect."""

from __future__ import annotations

import math

import numpy as np
from scipy import fft, ndimage

from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.draws import Draws
from starling.diagnosis.validation.camera.light import LightView, ReceivedLight, SceneLight
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.camera.psf import Image

_GHOST_BLUR_PX = 3.0  # Gaussian sigma of the ghost image [px].
_BANDS = 2.7  # Mains periods over the image height.
_TURNS = 12  # Directions between which astigmatic spots are interpolated.
_NARROW_PX = 0.35  # Sigma of an astigmatic spot across its direction [px].
_RAMP_STEP = 0.37  # Phase step of the brightness ramp per frame [periods].
_PRINT_BLUR = 0.012  # Sigma of the blur under a fingerprint [image widths].
_BLOCK_PX = 8  # Side of a compression block [px].


def displace_body(
    received: ReceivedLight, light: SceneLight, strengths: Strengths, draws: Draws
) -> ReceivedLight:
    """Displace one body in the right image, as a misplaced model in the scene would.

    The strength [px] is added to the disparity of the body. Uncovered pixels take the nearest pixel
    outside the body.
    """
    offset_px = strengths["body_offset"]
    chosen = _choose_body(light.left, draws)
    if offset_px == 0.0 or chosen is None:
        return received
    before = light.right.body == chosen
    rows, columns = np.indices(before.shape).astype(np.float64)
    source = columns + offset_px
    after = ndimage.map_coordinates(before.astype(np.float64), [rows, source], order=1) > 0.5
    nearest = ndimage.distance_transform_edt(before, return_distances=False, return_indices=True)
    background = tuple(np.asarray(nearest))

    def move(image: Image) -> Image:
        moved = ndimage.map_coordinates(image, [rows, source], order=3, mode="nearest")
        return np.where(after, np.clip(moved, 0.0, None), image[background])

    return ReceivedLight(laser_e=move(received.laser_e), rest_e=move(received.rest_e))


def _choose_body(view: LightView, draws: Draws) -> int | None:
    """Choose a body that covers 1 to 40 % of the image, or None if there is none."""
    numbers, counts = np.unique(view.body[view.body > 0], return_counts=True)
    share = counts / view.body.size
    suitable = numbers[(share > 0.01) & (share < 0.4)]
    if not len(suitable):
        return None
    return int(draws.scene_rng("body_offset").choice(suitable))


def ghost(light_e: Image, share: float) -> Image:
    """Add a dim, blurred copy of the image, mirrored through its centre (lens reflection)."""
    if share == 0.0:
        return light_e
    return light_e + share * ndimage.gaussian_filter(light_e[::-1, ::-1], _GHOST_BLUR_PX)


def lamps(light_e: Image, view: LightView, share: float, draws: Draws) -> Image:
    """Add light of mains-powered lamps under a rolling shutter: bright and dark bands of rows.

    Args:
        light_e: Light at the lens (h, w).
        view: Gives the appearance of the surfaces under uniform light.
        share: Mean lamp light over the mean of `light_e`.
        draws: Random streams. The phase differs between frames and is equal in both imagers.
    """
    if share == 0.0:
        return light_e
    phase = draws.frame_rng("mains_banding").uniform(0.0, 2.0 * math.pi)
    rows = np.arange(len(light_e))[:, None] / len(light_e)
    beat = 1.0 + np.sin(2.0 * math.pi * _BANDS * rows + phase)
    under = view.ambient_e / max(float(view.ambient_e.mean()), 1e-12)
    return light_e + share * float(light_e.mean()) * beat * under


def astigmatism(light_e: Image, sigma_px: float, nominal: Nominal) -> Image:
    """Blur along a direction that rotates with the field angle. Strength grows off the axis."""
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
    """Dim and blur a patch of the image, as a fingerprint on one of the lenses does.

    Args:
        light_e: Light at the lens (h, w).
        depth: Strength at the patch centre. Half of it is the lost share of the light; all of it
            is the blurred share of the remainder.
        side: "left" or "right" imager.
        draws: Random streams of the position of the print and of the lens it is on.
    """
    if depth == 0.0:
        return light_e
    rng = draws.device_rng("finger_print")
    smeared = "left" if rng.random() < 0.5 else "right"
    if side != smeared:
        return light_e
    height, width = light_e.shape
    ragged = ndimage.gaussian_filter(rng.standard_normal(light_e.shape), 0.04 * width)
    ragged /= float(ragged.std())
    x, y = rng.uniform(0.3, 0.7, 2)
    distance = np.hypot(
        (np.arange(width)[None, :] / width - x) * width / height,
        np.arange(height)[:, None] / height - y,
    )
    patch = depth / (1.0 + np.exp((distance - 0.3 + 0.06 * ragged) / 0.04))
    soft = ndimage.gaussian_filter(light_e, _PRINT_BLUR * width)
    return (1.0 - 0.5 * patch) * ((1.0 - patch) * light_e + patch * soft)


def ramp(light_e: Image, share: float, frame: int) -> Image:
    """Multiply rows by a sawtooth of the given relative amplitude that moves between frames."""
    if share == 0.0:
        return light_e
    rows = np.arange(len(light_e)) / len(light_e)
    tooth = 2.0 * np.mod(rows + 0.3 + _RAMP_STEP * frame, 1.0) - 1.0
    return light_e * (1.0 + share * tooth)[:, None]


def column_rain(
    charge_e: Image, share: float, full_well_e: float, side: str, draws: Draws
) -> Image:
    """Add bright streaks to a share of the columns that decay from a start pixel downwards."""
    if share == 0.0:
        return charge_e
    rng = draws.device_rng(f"{side}/column_rain")
    height, width = charge_e.shape
    wet = rng.random(width) < share
    begin = rng.uniform(0.0, 0.8, width) * height
    level = rng.uniform(0.2, 0.8, width) * full_well_e
    down = np.arange(height)[:, None] - begin
    streak = np.where((down >= 0) & wet, level * np.exp(-down / (0.4 * height)), 0.0)
    return np.minimum(charge_e + streak, full_well_e)


def compress(dn: Image, step_dn: float) -> Image:
    """Quantise the cosine transform of blocks of 8 x 8 pixels, as JPEG compression does.

    Args:
        dn: Digital numbers (h, w).
        step_dn: Quantisation step of the coarsest wave [DN]. The finest has three times the step.
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
    decoded = fft.idctn(np.rint(waves / steps) * steps, axes=(1, 3), norm="ortho")
    return np.asarray(decoded).reshape(padded.shape)[:height, :width]
