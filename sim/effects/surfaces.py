"""Rows of the effect table for surfaces and other light sources (scene stage).

The figures in `shows` were measured on `tabletop` under 0.1 W m^-2, with the D415 preset's geometry
and reduced noise. Only points that both imagers and the projector see count. Without effects,
98.7 % of all points have depth, with a disparity noise of 0.09 px (1.4826 times the median absolute
deviation). On the objects it is 95.0 % and 0.12 px. The unmodified preset has 0.15 px, and 0.11 px
without speckle.
"""

from __future__ import annotations

from starling.sim.effects.effect import Effect, Parameter, Stage

_ROUGHNESS = Parameter(
    name="roughness", paths=("scene.finish.roughness",), unit="1", neutral=0.1, low=0.03, high=0.6
)
_WALTER = "Walter et al., Microfacet models for refraction through rough surfaces, 2007"

NIR_REFLECTANCE = Effect(
    name="nir_reflectance",
    family="reflectance",
    stage=Stage.SCENE,
    parameters=(
        Parameter(
            name="scale",
            paths=("scene.finish.reflectance_scale",),
            unit="1",
            neutral=1.0,
            low=0.1,
            high=10.0,
        ),
    ),
    imitates="A reflectance taken from visible colours: black dye is bright in the near infrared.",
    law="Diffuse reflectance is the material's times scale, at most 1, under every light.",
    shows=(
        "A body's level differs from its model by one factor, in dots and ambient texture. At "
        "0.2: noise 0.14 px on objects, fill unchanged. Auto exposure hides a common factor."
    ),
    confused_with=("projector_power", "ambient_gradient", "transparency"),
    source="docs/materials.md: black nylon returns 0.35 at 850 nm, carbon black 0.03",
    rerender="reflectance is within the rendered layers",
)

SPECULAR = Effect(
    name="specular",
    family="specular",
    stage=Stage.SCENE,
    parameters=(
        Parameter(
            name="share",
            paths=("scene.finish.gloss",),
            unit="1",
            neutral=0.0,
            low=0.1,
            high=1.0,
        ),
        _ROUGHNESS,
    ),
    imitates="Varnish, glaze, polished floor: a clear coat over a matt base.",
    law=("f = (1 - share) f_material + share f_coat; the coat has a GGX lobe of slope roughness."),
    shows=(
        "Highlights mirror the projector, at other places in left and right; other dots are "
        "dimmer (10.8 to 8.0 DN at share 1). Over 1 px: 3.0 to 3.2 % of objects. Holes hardly "
        "change."
    ),
    confused_with=("metal",),
    source=f"{_WALTER}, eq. 20 and 33; librealsense issue 10229 (epoxy floors)",
    rerender="highlights depend on where imager and projector stand",
)

METAL = Effect(
    name="metal",
    family="bare_metal",
    stage=Stage.SCENE,
    parameters=(
        Parameter(
            name="share",
            paths=("scene.finish.metal",),
            unit="1",
            neutral=0.0,
            low=0.1,
            high=1.0,
        ),
        _ROUGHNESS,
    ),
    imitates="Bare metal: it reflects close to the mirror direction.",
    law="f = (1 - share) f_material + share f_metal, a GGX lobe of slope roughness.",
    shows=(
        "A few glaring dots, the rest dark, different in left and right. At share 1: no depth "
        "in 24 % of the image (without 4 %), noise 0.13 px. At 0.5 dots are only dimmer (7.7 "
        "DN)."
    ),
    confused_with=("specular",),
    source=f"{_WALTER}, eq. 20 and 33",
    rerender="highlights depend on where imager and projector stand",
)

TRANSPARENCY = Effect(
    name="transparency",
    family="transparency",
    stage=Stage.SCENE,
    parameters=(
        Parameter(
            name="share",
            paths=("scene.finish.transparency",),
            unit="1",
            neutral=0.0,
            low=0.05,
            high=0.95,
        ),
    ),
    imitates=(
        "Film, gauze, thin plastic: part of the light passes straight through, without refraction."
    ),
    law="L = (1 - t) L_front + t L_behind; the projector's light passes twice: t^2.",
    shows=(
        "Depth of the background, or between, at the body's pixels: wrong, not missing. Share "
        "0.5: 67 % of the objects' pixels over 1 px, 92 % filled. At 0.9: 96 % over, 98 % "
        "filled. The body's dots are dim."
    ),
    confused_with=("nir_reflectance", "model_shift"),
    source="geometry; librealsense issues 2550 and 7570 (glass and clear plastic)",
    rerender="what lies behind must be rendered",
)

SUBSURFACE = Effect(
    name="subsurface",
    family="subsurface",
    stage=Stage.SCENE,
    parameters=(
        Parameter(
            name="sigma_m",
            paths=("scene.finish.subsurface_m",),
            unit="m",
            neutral=0.0,
            low=2e-4,
            high=0.005,
        ),
    ),
    imitates="Wax, skin, marble, milky plastic: light spreads inside before it returns.",
    law="The projector's light on a body is blurred by sigma = fx sigma_m / z pixels.",
    shows=(
        "Dots are wide and dim on the body alone, wider when near; ambient texture stays. At "
        "1 mm: 8.0 of 10.8 DN. At 3 mm: 2.5 DN, 0.23 px on objects, 90 % filled. At 10 mm: 67 "
        "% filled."
    ),
    confused_with=("dot_blur", "dot_defocus", "lens_blur", "interreflection"),
    source=(
        "Jensen et al., A practical model for subsurface light transport, 2001, eq. 4 and table"
    ),
)

TEXTURE = Effect(
    name="texture",
    family="texture",
    stage=Stage.SCENE,
    parameters=(
        Parameter(
            name="contrast",
            paths=("scene.finish.texture_contrast",),
            unit="1",
            neutral=0.0,
            low=0.02,
            high=0.5,
        ),
        Parameter(
            name="slope",
            paths=("scene.finish.texture_slope",),
            unit="1",
            neutral=3.0,
            low=0.5,
            high=4.5,
        ),
    ),
    imitates="Print, wood grain, weave, dirt: reflectance that varies over a surface.",
    law=(
        "Light times 1 + contrast g(p), at least 0, at the body's point p. g has unit variance and "
        "wavelengths of 1 to 128 mm; its power density on a plane falls as f^-slope."
    ),
    shows=(
        "Both imagers see it at the same surface points, with the projector on or off. Dots on: "
        "noise 0.137 px, 0.115 at contrast 0.2, 0.096 at 0.5. Dots off: 81 % without depth, 4 % "
        "at 0.05, 2 % at 0.2."
    ),
    confused_with=("dropped_dots", "laser_speckle", "nir_reflectance", "prnu"),
    source=(
        "five rooms of a D415: contrast 0.06 (quartiles 0.02 and 0.20), slope 3.0 (2.4 and 3.7), "
        "docs/results/simulation.md; power laws: Field, J. Opt. Soc. Am. A 4 (1987) 2379"
    ),
)

SUNLIGHT = Effect(
    name="sunlight",
    family="ambient",
    stage=Stage.SCENE,
    parameters=(
        Parameter(
            name="irradiance_w_m2",
            paths=("scene.sun.irradiance_w_m2",),
            unit="W m^-2",
            neutral=0.0,
            low=0.2,
            high=50.0,
        ),
    ),
    imitates="Sun: light from one direction, with sharp shadows.",
    law="L = f E cos(theta) where the sun is not occluded; the dots' amplitude stays.",
    shows=(
        "Shading and sharp shadows that remain with the projector off; auto exposure dims the "
        "dots. At 3 W m^-2 (28 times the projector at 1 m): noise 0.23 px, objects 87 % "
        "filled. At 30 W m^-2: all 50 % filled."
    ),
    confused_with=("ambient", "projector_power"),
    source=(
        "ASTM G173 in the band of the imager (starling.sim.scene.spectra); librealsense issue 10022"
    ),
    rerender="shadows depend on the sun's direction; its strength moves freely",
)

SECOND_PROJECTOR = Effect(
    name="second_projector",
    family="second_projector",
    stage=Stage.SCENE,
    parameters=(
        Parameter(
            name="power_w",
            paths=("scene.other_projector.power_w",),
            unit="W",
            neutral=0.0,
            low=0.03,
            high=2.0,
        ),
        Parameter(
            name="x",
            paths=("scene.other_projector.position_m.x",),
            unit="m",
            neutral=0.2,
            low=-0.5,
            high=0.5,
        ),
    ),
    imitates="Another depth camera that looks at the same scene.",
    law="Its light on a surface point is the same for both imagers and adds to the rest.",
    shows=(
        "More dots, on the same surface points in left and right. Same power: noise 0.083 px "
        "(was 0.088), no depth 3.7 % (was 3.6). Ten times: 0.083 px, 3.8 %."
    ),
    confused_with=("projector_power", "ambient"),
    source="librealsense issues 6607 (no harm by design) and 8592 (beats between exposures)",
    rerender="its dots are rendered; its power moves freely",
)

ROWS: tuple[Effect, ...] = (
    NIR_REFLECTANCE,
    SPECULAR,
    METAL,
    TRANSPARENCY,
    SUBSURFACE,
    TEXTURE,
    SUNLIGHT,
    SECOND_PROJECTOR,
)
