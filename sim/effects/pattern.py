"""Rows of the effect table for the projector's pattern (light stage)."""

from __future__ import annotations

from starling.sim.effects.effect import Effect, Parameter, Stage

RERENDER = "the pattern is in the layers"

SCALE = Effect(
    name="pattern_scale",
    family="pattern_scale",
    stage=Stage.LIGHT,
    parameters=(
        Parameter(
            name="scale",
            paths=("projector.pattern_scale",),
            unit="1",
            neutral=1.0,
            low=0.995,
            high=1.005,
        ),
    ),
    imitates="A diffractive projector whose wavelength drifts with temperature.",
    law=("Direction cosines about the emitter's axis are times scale = wavelength over nominal."),
    shows=(
        "Infrared differs from the template by f (s - 1) tan t / cos^2 t: 2.8 px at 35 deg of "
        "a D415 for 0.3 %. Stereo depth: bias within 0.01 px, noise 0.186 to 0.194 px. "
        "Structured light errs by up to 1.25 px (0.3 %); holes 8 % more at 0.3 %, 38 % at 0.5 "
        "%."
    ),
    confused_with=("projector_field", "projector_position", "projector_rotation", "wrong_pattern"),
    source="grating equation; 0.07 nm/K of a VCSEL, 0.3 of an edge emitter (usual figures)",
    rerender=RERENDER,
)

DROPPED = Effect(
    name="dropped_dots",
    family="pattern_error",
    stage=Stage.LIGHT,
    parameters=(
        Parameter(
            name="share",
            paths=("projector.dropped_dots",),
            unit="1",
            neutral=0.0,
            low=0.02,
            high=0.6,
        ),
    ),
    imitates="Dead emitters, or dirt on the projector's window.",
    law="Every dot is dark with probability share; its light is lost.",
    shows=(
        "Dots are missing at fixed places of the projector's frame, in both imagers. At 0.4: "
        "noise 0.31 px, bad pixels 9.7 % instead of 2.9, holes 7.5 %."
    ),
    confused_with=("projector_power", "wrong_pattern", "projector_field", "shifted_dots"),
    source="binomial draw; no published value of the share",
    rerender=RERENDER,
    drawn=True,
)

SHIFTED = Effect(
    name="shifted_dots",
    family="pattern_error",
    stage=Stage.LIGHT,
    parameters=(
        Parameter(
            name="sigma_mrad",
            paths=("projector.shifted_dots_mrad",),
            unit="mrad",
            neutral=0.0,
            low=0.3,
            high=8.0,
        ),
    ),
    imitates="Emitters or diffraction orders displaced from the assumed pattern.",
    law="Every dot is displaced on two axes by a normal deviate of sigma_mrad.",
    shows=(
        "Some dots merge, others leave gaps. At 6 mrad: stereo noise 0.20 px, no bias. "
        "Structured light errs by f sigma over the dots in its window, static in its frame."
    ),
    confused_with=("wrong_pattern", "dropped_dots"),
    source="normal deviates, assumed",
    rerender=RERENDER,
    drawn=True,
)

WRONG_PATTERN = Effect(
    name="wrong_pattern",
    family="pattern_error",
    stage=Stage.LIGHT,
    parameters=(
        Parameter(
            name="seed",
            paths=("projector.pattern_seed",),
            unit="1",
            neutral=None,
            choices=(0.0, 1.0, 2.0, 3.0),
        ),
    ),
    imitates="A pattern with the right statistics that is not this device's.",
    law="Another seed of the generator: other dots, other dark and displaced ones.",
    shows=(
        "Infrared and template do not correlate; left and right do. Each pixel's disparity "
        "changes by 0.13 px (median); total noise and holes do not."
    ),
    confused_with=(
        "projector_rotation",
        "projector_position",
        "shifted_dots",
        "projector_field",
        "dropped_dots",
    ),
    source="makers publish no patterns (librealsense#3997); see docs/decisions/0004-patterns.md",
    rerender=RERENDER,
)

ROWS: tuple[Effect, ...] = (
    SCALE,
    DROPPED,
    SHIFTED,
    WRONG_PATTERN,
)
