"""Rows of the effect table for the imager stage.

The figures in `shows` were measured on `tabletop` with a D435 with 8-bit matching, 39 electrons per
step.
"""

from __future__ import annotations

from starling.sim.effects import pixel_noise
from starling.sim.effects.effect import Effect, Parameter, Stage
from starling.sim.effects.pixel_noise import EMVA, IMX900, imager_parameter

_OV9281 = "driver of the OV9282 (Linux, drivers/media/i2c/ov9282.c)"


_EXPOSURE = Effect(
    name="exposure",
    family="signal_gain",
    stage=Stage.IMAGER,
    parameters=imager_parameter("time_s", "exposure_s", "s", None, 5e-4, 33e-3),
    imitates="A fixed integration time that is not the assumed one.",
    law="electrons = rate t; with auto exposure on it has no effect",
    shows=(
        "All levels above black scale, noise by its root. At 2 ms instead of 8.5 ms: mean 32 "
        "to 11 DN, temporal disparity noise 0.09 to 0.13 px. At 33 ms: 4 % of the pixels are "
        "full."
    ),
    confused_with=("gain", "auto_exposure", "saturation", "projector_power", "nir_reflectance"),
    source="8.5 ms and 33 ms: librealsense presets.cpp; 1 frame at 30 Hz at most",
)

_GAIN = Effect(
    name="gain",
    family="signal_gain",
    stage=Stage.IMAGER,
    parameters=imager_parameter("factor", "gain", "1", None, 1.0, 15.5),
    imitates="Analog gain: more DN for an electron, noise included.",
    law="DN = gain electrons ceiling / full well + black level",
    shows=(
        "With auto exposure the mean stays and noise grows: at 4 from 1.2 to 2.4 DN, "
        "disparity noise 0.07 to 0.09 px, at 15.5 to 0.14 px. Without it dots fill: at 15.5, "
        "96 % of the pixels and nearly three quarters of the depth are lost."
    ),
    confused_with=(
        *("exposure", "saturation", "read_noise", "shot_noise", "projector_power"),
        *("auto_exposure", "gamma", "quantisation"),
    ),
    source=f"Register 16 to 248 over 16 (librealsense presets.cpp; {_OV9281}: 0x10 to 0xff)",
)

_AUTO_EXPOSURE = Effect(
    name="auto_exposure",
    family="signal_gain",
    stage=Stage.IMAGER,
    parameters=(
        *imager_parameter("level", "auto_exposure_level", "1", 0.0, 0.05, 0.7),
        *imager_parameter("longest_s", "auto_exposure_max_s", "s", None, 4e-3, 33e-3),
    ),
    imitates="A control that sets the integration time by the image's mean; level 0 is off.",
    law="t = min((level ceiling - black level) / (mean rate x DN per electron), longest)",
    shows=(
        "The mean no longer follows power, distance or albedo; one bright object darkens all "
        "others. Level 0.1 instead of 0.375: mean 93 to 26 DN, saturation 2.9 % to none, "
        "disparity noise 0.066 to 0.091 px."
    ),
    confused_with=("exposure", "gain", "saturation", "flicker"),
    source="Setpoints 400 and 1536, of 4096 as assumed: librealsense presets.cpp",
)

_DARK_CURRENT = Effect(
    name="dark_current",
    family="dark_current",
    stage=Stage.IMAGER,
    parameters=imager_parameter("rate_e_s", "dark_current_e_s", "electrons/s", 0.0, 1.0, 1e5),
    imitates="Electrons freed by heat; the rate doubles every 6 to 8 K.",
    law="electrons + rate t, with their shot noise; auto exposure meters light alone",
    shows=(
        "A pedestal that grows with the exposure. At 1000 electrons/s and 28 ms: 0.7 DN, "
        "depth unchanged. At 100000: the mean rises by 69 DN, disparity noise 0.066 to 0.080 "
        "px."
    ),
    confused_with=("black_level", "read_noise"),
    source=f"{EMVA}, dark current; {IMX900}: 1.5 electrons/s",
)

_SATURATION = Effect(
    name="saturation",
    family="signal_gain",
    stage=Stage.IMAGER,
    parameters=imager_parameter("full_well_e", "full_well_e", "electrons", None, 2000.0, 50000.0),
    imitates="A full well, which also sets the scale's ceiling.",
    law="charge <= full well; DN per electron = gain ceiling / full well",
    shows=(
        "Flat-topped dots on near or shiny surfaces. A smaller well equals a larger gain. "
        "With auto exposure, 2000 electrons instead of 10000: noise 1.2 to 2.7 DN, disparity "
        "0.066 to 0.10 px, saturation unchanged."
    ),
    confused_with=(
        "gain",
        "exposure",
        "shot_noise",
        "blooming",
        "auto_exposure",
        "nir_reflectance",
        "quantisation",
    ),
    source=(
        f"{EMVA}, saturation capacity; {IMX900}: 9458 electrons (2183 at high conversion gain)"
    ),
)

_BLOOMING = Effect(
    name="blooming",
    family="blooming",
    stage=Stage.IMAGER,
    parameters=imager_parameter("share", "blooming", "1", 0.0, 0.02, 0.5),
    imitates="Charge above the full well that flows along its column.",
    law="share of the excess flows half up, half down into free capacity; the rest drains",
    shows=(
        "Vertical streaks from full pixels. At 0.3, with 2.9 % of the pixels full: 0.9 % more "
        "fill; depth is unchanged. Where most dots are full (2 W, 0.5): holes 3.5 to 17 %, "
        "4.6 % over 1 px."
    ),
    confused_with=("saturation",),
    source=(
        "Janesick, Scientific Charge-Coupled Devices (2001); weak in CMOS pixels, range assumed"
    ),
)

_CROSSTALK = Effect(
    name="crosstalk",
    family="crosstalk",
    stage=Stage.IMAGER,
    parameters=imager_parameter("share", "crosstalk", "1", 0.0, 0.01, 0.3),
    imitates="Electrons freed deep in the silicon that reach a neighbouring pixel.",
    law=(
        "kernel 1 - c in the middle, c / 4 in four neighbours, before the charge is counted; "
        "contrast at the finest period x (1 - c)"
    ),
    shows=(
        "Dots are wider and lower, as by a blur of sqrt(c / 2) px; unlike averaging, noise "
        "stays white. At 0.3: disparity noise and fill within 3 %."
    ),
    confused_with=("lens_blur", "dot_blur", "smoothing"),
    source=(
        "Djite et al., IEEE Trans. Electron Devices 59 (2012) 729; contrast at 900 nm 2 to 3 "
        "times below that at 550 nm in some sensors (adimec.com, MTF in NIR)"
    ),
)

_SMOOTHING = Effect(
    name="smoothing",
    family="smoothing",
    stage=Stage.IMAGER,
    parameters=imager_parameter("sigma_px", "smoothing_px", "px", 0.0, 0.3, 1.0),
    imitates="Averaging of pixels by the device's own rectification.",
    law=(
        "Gaussian after noise and clipping; noise variance x 1 / (4 pi sigma^2), correlated "
        "by exp(-d^2 / (4 sigma^2))"
    ),
    shows=(
        "Noise is lower and correlated; dots are wider. At 0.5 px: 1.2 to 0.76 DN. At 1 px: "
        "0.47 DN, saturation 2.9 to 0.1 %, disparity noise 0.066 to 0.050 px."
    ),
    confused_with=("lens_blur", "crosstalk", "shot_noise"),
    source=(
        "Poisson's sum of a Gaussian kernel; D415 captures show less than half of the "
        "expected shot noise"
    ),
)

_GAMMA = Effect(
    name="gamma",
    family="tone_curve",
    stage=Stage.IMAGER,
    parameters=imager_parameter("exponent", "gamma", "1", 1.0, 0.8, 2.2),
    imitates="A tone curve between converter and output.",
    law="DN = ceiling (signal / ceiling)^(1 / gamma) + black level",
    shows=(
        "Dark parts are lifted, bright ones compressed; variance against mean is no straight "
        "line. At 2.2: mean 93 to 158 DN. A census hardly changes: fill and disparity errors "
        "within 1 %."
    ),
    confused_with=("black_level", "gain"),
    source="1.0 where the device streams raw levels; 2.2 is that of displays",
)

_BLACK_LEVEL = Effect(
    name="black_level",
    family="black_level",
    stage=Stage.IMAGER,
    parameters=imager_parameter("level_dn", "black_level_dn", "DN", 0.0, 1.0, 16.0),
    imitates="The pedestal that keeps noise about zero representable.",
    law="DN = signal + level",
    shows=(
        "Darkness reads the level at every exposure; at 0 half of the dark noise is clipped. "
        "Auto exposure counts it as light: 16 instead of 4 DN gives 24.5 instead of 28.2 ms. "
        "Disparity noise within 3 %."
    ),
    confused_with=("dark_current", "gamma", "veil", "ambient"),
    source="4 to 5 DN measured on a D415; Sony IMX900: 240 of 4095",
)

_QUANTISATION = Effect(
    name="quantisation",
    family="quantisation",
    stage=Stage.IMAGER,
    parameters=(
        Parameter(
            name="bits",
            paths=("imager.bit_depth",),
            unit="bit",
            neutral=16,
            choices=(8, 10, 12, 16),
        ),
    ),
    imitates="A converter of few bits, or a stream cut to 8.",
    law=(
        "whole codes; step = full well / (gain (2^bits - 1)), variance step^2 / 12 where "
        "noise exceeds a third of a step"
    ),
    shows=(
        "A comb in the histogram. Its noise, 0.29 of a step, is static where other noise is "
        "small. From 8 to 10 bits disparity noise goes from 0.066 to 0.064 px."
    ),
    confused_with=("read_noise",),
    source="Y8 infrared stream of the D4xx; OV9282: 8 or 10 bits (Linux driver); Kinect v1: 10",
)

_DROPPED_BITS = Effect(
    name="dropped_bits",
    family="quantisation",
    stage=Stage.IMAGER,
    parameters=(
        Parameter(
            name="bits",
            paths=("imager.dropped_bits",),
            unit="bit",
            neutral=0,
            choices=(0, 2, 4),
        ),
    ),
    imitates="A device that matches its converter's codes and outputs images with fewer bits.",
    law="matched code = round(2^bits DN), image = round(DN)",
    shows="Images are unchanged. Surfaces whose dots are fainter than one code have depth.",
    confused_with=("quantisation", "texture_threshold"),
    source=(
        "Imagers of the D4xx give 10-bit raw (data sheet 337029, imager tables); the infrared "
        "stream has 8 (librealsense issue 5062)"
    ),
)

ROWS: tuple[Effect, ...] = (
    _EXPOSURE,
    _GAIN,
    _AUTO_EXPOSURE,
    _CROSSTALK,
    pixel_noise.PRNU,
    pixel_noise.FIXED_PATTERN,
    _DARK_CURRENT,
    pixel_noise.SHOT_NOISE,
    pixel_noise.READ_NOISE,
    pixel_noise.NOISE_COLOUR,
    pixel_noise.DSNU,
    pixel_noise.COLUMN_NOISE,
    pixel_noise.ROW_NOISE,
    pixel_noise.HOT_PIXELS,
    _SATURATION,
    _BLOOMING,
    _SMOOTHING,
    _GAMMA,
    _BLACK_LEVEL,
    _QUANTISATION,
    _DROPPED_BITS,
)
