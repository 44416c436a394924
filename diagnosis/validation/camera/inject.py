"""Injection of effects into *real* infrared pairs, without a renderer or a simulated camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from starling.diagnosis.validation.camera import imager, optics, outside, psf
from starling.diagnosis.validation.camera.catalogue import ROWS, Strengths
from starling.diagnosis.validation.camera.chain import ExposedPair
from starling.diagnosis.validation.camera.dequantise import (
    band_power,
    dequantise,
    filter_bands,
    subcode_offsets,
)
from starling.diagnosis.validation.camera.draws import Draws
from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.camera.imager import Codes
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.camera.psf import Image

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
        "fixed_pattern",
        "laser_speckle",
        "column_noise",
        "hot_pixels",
        "gamma",
        "black_level",
        "smoothing",
        # Effects outside the table, except those that need bodies, lamps or single dots.
        "lens_ghost",
        "astigmatism",
        "finger_print",
        "brightness_ramp",
        "column_rain",
        "block_compression",
    }
)
LEVELS = frozenset({"black_level", "gain"})  # Automatic exposure would compensate for these.
INCREASE_ONLY = frozenset({"lens_blur", "read_noise", "smoothing"})  # Cannot be removed.
_OPTICAL = (
    *("lens_blur", "vignetting", "veil", "crosstalk", "fixed_pattern"),
    *("lens_ghost", "astigmatism", "finger_print", "brightness_ramp"),
)
_DOT_PX = 9  # Bright structures narrower than this count as dots [px].
_PROBE_PX = 6.0  # Gaussian sigma over which the noise of the probe is averaged [px].
_PROBE_LIFT = 8.0  # Offset that keeps the probe above 0, where resampling clips.


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
) -> ExposedPair:
    """Inject effects into a real pair.

    The real noise remains, except for quantisation noise: the image is dequantised and rounded
    again. Blurring and resampling an image average its noise, which a lens does not do. The missing
    noise by the photon transfer law of `nominal` is therefore added back, and missing speckle too.
    Noise effects add to the real noise. `read_noise`, `lens_blur` and `smoothing` add in quadrature
    what exceeds the value of `nominal`.

    A device that averages its codes has already averaged the real image, so it also averages the
    added terms. The averaging commutes with the optics, as both are linear.

    Args:
        left_dn: Left image (h, w) [DN].
        right_dn: Right image (h, w) [DN].
        settings: Strengths by effect; keys are members of `EFFECTS`.
        nominal: The real camera as far as it is known. Its black level must be that of the images.
        seed: Seed of all random streams.
        scene: Name of the scene, for its random streams.
        frame: Number of the frame.
        exposed_again: Whether to add the noise of one more exposure of this frame. Sub-code offsets
            shift the levels first; they are the same for all frames and effects.

    Returns:
        The pair with effects. It equals the input if all effects are at their neutral and
        `exposed_again` is false.

    Raises:
        WithheldError: if an effect is not in `EFFECTS`, a blur is below the nominal one, or an
            image does not have the nominal size.
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
    for name in sorted(INCREASE_ONLY):
        if strengths[name] < ROWS[name].neutral_of(nominal):
            raise refusal(name, "must not be below nominal", settings[name], "Give more.")
    draws = Draws(seed=seed, scene=scene, frame=frame)
    left, right = (
        _Injection(strengths=strengths, side=side, draws=draws, exposed_again=exposed_again).apply(
            image
        )
        for side, image in (("left", left_dn), ("right", right_dn))
    )
    return ExposedPair(left=left, right=right)


@dataclass(frozen=True, kw_only=True, slots=True)
class _Injection:
    strengths: Strengths
    side: str
    draws: Draws
    exposed_again: bool

    def apply(self, image_dn: Codes) -> Codes:
        if not self.exposed_again and not any(self.strengths.is_active(name) for name in EFFECTS):
            return image_dn
        nominal = self.strengths.nominal
        signal = dequantise(image_dn) - nominal.black_level_dn
        if self.exposed_again:
            signal = signal + subcode_offsets(signal.shape, side=self.side)
        signal = self._add_speckle(signal)
        signal = self._through_optics(signal)
        if self.exposed_again:
            rng = self.draws.frame_rng(f"{self.side}/injected exposure")
            noise = rng.standard_normal(signal.shape)
            signal = signal + self._averaged(np.sqrt(self._variance(signal)) * noise)
        signal = self._electronics(signal * (self.strengths["gain"] / nominal.gain))
        ceiling = imager.top(self.strengths)
        if self.strengths.is_active("gamma"):
            signal = imager.tone(signal, self.strengths["gamma"], ceiling)
        dn = np.clip(signal + self.strengths["black_level"], 0.0, ceiling)
        dn = _blurred(dn, self.strengths["smoothing"], nominal.smoothing_px)
        dn = outside.compress(dn, self.strengths["block_compression"])
        return imager.round_codes(dn, nominal.bit_depth)

    def _add_speckle(self, signal: Image) -> Image:
        contrast = self.strengths["laser_speckle"]
        if contrast == 0.0:
            return signal
        rng = self.draws.scene_rng(f"{self.side}/injected speckle")
        factor = optics.speckle(signal.shape, contrast, self.strengths.nominal, rng)
        return signal + self._averaged(dot_layer(signal) * (factor - 1.0))

    def _through_optics(self, signal: Image) -> Image:
        """Apply the linear optics, and add back the noise that they average away."""
        moved = optics.imager_alignment(self.side, self.strengths) != optics.ResidualAlignment()
        if not moved and not any(self.strengths.is_active(name) for name in _OPTICAL):
            return signal
        blurred = self._optics(signal)
        rng = self.draws.frame_rng(f"{self.side}/injected optics")
        probe = self._averaged(rng.standard_normal(signal.shape))
        lift = np.full(signal.shape, _PROBE_LIFT)
        response = self._optics(probe + lift) - self._optics(lift)
        share = ndimage.gaussian_filter(response**2, _PROBE_PX) / (probe**2).mean()
        missing = self._variance(blurred) - share * self._variance(signal)
        removed = _removed_amplitude(probe, response)
        white = filter_bands(rng.standard_normal(signal.shape), removed)
        noise = np.sqrt(np.clip(missing, 0.0, None)) * white / max(white.std(), 1e-9)
        return blurred + self._averaged(noise + self._blurred_grain(blurred))

    def _blurred_grain(self, image: Image) -> Image:
        """Speckle removed by blurring: the grain size depends on the aperture, not on the blur."""
        nominal = self.strengths.nominal
        if nominal.speckle_contrast == 0.0:
            return np.zeros_like(image)
        rng = self.draws.scene_rng(f"{self.side}/injected grain")
        grain = optics.speckle(image.shape, nominal.speckle_contrast, nominal, rng) - 1.0
        return dot_layer(image) * filter_bands(
            grain, _removed_amplitude(grain, self._spot(self._lens(grain)))
        )

    def _optics(self, signal: Image) -> Image:
        nominal = self.strengths.nominal
        exponent = self.strengths["vignetting"]
        if exponent != 0.0:
            signal = signal * optics.vignetting(nominal, exponent)
        signal = self._lens(signal)
        signal, glare = optics.veil(signal, np.zeros_like(signal), self.strengths["veil"])
        misalignment = optics.imager_alignment(self.side, self.strengths)
        black = nominal.black_level_dn  # Resampling clips at 0; noise may be below.
        image = optics.resample(signal + glare + black, misalignment, nominal) - black
        image = outside.ghost(image, self.strengths["lens_ghost"])
        image = self._spot(image)
        depth = self.strengths["finger_print"]
        image = outside.finger_print(image, depth, self.side, self.draws)
        image = outside.ramp(image, self.strengths["brightness_ramp"], self.draws.frame)
        image = imager.share_charge(image, self.strengths["crosstalk"])
        return image * imager.film(self.strengths, self.side, self.draws, image.shape)

    def _lens(self, signal: Image) -> Image:
        nominal_px = self.strengths.nominal.lens_blur_px
        return _blurred(signal, self.strengths["lens_blur"], nominal_px, "disc")

    def _spot(self, signal: Image) -> Image:
        spread = self.strengths["astigmatism"]
        return outside.astigmatism(signal, spread, self.strengths.nominal)

    def _variance(self, signal: Image) -> Image:
        """Temporal variance [DN^2] at a signal before averaging, by the photon transfer law."""
        nominal = self.strengths.nominal
        dn_per_e = nominal.dn_per_e * nominal.gain
        level = ndimage.gaussian_filter(np.clip(signal, 0.0, None), 1.0)
        shot = nominal.shot_noise**2 * dn_per_e * level
        return shot + (dn_per_e * nominal.read_noise_e) ** 2

    def _electronics(self, signal: Image) -> Image:
        strengths = self.strengths
        dn_per_e = imager.dn_per_e(strengths)
        image_e = charge_e = signal / dn_per_e
        added_e = (strengths["read_noise"] ** 2 - strengths.nominal.read_noise_e**2) ** 0.5
        if added_e != 0.0:
            rng = self.draws.frame_rng(f"{self.side}/injected read")
            charge_e = charge_e + added_e * rng.standard_normal(signal.shape)
        charge_e = imager.add_offsets(charge_e, strengths, self.side, self.draws)
        hot_share = strengths["hot_pixels"]
        if hot_share != 0.0:
            rng = self.draws.device_rng(f"{self.side}/hot_pixels")
            hot = imager.saturated_pixels(signal.shape, hot_share, rng)
            charge_e = np.where(hot, strengths["saturation"], charge_e)
        rain, full_e = strengths["column_rain"], strengths["saturation"]
        charge_e = outside.column_rain(charge_e, rain, full_e, self.side, self.draws)
        full = (imager.top(strengths) - strengths["black_level"]) / dn_per_e
        # The device averages codes, which are limited to the ceiling.
        change_e = np.minimum(charge_e, full) - np.minimum(image_e, full)
        return signal + dn_per_e * self._averaged(change_e)

    def _averaged(self, added: Image) -> Image:
        """Apply the device's averaging of codes to an added term."""
        return _blurred(added, self.strengths.nominal.smoothing_px, 0.0)


def _blurred(
    image: Image, sigma_px: float, existing_px: float, shape: psf.Shape = "gaussian"
) -> Image:
    """Widen an existing blur to a standard deviation of `sigma_px`."""
    return psf.blur(image, psf.kernel(shape, (sigma_px**2 - existing_px**2) ** 0.5))


def _removed_amplitude(before: Image, after: Image) -> Image:
    """Amplitude that an operation removed from each band, relative to the input."""
    transmitted = band_power(after) / np.maximum(band_power(before), 1e-12)
    return np.sqrt(np.clip(1.0 - transmitted, 0.0, 1.0))


def dot_layer(signal: Image) -> Image:
    """Estimate the light of the dots in an image (h, w): the part that a wide opening removes."""
    background = ndimage.grey_opening(signal, (_DOT_PX, _DOT_PX))
    background = ndimage.gaussian_filter(background, 0.5 * _DOT_PX)
    return np.clip(signal - background, 0.0, None)
