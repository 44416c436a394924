"""Rows of the effect table for the noise and the fixed patterns of an imager.

`imager` says what the figures in `shows` were measured on.
"""

from __future__ import annotations

from starling.sim.effects.effect import Effect, Parameter, Stage

EMVA = "EMVA Standard 1288, release 4.0"
IMX900 = "Sony IMX900 (global shutter, 2.25 um; EMVA report by FRAMOS)"


def imager_parameter(
    name: str, field: str, unit: str, neutral: float | None, low: float, high: float
) -> tuple[Parameter]:
    """Return the parameter that sets one field of both imagers."""
    path = (f"imager.{field}",)
    return (Parameter(name=name, paths=path, unit=unit, neutral=neutral, low=low, high=high),)


SHOT_NOISE = Effect(
    name="shot_noise",
    family="shot_noise",
    stage=Stage.IMAGER,
    parameters=imager_parameter("share", "shot_noise", "1", 0.0, 0.3, 1.0),
    imitates="Photons arrive one by one; a share below 1 models a device that averages.",
    law="temporal variance [electrons^2] = share^2 (light + dark electrons)",
    shows=(
        "Temporal deviation grows as the root of the level; frames average it out. Without it "
        "temporal disparity noise falls from 0.066 to 0.023 px."
    ),
    confused_with=("read_noise", "gain", "saturation", "laser_speckle", "smoothing"),
    source=f"{EMVA}, photon transfer; {IMX900}: 2.5 electrons a step of 12 bits",
)

READ_NOISE = Effect(
    name="read_noise",
    family="read_noise",
    stage=Stage.IMAGER,
    parameters=imager_parameter("deviation_e", "read_noise_e", "electrons", 0.0, 1.0, 150.0),
    imitates="Amplifier and reset noise of each pixel's read-out.",
    law="temporal variance [electrons^2] = read^2 at every level",
    shows=(
        "Temporal deviation also in black areas; frames average it out. At 8 bits 5 electrons "
        "are invisible. At 150: 3.4 DN of temporal noise, disparity noise 0.066 to 0.115 px, "
        "0.3 % more holes in the dark."
    ),
    confused_with=("shot_noise", "dsnu", "row_noise", "gain", "dark_current", "quantisation"),
    source=f"{EMVA}; {IMX900}: 5.6 electrons (1.95 at high conversion gain)",
)

NOISE_COLOUR = Effect(
    name="noise_colour",
    family="noise_colour",
    stage=Stage.IMAGER,
    parameters=imager_parameter("correlation", "noise_correlation", "1", 0.0, 0.1, 0.8),
    imitates="Noise that rectification and scaling correlate between adjacent pixels.",
    law=(
        "shot and read noise of the same variance, correlated by I_m(2t) I_n(2t) / I_0(2t)^2 at "
        "m columns and n rows; adjacent pixels have I_1 / I_0 = correlation"
    ),
    shows=(
        "Grain of several pixels while edges stay sharp: a matcher's window averages it less. "
        "With 40 electrons of read noise the disparity error grows from 0.172 to 0.204 px at "
        "0.3, to 0.277 px at 0.8; holes 8.4 to 9.5 and 14.7 %."
    ),
    confused_with=("smoothing", "shot_noise", "read_noise"),
    source="two discrete Gaussians in a row are one: Lindeberg, IEEE TPAMI 12(3), 1990",
)

PRNU = Effect(
    name="prnu",
    family="sensitivity_pattern",
    stage=Stage.IMAGER,
    parameters=imager_parameter("share", "prnu", "1", 0.0, 0.003, 0.1),
    imitates=(
        "Unequal sensitivity of pixels (photo response non-uniformity), fixed for each device."
    ),
    law="electrons x (1 + share n), n standard normal for each pixel, from the unit's number",
    shows=(
        "A static pattern that grows with the level. At 3 % the disparity error's spread over "
        "the image goes from 0.106 to 0.145 px; temporal noise does not grow. At 10 % 0.7 % "
        "more holes."
    ),
    confused_with=("dsnu", "column_noise", "laser_speckle"),
    source=f"{EMVA}; {IMX900}: 0.7 to 0.8 %; Sony IMX492 (EMVA report by LUCID): 0.62 %",
    drawn=True,
)

FIXED_PATTERN = Effect(
    name="fixed_pattern",
    family="fixed_pattern",
    stage=Stage.IMAGER,
    parameters=(
        *imager_parameter("contrast", "pattern_contrast", "1", 0.0, 0.005, 0.1),
        *imager_parameter("length_px", "pattern_px", "px", None, 2.0, 60.0),
    ),
    imitates=(
        "Films, dust and interference in cover glass and silicon: sensitivity that varies over "
        "several pixels, fixed for each device."
    ),
    law=(
        "electrons x max(1 + contrast g, 0), g smooth and normal, of correlation exp(-(d / "
        "length_px)^2) at distance d, from the unit's number"
    ),
    shows=(
        "Static clouds in dots and ambient light, different in left and right. At 1 % and a "
        "length of 8 px the disparity error grows from 0.088 to 0.111 px; at 5 % to 0.207 px, "
        "holes 3.6 to 6.4 %. Lengths of 2 and 30 px give 0.257 and 0.114 px."
    ),
    confused_with=("prnu", "column_noise", "dsnu", "laser_speckle"),
    source=f"{EMVA}: a high-pass separates the slow photo response from PRNU; range assumed",
    drawn=True,
)

DSNU = Effect(
    name="dsnu",
    family="offset_pattern",
    stage=Stage.IMAGER,
    parameters=imager_parameter("deviation_e", "dsnu_e", "electrons", 0.0, 1.0, 60.0),
    imitates="Unequal offset of pixels (dark signal non-uniformity), fixed for each device.",
    law="electrons + deviation n, n standard normal for each pixel, from the unit's number",
    shows=(
        "A static pattern, equal at all levels, visible in dark frames. At 8 bits 4 electrons "
        "are invisible. At 40 (1 DN): static disparity error 0.106 to 0.124 px, temporal "
        "noise unchanged."
    ),
    confused_with=("prnu", "read_noise", "column_noise", "hot_pixels"),
    source=f"{EMVA}; {IMX900}: 3.7 electrons (1.3 at high conversion gain); IMX492: 0.97",
    drawn=True,
)

COLUMN_NOISE = Effect(
    name="column_noise",
    family="column_noise",
    stage=Stage.IMAGER,
    parameters=imager_parameter("deviation_e", "column_noise_e", "electrons", 0.0, 1.0, 40.0),
    imitates="Unequal offsets of the column amplifiers, fixed for each device.",
    law="electrons + deviation n, n standard normal for each column, from the unit's number",
    shows=(
        "Static vertical stripes in dark parts, different in left and right. At 40 electrons "
        "(1 DN): static error 0.106 to 0.179 px, 0.3 % less depth."
    ),
    confused_with=("dsnu", "prnu", "row_noise"),
    source=f"{EMVA}, column variance (release 4.0); range assumed",
    drawn=True,
)

ROW_NOISE = Effect(
    name="row_noise",
    family="row_noise",
    stage=Stage.IMAGER,
    parameters=imager_parameter("deviation_e", "row_noise_e", "electrons", 0.0, 1.0, 40.0),
    imitates="Noise of a shared reference or supply during a row's read-out.",
    law="electrons + deviation n, n standard normal for each row of each frame",
    shows=(
        "Horizontal lines that change from frame to frame. At 40 electrons (1 DN): temporal "
        "noise 1.2 to 1.5 DN, 0.26 % more holes. Disparity noise does not rise: the offset is "
        "constant along the search."
    ),
    confused_with=("read_noise", "column_noise"),
    source=f"{EMVA}, row variance; bands on an OV9282 by its supply (luxonis/depthai-core#740)",
    drawn=True,
)

HOT_PIXELS = Effect(
    name="hot_pixels",
    family="hot_pixels",
    stage=Stage.IMAGER,
    parameters=imager_parameter("share", "hot_pixels", "1", 0.0, 1e-5, 1e-2),
    imitates="Defect pixels that are always full, fixed for each device.",
    law="charge = full well in a fixed random share of the pixels",
    shows=(
        "Single pixels at the ceiling in every scene, emitter on or off. Errors have the size "
        "of the matcher's window. At 0.001: spread 0.106 to 0.111 px; at 0.01: 0.151 px, 0.2 "
        "% more holes."
    ),
    confused_with=("dsnu",),
    source=f"{EMVA}, defect pixels; 1e-5 to 1e-3 is typical, assumed",
    drawn=True,
)
