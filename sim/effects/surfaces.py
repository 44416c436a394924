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
        "Infrared: a material's level differs from its model, by the same factor in dots and "
        "ambient texture; it depends on the body, not on the position. At 0.2: noise 0.14 px on "
        "objects, fill as before; auto exposure hides a change that all bodies share."
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
    imitates="Varnish, glaze, a tiled or polished floor: a clear coat over a matt base.",
    law="f = (1 - share) f_material + share f_coat; the coat has a GGX lobe of slope roughness.",
    shows=(
        "Infrared: highlights where the projector's light mirrors towards an imager, at other "
        "places in left and right; dots elsewhere dimmer (high-passed deviation 10.8 to 8.0 DN at "
        "share 1). Holes hardly move; wrong by more than 1 px: 3.0 to 3.2 % on objects."
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
    imitates="Bare metal: it reflects light close to the mirror direction.",
    law="f = (1 - share) f_material + share f_metal, a GGX lobe of slope roughness.",
    shows=(
        "Infrared: a few glaring dots, the rest dark; it differs between left and right. At share "
        "1 no depth in 24 % of the image (without 4 %), noise 0.13 px; at share 0.5 only dimmer "
        "dots (7.7 DN). Holes on the bodies' flanks."
    ),
    confused_with=("specular",),
    source=f"{_WALTER}, eq. 20 and 33; the base colour is the material's reflectance",
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
    imitates="Film, gauze, thin plastic: part of the light goes straight through.",
    law="L = (1 - t) L_front + t L_behind; the projector's light passes twice: t^2.",
    shows=(
        "Disparity: what lies behind, or between, at the body's pixels: bimodal, bias towards the "
        "background. Share 0.5: 67 % of the objects' pixels off by more than 1 px, filled to 92 %; "
        "0.9: 96 % off, filled to 98 %. Depth that is wrong, not missing, and the body's own dots "
        "dim. Nothing is refracted: for that there are bodies of glass."
    ),
    confused_with=("nir_reflectance", "model_shift"),
    source="geometry; librealsense issues 2550 and 7570 (glass and clear plastic)",
    rerender="what lies behind has to be seen",
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
        "Infrared: dots wide and dim on the body alone, wider in pixels the nearer it is; ambient "
        "texture stays. 1 mm: dots 8.0 of 10.8 DN, noise as before; 3 mm: 2.5 DN, 0.23 px on "
        "objects, filled to 90 %; 10 mm: filled to 67 %."
    ),
    confused_with=("dot_blur", "dot_defocus", "lens_blur", "interreflection"),
    source="Jensen et al., A practical model for subsurface light transport, 2001, eq. 4 and table",
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
    imitates="Sun through a window or out of doors: one direction, sharp shadows.",
    law="L = f E cos(theta) where the sun is not occluded; dots keep their amplitude before noise.",
    shows=(
        "Infrared: shading and shadows with sharp borders that stay where they are with the "
        "projector off; exposure goes down and takes the dots along. 3 W m^-2 (28 times the "
        "projector's mean at 1 m): noise 0.23 px, objects filled to 87 %; 30: all filled to 50 %. "
        "An exposure held at 8.5 ms is full at 50: depth stays in shadows."
    ),
    confused_with=("ambient", "projector_power"),
    source=(
        "ASTM G173 in the band of the imager (starling.sim.scene.spectra); librealsense issue 10022"
    ),
    rerender="shadows depend on the sun's direction; its strength alone does not",
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
        "Infrared: more dots, on the same surface points in left and right, where the camera's own "
        "pattern has none. Same power: noise 0.083 px, was 0.088; no depth 3.7 %, was 3.6. Ten "
        "times: 0.083 px, 3.8 %."
    ),
    confused_with=("projector_power", "ambient"),
    source="librealsense issues 6607 (no harm by design) and 8592 (beats between exposures)",
    rerender="its dots are rendered; its power alone would not need it",
)

ROWS: tuple[Effect, ...] = (
    NIR_REFLECTANCE,
    SPECULAR,
    METAL,
    TRANSPARENCY,
    SUBSURFACE,
    SUNLIGHT,
    SECOND_PROJECTOR,
)
