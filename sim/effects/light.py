"""Rows of the effect table for the light stage (projector).

The figures in `shows` were measured on `clutter` with the D435 preset. At neutral values the
disparity noise is 0.16 px (1.4826 times the median absolute deviation), and 6.5 % of the pixels
have no depth.
"""

from __future__ import annotations

from starling.sim.effects import pattern
from starling.sim.effects.effect import Effect, Parameter, Stage

_GOODMAN = "Goodman, Speckle Phenomena in Optics, 2007, ch. 3 and 4"

POWER = Effect(
    name="projector_power",
    family="signal_gain",
    stage=Stage.LIGHT,
    parameters=(
        Parameter(
            name="power_w",
            paths=("projector.power_w",),
            unit="W",
            neutral=None,
            low=0.02,
            high=0.45,
        ),
    ),
    imitates="The laser power: set by the user, reduced by age and dirt.",
    law="Laser light is proportional to power_w; ambient light stays. 0 is passive stereo.",
    shows=(
        "Dots are dimmer relative to ambient texture; auto exposure hides the level only. At "
        "a third of the power: noise 0.22 px, holes unchanged."
    ),
    confused_with=(
        "exposure",
        "gain",
        "flicker",
        "wavelength",
        "ambient",
        "nir_reflectance",
        "sunlight",
        "second_projector",
        "projector_field",
        "dropped_dots",
        "veil",
    ),
    source="librealsense src/ds/advanced_mode/presets.cpp: 150 mW by default; set from 0 to 360",
)

DOT_BLUR = Effect(
    name="dot_blur",
    family="dot_width",
    stage=Stage.LIGHT,
    parameters=(
        Parameter(
            name="sigma_mrad",
            paths=("projector.dot_blur_mrad",),
            unit="mrad",
            neutral=0.0,
            low=0.2,
            high=4.0,
        ),
    ),
    imitates="A projector lens that is poor, cold or scratched: every spot is wider.",
    law="A spot's variance in cosines is its own plus sigma_mrad^2, at all depths.",
    shows=(
        "Dots are wide and dim; edges and ambient texture stay sharp. At 3 mrad: no bias, "
        "holes unchanged, noise 0.14 px while light is plentiful."
    ),
    confused_with=("lens_blur", "dot_defocus", "subsurface", "crosstalk"),
    source="variances add under convolution; spot widths in docs/decisions/0004-patterns.md",
    rerender=pattern.RERENDER,
)

DOT_DEFOCUS = Effect(
    name="dot_defocus",
    family="dot_width",
    stage=Stage.LIGHT,
    parameters=(
        Parameter(
            name="sigma_mrad_m",
            paths=("projector.defocus_mrad_m",),
            unit="mrad m",
            neutral=0.0,
            low=0.1,
            high=1.5,
        ),
        Parameter(
            name="focus_m",
            paths=("projector.focus_m",),
            unit="m",
            neutral=None,
            low=0.3,
            high=4.0,
        ),
    ),
    imitates="A projector focused at one distance: spots elsewhere are wider.",
    law=("sigma = sigma_mrad_m |1/z - 1/focus_m| [mrad], in quadrature to the spot's own width."),
    shows=(
        "Near dots are wide. At 1.5 mrad m: a wall at 0.3 m loses half of its dots' contrast. "
        "At 1 to 2 m almost nothing changes."
    ),
    confused_with=("dot_blur", "near_defocus", "subsurface"),
    source="thin lens: a uniform aperture of width A blurs by sigma = A/4 |1/z - 1/focus|",
    rerender=pattern.RERENDER,
)

HAZE = Effect(
    name="projector_haze",
    family="projector_haze",
    stage=Stage.LIGHT,
    parameters=(
        Parameter(
            name="share",
            paths=("projector.haze",),
            unit="1",
            neutral=0.0,
            low=0.02,
            high=0.6,
        ),
    ),
    imitates="A diffractive element, a lens or a window that scatters light between the dots.",
    law=(
        "E = (1 - share) E_pattern + share times E_pattern's mean over the field. A generated "
        "preset pattern already has 0.3; a calibrated pattern has none."
    ),
    shows=(
        "Light between dots that, unlike ambient light, falls off with distance as they do. "
        "At 0.6: less than half of the dots' contrast, noise 0.088 to 0.096 px, holes 3.6 to "
        "3.8 %."
    ),
    confused_with=("veil", "ambient", "projector_power", "dot_blur", "subsurface"),
    source=(
        "a real D415 has 0.2 to 0.5 of its mean light between dots, part of it "
        "interreflection (docs/results/calibration.md)"
    ),
    rerender=pattern.RERENDER,
)

FALLOFF = Effect(
    name="projector_falloff",
    family="projector_falloff",
    stage=Stage.LIGHT,
    parameters=(
        Parameter(
            name="exponent",
            paths=("projector.falloff",),
            unit="1",
            neutral=0.0,
            low=0.5,
            high=6.0,
        ),
    ),
    imitates="Emitters and lens that give less light off the projector's axis.",
    law="E(a) = E(0) cos^n a about the projector's axis, beyond that of dots of equal power.",
    shows=(
        "Dots dim outwards in the projector's frame: the map shifts with distance and spares "
        "ambient light. n = 4: noise 0.20 px, all at the border."
    ),
    confused_with=("vignetting", "filter_shift"),
    source="usual form of an emitter's profile (Lambertian: n = 1)",
    rerender=pattern.RERENDER,
)

POSITION = Effect(
    name="projector_position",
    family="projector_pose",
    stage=Stage.LIGHT,
    parameters=tuple(
        Parameter(
            name=f"{axis}_m",
            paths=(f"projector.position_m.{axis}",),
            unit="m",
            neutral=None,
            low=low,
            high=high,
        )
        for axis, low, high in (("x", 0.0, 0.08), ("y", -0.005, 0.005), ("z", -0.005, 0.005))
    ),
    imitates="A projector displaced from its modelled position.",
    law="In the left image the pattern moves by f x/z.",
    shows=(
        "Infrared differs from the template by a shift that changes with depth; left and "
        "right still agree. Stereo depth has no bias (walls: under 0.01 px). Projector "
        "shadows change width."
    ),
    confused_with=("projector_rotation", "wrong_pattern", "pattern_scale", "projector_field"),
    source="parallax; public simulators of one camera put its projector at 28, 41 and 0 mm",
    rerender=pattern.RERENDER,
)

ROTATION = Effect(
    name="projector_rotation",
    family="projector_pose",
    stage=Stage.LIGHT,
    parameters=tuple(
        Parameter(
            name=f"{axis}_deg",
            paths=(f"projector.rotation_deg.{axis}",),
            unit="deg",
            neutral=None,
            low=-0.5,
            high=0.5,
        )
        for axis in "xyz"
    ),
    imitates="A projector turned by assembly, heat or a shock.",
    law="The pattern moves by f phi (1 + x^2) in the image, equally at every distance.",
    shows=(
        "Infrared differs from the template by one shift at all depths (roll: growing "
        "outwards). Stereo depth has no bias (walls: under 0.01 px). Structured light errs by "
        "the shift: 0.1 deg is 1.0 px for a Kinect."
    ),
    confused_with=("projector_position", "wrong_pattern", "pattern_scale"),
    source="rotation of a central projection",
    rerender=pattern.RERENDER,
)

FIELD = Effect(
    name="projector_field",
    family="projector_field",
    stage=Stage.LIGHT,
    parameters=(
        Parameter(
            name="x_deg",
            paths=("projector.fov_x_deg",),
            unit="deg",
            neutral=None,
            low=60.0,
            high=100.0,
        ),
        Parameter(
            name="y_deg",
            paths=("projector.fov_y_deg",),
            unit="deg",
            neutral=None,
            low=38.0,
            high=70.0,
        ),
    ),
    imitates="A projector that covers more or less than the data sheet says.",
    law=("The power spreads over 4 tan(x/2) tan(y/2) z^2; a generator draws other dots over it."),
    shows=(
        "The pattern ends inside the image with a straight edge that moves with depth, or its "
        "dots are dimmer. At 70 x 48 deg instead of 90 x 63: holes 32 % instead of 6.5."
    ),
    confused_with=("projector_power", "wrong_pattern", "dropped_dots", "pattern_scale"),
    source="sources disagree: D435 90 x 63 or 86 x 57 deg (FRAMOS D435e manual, p. 8)",
    rerender=pattern.RERENDER,
)

SPECKLE = Effect(
    name="laser_speckle",
    family="speckle",
    stage=Stage.LIGHT,
    parameters=(
        Parameter(
            name="contrast",
            paths=("projector.speckle_contrast",),
            unit="1",
            neutral=0.0,
            low=0.03,
            high=0.5,
        ),
    ),
    imitates="The grain of coherent light on rough surfaces.",
    law=(
        "Laser light times a gamma variate of mean 1 and shape 1/C^2, C = 1/sqrt(N) of N "
        "looks; grains of lambda F wide, averaged by the pixel."
    ),
    shows=(
        "Dots break into pixels; ambient light stays smooth. Left and right differ, repeated "
        "frames do not: noise that no temporal average removes. At 0.3: 0.24 px."
    ),
    confused_with=("prnu", "shot_noise"),
    source=f"{_GOODMAN}; C = 1/sqrt(N): J. Opt. Soc. Am. 66 (1976) 1145",
    drawn=True,
)

FLICKER = Effect(
    name="flicker",
    family="flicker",
    stage=Stage.LIGHT,
    parameters=(
        Parameter(
            name="deviation",
            paths=("projector.flicker",),
            unit="1",
            neutral=0.0,
            low=0.01,
            high=0.3,
        ),
    ),
    imitates="A laser whose power varies from frame to frame.",
    law=("Power of a frame = mean times a log-normal variate of that deviation, for both imagers."),
    shows=(
        "The dots' level jumps between frames, ambient light does not. One frame looks like "
        "another power. Disparity hardly moves (0.2: 0.03 px, median)."
    ),
    confused_with=("projector_power", "auto_exposure"),
    source="log-normal, assumed: a power is positive",
    drawn=True,
)

WAVELENGTH = Effect(
    name="wavelength",
    family="wavelength",
    stage=Stage.LIGHT,
    parameters=(
        Parameter(
            name="wavelength_nm",
            paths=("projector.wavelength_nm",),
            unit="nm",
            neutral=None,
            low=820.0,
            high=865.0,
        ),
    ),
    imitates="A laser that drifts with temperature, out of the imager's filter.",
    law=(
        "The filter passes less off its centre; photon energy and speckle grain follow "
        "lambda. Quantum efficiency is held, though silicon's falls by 0.8 % a nm. "
        "pattern_scale is separate."
    ),
    shows=(
        "With a filter: dots dim, in the corners first or last. Without: levels 1.8 % higher "
        "at 865 nm."
    ),
    confused_with=("projector_power", "filter_shift"),
    source="850 +-10 nm at 20 deg C (FRAMOS D435e manual, p. 8), 0.07 nm/K (assumed)",
)

ROWS: tuple[Effect, ...] = (
    POWER,
    DOT_BLUR,
    DOT_DEFOCUS,
    HAZE,
    FALLOFF,
    POSITION,
    ROTATION,
    FIELD,
    *pattern.ROWS,
    SPECKLE,
    FLICKER,
    WAVELENGTH,
)
