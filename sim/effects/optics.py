"""Rows of the effect table for the optics stage.

The figures in `shows` were measured on `tabletop` with the D435 preset's geometry, its blur of
0.6 px and little noise. At neutral values the disparity noise is 0.16 px (1.4826 times the median
absolute deviation), and 0.5 % of the pixels have no depth. Misalignment is that of the right imager
relative to the left.
"""

from __future__ import annotations

from starling.sim.effects.effect import Effect, Parameter, Stage

_HORN = "Horn, Robot Vision, sec. 10.3 (cos^4)"
_HOMOGRAPHY = "Hartley and Zisserman, Multiple View Geometry, 2nd ed., sec. 8.4.2"
_SELF_CALIBRATION = "Intel, Self-calibration for depth cameras; " + _HOMOGRAPHY


def _parameter(
    path: str, name: str, *, unit: str, neutral: float | None, low: float, high: float
) -> Parameter:
    return Parameter(name=name, paths=(path,), unit=unit, neutral=neutral, low=low, high=high)


LENS_BLUR = Effect(
    name="lens_blur",
    family="lens_blur",
    stage=Stage.OPTICS,
    parameters=(
        _parameter("imager.lens.blur_px", "sigma_px", unit="px", neutral=0.0, low=0.2, high=1.5),
    ),
    imitates="A wide lens spot: diffraction, aberrations, wrong fixed focus.",
    law="The image is convolved with a Gaussian; variances of dot, pixel and lens add.",
    shows=(
        "Everything is soft: edges and ambient texture as much as dots. At 1.5 px the dots' "
        "contrast falls by a fifth and holes grow to 0.7 %. Noise, 0.15 px, hardly changes "
        "while light is plentiful."
    ),
    confused_with=(
        "dot_blur",
        "corner_blur",
        "near_defocus",
        "motion",
        "turning",
        "subsurface",
        "crosstalk",
        "smoothing",
        "presmooth",
    ),
    source=(
        "variances add under convolution; discrete Gaussian: Lindeberg, IEEE TPAMI 12(3), 1990"
    ),
)

SPOT_SHAPE = Effect(
    name="spot_shape",
    family="spot_shape",
    stage=Stage.OPTICS,
    parameters=(
        _parameter("imager.lens.spot_shape", "shape", unit="1", neutral=0.0, low=-1.0, high=1.0),
    ),
    imitates="A lens whose spot is a disc, by defocus, or has tails, by scatter in glass.",
    law=(
        "A share |shape| of the light lies in a disc (shape < 0) or in exp(-r / a) (shape > 0), "
        "the rest in a Gaussian; all have the variance of the blur."
    ),
    shows=(
        "Finest contrast alone: a disc has less, tails more, at one width. At a blur of 1.5 px "
        "the dots' contrast is 0.214, 0.209 as a disc, 0.227 with tails; depth errors change by "
        "2 %. At 0.6 px a diagnosis does not see it."
    ),
    confused_with=("lens_blur", "crosstalk", "dot_blur"),
    source=(
        "disc: Potmesil and Chakravarty, ACM TOG 1(2), 1982; tails: limit of Moffat's profiles, "
        "Astron. Astrophys. 3 (1969) 455; share assumed"
    ),
)

CORNER_BLUR = Effect(
    name="corner_blur",
    family="lens_blur",
    stage=Stage.OPTICS,
    parameters=(
        _parameter(
            "imager.lens.corner_blur_px", "sigma_px", unit="px", neutral=0.0, low=0.2, high=2.0
        ),
    ),
    imitates="Coma and field curvature, which grow off the axis.",
    law="The spot's variance grows by sigma_px^2 (r / r_h)^2, r_h half the diagonal.",
    shows=(
        "Sharp in the middle, soft in the corners, at every depth and in all light. Depth "
        "hardly changes at 1.5 px."
    ),
    confused_with=("lens_blur", "near_defocus", "filter_shift"),
    source="Smith, Modern Optical Engineering, ch. 3: transverse aberrations grow with field",
)

NEAR_DEFOCUS = Effect(
    name="near_defocus",
    family="defocus",
    stage=Stage.OPTICS,
    parameters=(
        _parameter(
            "imager.lens.defocus_px_m", "sigma_px_m", unit="px m", neutral=0.0, low=0.05, high=0.5
        ),
        _parameter("imager.lens.focus_m", "focus_m", unit="m", neutral=None, low=0.3, high=5.0),
    ),
    imitates="A fixed-focus lens that is soft below half a metre.",
    law="sigma = k |1/z - 1/focus_m|; thin lens: k = f^2 / (4 N pitch), 0.10 px m for a D435.",
    shows=(
        "Near objects are soft. At 0.3 px m a wall at 0.25 m is blurred by 0.9 px, one at 1 m "
        "is not. Disparity of a wall at 0.3 m does not change at 0.5 px m."
    ),
    confused_with=("lens_blur", "dot_defocus", "corner_blur"),
    source="Potmesil and Chakravarty, ACM TOG 1(2), 1982, eqs. 1 to 5: circle of confusion",
)

VIGNETTING = Effect(
    name="vignetting",
    family="vignetting",
    stage=Stage.OPTICS,
    parameters=(
        _parameter("imager.lens.vignetting", "exponent", unit="1", neutral=0.0, low=0.5, high=4.0),
    ),
    imitates="A lens that passes less light off its axis.",
    law="Light falls as cos^n of the angle off the camera's axis; n = 4 for an ideal lens.",
    shows=(
        "Dark corners in dots and ambient light, independent of the scene. At n = 4 a fifth "
        "of the light remains in a D435's corner. Noise 0.18 px, no bias, no more holes."
    ),
    confused_with=("projector_falloff", "filter_shift"),
    source=_HORN,
)

FILTER_SHIFT = Effect(
    name="filter_shift",
    family="filter",
    stage=Stage.OPTICS,
    parameters=(
        _parameter(
            "imager.lens.filter_width_nm", "width_nm", unit="nm", neutral=0.0, low=30.0, high=150.0
        ),
        _parameter(
            "imager.lens.filter_centre_nm",
            "centre_nm",
            unit="nm",
            neutral=None,
            low=830.0,
            high=870.0,
        ),
        _parameter("imager.lens.filter_index", "index", unit="1", neutral=None, low=1.5, high=3.0),
    ),
    imitates="A thin-film band-pass filter: at an angle its band lies at shorter wavelengths.",
    law=(
        "Centre sqrt(1 - (sin a / index)^2) at angle a; transmission 1 / (1 + x^6), x the "
        "laser's offset in half widths. Width 0 is no filter."
    ),
    shows=(
        "Dots fade in the corners; ambient light rises there (17 % at 60 nm, 25 % at 150 nm). "
        "At 60 nm a D435 loses 9 % of its depth, nearly half of it at the right edge; at 30 "
        "nm 42 %; at 150 nm almost none."
    ),
    confused_with=("projector_falloff", "vignetting", "wavelength", "corner_blur"),
    source="Smith, Modern Optical Engineering, sec. 11; docs/decisions/0007-spectra.md",
)

VEIL = Effect(
    name="veil",
    family="veil",
    stage=Stage.OPTICS,
    parameters=(
        _parameter("imager.lens.veil", "share", unit="1", neutral=0.0, low=0.005, high=0.1),
    ),
    imitates="Light scattered in lens, cover glass and housing: veiling glare.",
    law="L' = (1 - share) L + share mean(L).",
    shows=(
        "A pedestal that follows the image's mean, not the albedo: black is grey. At 5 % dots "
        "lose 5 % of their contrast; depth hardly changes."
    ),
    confused_with=("black_level", "projector_power", "ambient", "interreflection"),
    source="veiling glare index: ISO 9358; 1 to 5 % assumed for small lenses behind a window",
)

DISTORTION = Effect(
    name="distortion",
    family="distortion",
    stage=Stage.OPTICS,
    parameters=(
        _parameter(
            "right.alignment.distortion_px", "shift_px", unit="px", neutral=0.0, low=-0.5, high=0.5
        ),
    ),
    imitates="Radial distortion of one imager that remains after rectification.",
    law="A point lands outwards by shift_px (r / r_h)^3, r_h half the diagonal.",
    shows=(
        "A smooth disparity error, equal at all depths, of opposite sign at left and right. "
        "At 0.5 px: +0.24 and -0.20 px at 60 px from the edges, none in the middle. Infrared "
        "and holes look perfect."
    ),
    confused_with=("yaw", "roll"),
    source="Hartley and Zisserman, Multiple View Geometry, 2nd ed., sec. 7.4; range assumed",
)

VERTICAL_OFFSET = Effect(
    name="vertical_offset",
    family="vertical_offset",
    stage=Stage.OPTICS,
    parameters=(
        _parameter(
            "right.alignment.offset_y_px", "offset_px", unit="px", neutral=0.0, low=-1.5, high=1.5
        ),
    ),
    imitates="Rows that do not correspond: heat or shock moved an imager.",
    law="The right image lies lower by offset_px.",
    shows=(
        "The left-right correlation peaks off the row. Bias depends on texture (-0.06 px at 1 "
        "px). Noise 0.41 px at 1 px, 0.58 at 1.5, then holes. Diagonally elongated dots bias "
        "opposite corners equally: 0.6 to 1.4 px at 1.5 px."
    ),
    confused_with=("pitch", "roll"),
    source=_SELF_CALIBRATION,
)

ROLL = Effect(
    name="roll",
    family="roll",
    stage=Stage.OPTICS,
    parameters=(
        _parameter(
            "right.alignment.roll_deg", "angle_deg", unit="deg", neutral=0.0, low=-0.3, high=0.3
        ),
    ),
    imitates="Imagers rotated relative to each other about their optical axes.",
    law="A point moves by angle (y, -x) from the principal point.",
    shows=(
        "Disparity errs in proportion to the row: flat objects tilt. At 0.3 deg: 1.2 px at "
        "top and bottom. Rows differ by opposite signs at left and right, with holes there."
    ),
    confused_with=("vertical_offset", "pitch", "distortion", "rolling_shutter", "model_turn"),
    source=_SELF_CALIBRATION,
)

PITCH = Effect(
    name="pitch",
    family="vertical_offset",
    stage=Stage.OPTICS,
    parameters=(
        _parameter(
            "right.alignment.pitch_deg", "angle_deg", unit="deg", neutral=0.0, low=-0.2, high=0.2
        ),
    ),
    imitates="One imager that looks higher than the other.",
    law="The image moves down by f angle (1 + y^2 / f^2) and sideways by x y angle / f.",
    shows=(
        "As vertical_offset: 0.2 deg is 1.5 px for a D435, noise 0.44 px, 5 % holes. In the "
        "corners the sideways shift removes a quarter of the bias."
    ),
    confused_with=("vertical_offset", "roll"),
    source=_SELF_CALIBRATION,
)

DISPARITY_OFFSET = Effect(
    name="disparity_offset",
    family="disparity_offset",
    stage=Stage.OPTICS,
    parameters=(
        _parameter(
            "right.alignment.offset_x_px", "offset_px", unit="px", neutral=0.0, low=-1.0, high=1.0
        ),
    ),
    imitates="A right image that rectification leaves too far right.",
    law="d' = d - offset_px, so depth errs by z^2 offset_px / (f b).",
    shows=(
        "One disparity bias everywhere; depth errs with the square of distance. Infrared, "
        "noise and holes look perfect."
    ),
    confused_with=("yaw", "focal_scale", "baseline_error", "model_shift", "model_scale"),
    source=_SELF_CALIBRATION,
)

YAW = Effect(
    name="yaw",
    family="disparity_offset",
    stage=Stage.OPTICS,
    parameters=(
        _parameter(
            "right.alignment.yaw_deg", "angle_deg", unit="deg", neutral=0.0, low=-0.1, high=0.1
        ),
    ),
    imitates="A right imager that is rotated outwards, to the right.",
    law="d' = d + f angle (1 + x^2 / f^2): an offset that grows slightly off the axis.",
    shows=(
        "0.1 deg biases a D435 by 0.76 px in the middle, 1.25 px at 60 px from the edges. "
        "Otherwise as disparity_offset."
    ),
    confused_with=("disparity_offset", "distortion", "focal_scale"),
    source=_SELF_CALIBRATION,
)

FOCAL_SCALE = Effect(
    name="focal_scale",
    family="scale",
    stage=Stage.OPTICS,
    parameters=(
        _parameter(
            "imager.alignment.magnification", "factor", unit="1", neutral=1.0, low=0.98, high=1.02
        ),
    ),
    imitates="Lenses that heat has lengthened: both focal lengths differ from the stored.",
    law="d' = factor d, so z' = z / factor.",
    shows=(
        "On facing surfaces disparity errs in proportion to itself (2 %: 0.3 px at 1.3 m). "
        "Objects seem wider too, so a tilted plane errs evenly; a baseline error does "
        "neither."
    ),
    confused_with=("baseline_error", "disparity_offset", "model_scale", "yaw", "pattern_scale"),
    source=(
        "Calvert 2018, Improving the depth map accuracy of RealSense cameras: one D435 read "
        "980.7 mm at 1000 mm"
    ),
)

ROWS: tuple[Effect, ...] = (
    LENS_BLUR,
    SPOT_SHAPE,
    CORNER_BLUR,
    NEAR_DEFOCUS,
    VIGNETTING,
    FILTER_SHIFT,
    VEIL,
    DISTORTION,
    VERTICAL_OFFSET,
    ROLL,
    PITCH,
    DISPARITY_OFFSET,
    YAW,
    FOCAL_SCALE,
)
