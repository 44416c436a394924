"""Effects put into *real* infrared pairs, in which no renderer and no simulated camera had part."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from starling.diagnosis.validation.camera import (
    alignment,
    bands,
    fixed_pattern,
    imager,
    lens,
    outside,
    psf,
    readout,
    speckle,
)
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.chain import Pair
from starling.diagnosis.validation.camera.draws import Draws
from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.camera.readout import Codes
from starling.diagnosis.validation.camera.unrounded import shares, unrounded

Image = NDArray[np.float64]

EFFECTS = frozenset(
    {
        "lens_blur",
        "vertical_offset",
        "roll",
        "disparity_offset",
        "gain",
        "read_noise",
        "vignetting",
        "veil",
        "crosstalk",
        "laser_speckle",
        "column_noise",
        "hot_pixels",
        "gamma",
        "black_level",
        "smoothing",
        # Outside the table; what is missing asks for bodies, lamps or single dots.
        "lens_ghost",
        "astigmatism",
        "finger_print",
        "brightness_ramp",
        "column_rain",
        "block_compression",
    }
)
LEVELS = frozenset({"black_level", "gain"})  # An automatic exposure would make up for these.
# What is there of them cannot be taken out.
UPWARDS = frozenset({"lens_blur", "read_noise", "smoothing"})
_OPTICAL = (
    *("lens_blur", "vignetting", "veil", "crosstalk"),
    *("lens_ghost", "astigmatism", "finger_print", "brightness_ramp"),
)
_DOT_PX = 9  # What is narrower than this and brighter than what is beside it is a dot.
_PROBE_PX = 6.0  # Over which the noise that an operation leaves is averaged.
_PROBE_LIFT = 8.0  # Keeps the probe's noise above 0, where resampling clips.


def inject(
    left_dn: Codes,
    right_dn: Codes,
    settings: Mapping[str, float],
    nominal: Nominal,
    *,
    seed: int,
    scene: str = "",
    frame: int = 0,
    exposed_again: bool = False,
) -> Pair:
    """Put effects into a real pair.

    The real noise stays, but for that of whole codes, which are rounded anew. Blurring and
    resampling a picture would average noise away, which no lens does: what the photon transfer of
    `nominal` says is missing is put back, and so is speckle. An effect's own noise comes on top of
    the real one. Of `read_noise`, `lens_blur` and `smoothing` what exceeds `nominal`'s is added, in
    quadrature.

    A device that averages its codes has averaged the real ones, and averages what an effect adds
    to them as well. What a lens does changes places with that, as both are linear.

    Args:
        left_dn: Left image (h, w) [DN].
        right_dn: Right image.
        settings: Strengths of effects of `EFFECTS`.
        nominal: The real camera as far as it is known; its black level must be the images'.
        seed: Of all draws.
        scene: Name of the scene, for draws that are the scene's.
        frame: Number of the frame.
        exposed_again: Add the noise of one more exposure, drawn for this frame, to levels that are
            moved by shares of a code first, the same for all frames and effects.

    Returns:
        The pair with effects; equal to the one given where every effect is at its neutral and
        nothing is exposed again.

    Raises:
        WithheldError: if an effect is not of `EFFECTS`, a blur would have to be undone, or an image
            is not of the nominal size.
    """
    for name in settings:
        if name not in EFFECTS:
            raise refusal(
                "injected effect", f"must be one of {sorted(EFFECTS)}", name, "Leave it out."
            )
    for image in (left_dn, right_dn):
        if image.shape != nominal.shape:
            raise refusal(
                "image",
                f"must be of shape {nominal.shape}",
                image.shape,
                "Give images of the nominal camera.",
            )
    strengths = Strengths(nominal=nominal, values=settings)
    for name in sorted(UPWARDS):
        if strengths.of(name) < Strengths(nominal=nominal, values={}).of(name):
            raise refusal(name, "must not be below nominal", settings[name], "Give more.")
    draws = Draws(seed=seed, scene=scene, frame=frame)
    left, right = (
        _Injection(strengths=strengths, side=side, draws=draws, exposed_again=exposed_again).into(
            image
        )
        for side, image in (("left", left_dn), ("right", right_dn))
    )
    return Pair(left=left, right=right)


@dataclass(frozen=True, kw_only=True, slots=True)
class _Injection:
    strengths: Strengths
    side: str
    draws: Draws
    exposed_again: bool

    def into(self, image_dn: Codes) -> Codes:
        if not self.exposed_again and not any(self.strengths.acting(name) for name in EFFECTS):
            return image_dn
        nominal = self.strengths.nominal
        signal = unrounded(image_dn) - nominal.black_level_dn
        if self.exposed_again:
            signal = signal + shares(signal.shape, side=self.side)
        signal = self._grain(signal)
        signal = self._through_optics(signal)
        if self.exposed_again:
            rng = self.draws.of_frame(f"{self.side}/injected exposure")
            noise = rng.standard_normal(signal.shape)
            signal = signal + self._averaged(np.sqrt(self._variance(signal)) * noise)
        signal = self._electronics(signal * (self.strengths.of("gain") / nominal.gain))
        ceiling = readout.top(self.strengths)
        if self.strengths.acting("gamma"):
            signal = readout.tone(signal, self.strengths.of("gamma"), ceiling)
        dn = np.clip(signal + self.strengths.of("black_level"), 0.0, ceiling)
        dn = _blurred(dn, self.strengths.of("smoothing"), nominal.smoothing_px)
        dn = outside.compress(dn, self.strengths.of("block_compression"))
        return readout.whole(dn, nominal.bit_depth)

    def _grain(self, signal: Image) -> Image:
        contrast = self.strengths.of("laser_speckle")
        if contrast == 0.0:
            return signal
        rng = self.draws.of_scene(f"{self.side}/injected speckle")
        factor = speckle.grain(signal.shape, contrast, self.strengths.nominal, rng)
        return signal + self._averaged(dots_alone(signal) * (factor - 1.0))

    def _through_optics(self, signal: Image) -> Image:
        """Apply what is linear, and put back the noise that it took away."""
        moved = alignment.of_side(self.side, self.strengths) != alignment.Alignment()
        if not moved and not any(self.strengths.acting(name) for name in _OPTICAL):
            return signal
        seen = self._optics(signal)
        rng = self.draws.of_frame(f"{self.side}/injected optics")
        probe = self._averaged(rng.standard_normal(signal.shape))
        lift = np.full(signal.shape, _PROBE_LIFT)
        left = self._optics(probe + lift) - self._optics(lift)
        share = ndimage.gaussian_filter(left**2, _PROBE_PX) / (probe**2).mean()
        missing = self._variance(seen) - share * self._variance(signal)
        white = bands.filtered(rng.standard_normal(signal.shape), _taken(probe, left))
        noise = np.sqrt(np.clip(missing, 0.0, None)) * white / max(white.std(), 1e-9)
        return seen + self._averaged(noise + self._blurred_grain(seen))

    def _blurred_grain(self, seen: Image) -> Image:
        """Speckle that blurring took away: its grain is the aperture's, whatever the lens blurs."""
        nominal = self.strengths.nominal
        if nominal.speckle_contrast == 0.0:
            return np.zeros_like(seen)
        rng = self.draws.of_scene(f"{self.side}/injected grain")
        grain = speckle.grain(seen.shape, nominal.speckle_contrast, nominal, rng) - 1.0
        return dots_alone(seen) * bands.filtered(
            grain, _taken(grain, self._spot(self._lens(grain)))
        )

    def _optics(self, signal: Image) -> Image:
        nominal = self.strengths.nominal
        exponent = self.strengths.of("vignetting")
        if exponent != 0.0:
            signal = signal * lens.vignetting(nominal, exponent)
        signal = self._lens(signal)
        signal, glare = lens.veil(signal, np.zeros_like(signal), self.strengths.of("veil"))
        where = alignment.of_side(self.side, self.strengths)
        black = nominal.black_level_dn  # Landing cuts off what is below 0, and noise is.
        landed = alignment.land(signal + glare + black, where, nominal) - black
        landed = outside.ghost(landed, self.strengths.of("lens_ghost"))
        landed = self._spot(landed)
        depth = self.strengths.of("finger_print")
        landed = outside.finger_print(landed, depth, self.side, self.draws)
        landed = outside.ramp(landed, self.strengths.of("brightness_ramp"), self.draws.frame)
        return imager.share_charge(landed, self.strengths.of("crosstalk"))

    def _lens(self, signal: Image) -> Image:
        has_px = self.strengths.nominal.lens_blur_px
        return _blurred(signal, self.strengths.of("lens_blur"), has_px, "disc")

    def _spot(self, signal: Image) -> Image:
        spread = self.strengths.of("astigmatism")
        return outside.astigmatism(signal, spread, self.strengths.nominal)

    def _variance(self, signal: Image) -> Image:
        """Temporal variance [DN^2] of a pixel at a signal, before averaging: photon transfer."""
        nominal = self.strengths.nominal
        dn_per_e = nominal.dn_per_e * nominal.gain
        level = ndimage.gaussian_filter(np.clip(signal, 0.0, None), 1.0)
        shot = nominal.shot_noise**2 * dn_per_e * level
        return shot + (dn_per_e * nominal.read_noise_e) ** 2

    def _electronics(self, signal: Image) -> Image:
        strengths = self.strengths
        dn_per_e = readout.dn_per_e(strengths)
        image_e = charge_e = signal / dn_per_e
        added_e = (strengths.of("read_noise") ** 2 - strengths.nominal.read_noise_e**2) ** 0.5
        if added_e != 0.0:
            rng = self.draws.of_frame(f"{self.side}/injected read")
            charge_e = charge_e + added_e * rng.standard_normal(signal.shape)
        charge_e = fixed_pattern.add_offsets(charge_e, strengths, self.side, self.draws)
        hot_share = strengths.of("hot_pixels")
        if hot_share != 0.0:
            rng = self.draws.of_device(f"{self.side}/hot_pixels")
            hot = fixed_pattern.full(signal.shape, hot_share, rng)
            charge_e = np.where(hot, strengths.of("saturation"), charge_e)
        rain, full_e = strengths.of("column_rain"), strengths.of("saturation")
        charge_e = outside.column_rain(charge_e, rain, full_e, self.side, self.draws)
        full = (readout.top(strengths) - strengths.of("black_level")) / dn_per_e
        # Averaged are codes, which end at the ceiling.
        made_e = np.minimum(charge_e, full) - np.minimum(image_e, full)
        return signal + dn_per_e * self._averaged(made_e)

    def _averaged(self, added: Image) -> Image:
        """What the device's averaging of codes leaves of what is added to them before."""
        return _blurred(added, self.strengths.nominal.smoothing_px, 0.0)


def _blurred(image: Image, sigma_px: float, has_px: float, shape: psf.Shape = "gaussian") -> Image:
    """Blur what has a blur already to a wider one."""
    return psf.blur(image, psf.kernel(shape, (sigma_px**2 - has_px**2) ** 0.5))


def _taken(before: Image, after: Image) -> NDArray[np.float64]:
    """Amplitude that was taken from each band of an image."""
    kept = bands.power(after) / np.maximum(bands.power(before), 1e-12)
    return np.sqrt(np.clip(1.0 - kept, 0.0, 1.0))


def dots_alone(signal: Image) -> Image:
    """What of an image (h, w) is dots, as far as can be told: what a wide opening removes."""
    ground = ndimage.grey_opening(signal, (_DOT_PX, _DOT_PX))
    ground = ndimage.gaussian_filter(ground, 0.5 * _DOT_PX)
    return np.clip(signal - ground, 0.0, None)
