"""Rows of the effect table for ambient light, motion and errors of the scene model (scene stage).

The figures in `shows` were measured on `tabletop` under 0.1 W m^-2, with the D435 preset at
848x480, without speckle and with 8-bit matching. The reference is the scene as modelled, at points
that both imagers and the projector see. Without effects, 99.0 % of all points have depth, with a
disparity noise of 0.14 px (1.4826 times the median absolute deviation). On the objects it is 94.7 %
and 0.18 px. Motion was measured in an exposure of 8.5 ms.
"""

from __future__ import annotations

from starling.sim.effects.effect import Effect, Parameter, Stage

_AXES = ("x", "y", "z")


def _components(path: str, unit: str, most: float) -> tuple[Parameter, ...]:
    """Return the parameters of the three components of a vector of the scene."""
    return tuple(
        Parameter(
            name=axis,
            paths=(f"{path}.{axis}",),
            unit=unit,
            neutral=0.0,
            low=-most,
            high=most,
        )
        for axis in _AXES
    )


AMBIENT = Effect(
    name="ambient",
    family="ambient",
    stage=Stage.SCENE,
    parameters=(
        Parameter(
            name="irradiance_w_m2",
            paths=("scene.ambient.irradiance_w_m2",),
            unit="W m^-2",
            neutral=0.0,
            low=0.01,
            high=25.0,
        ),
    ),
    imitates=(
        "Daylight and lamps: light in the imager's band that does not come from the projector."
    ),
    law="L = rho / pi E (1 + 2/3 g n . up); dots keep their amplitude before noise and exposure.",
    shows=(
        "Infrared: the level between dots rises with the albedo; auto exposure shortens and the "
        "dots' contrast falls with it. Disparity: noise 0.30 px at 1 W m^-2, 0.65 at 5, 1.2 at 20. "
        "Holes: fill 98 %, 79 %, 42 %, plain walls first; objects with edges stay at 95 %. Time: "
        "steady but for more shot noise. An exposure held at 8.5 ms is full at 25 W m^-2."
    ),
    confused_with=(
        "ambient_gradient",
        "sunlight",
        "veil",
        "black_level",
        "projector_power",
        "interreflection",
        "second_projector",
    ),
    source="Sky of even radiance on a matt surface: Horn, Robot Vision, sec. 10.8",
)

AMBIENT_GRADIENT = Effect(
    name="ambient_gradient",
    family="ambient_gradient",
    stage=Stage.SCENE,
    parameters=(
        Parameter(
            name="gradient",
            paths=("scene.ambient.gradient",),
            unit="1",
            neutral=0.0,
            low=0.1,
            high=1.0,
        ),
    ),
    imitates="Light that comes from above more than from below.",
    law="Sky of radiance L0 (1 + g w . up): a surface of normal n receives (1 + 2/3 g n . up).",
    shows=(
        "Infrared: tops brighter than undersides by (1 + 2g/3) / (1 - 2g/3), depending on the "
        "normal and not on the position. Disparity, holes: at 1 W m^-2 noise 0.28 px without, 0.32 "
        "px with g = 1."
    ),
    confused_with=("ambient", "nir_reflectance"),
    source="Integral of the cosine over the hemisphere; closed form",
    rerender="the tilt of the sky is within the ambient layer",
)

INTERREFLECTION = Effect(
    name="interreflection",
    family="interreflection",
    stage=Stage.SCENE,
    parameters=(
        Parameter(
            name="strength",
            paths=("scene.interreflection",),
            unit="1",
            neutral=0.0,
            low=0.2,
            high=1.0,
        ),
    ),
    imitates="Laser light that reaches a surface via other surfaces: bright corners.",
    law="E = E_direct + F rho E, the radiosity equation; all bounces, for matt surfaces.",
    shows=(
        "Infrared: a smooth pedestal next to bright objects, gone a hand's breadth away; dots' "
        "contrast 0.5 % less over the image. Disparity, holes: no change above 0.01 px or 0.1 %. "
        "Unlike ambient light it goes out with the projector."
    ),
    confused_with=("veil", "ambient", "subsurface"),
    source="Goral et al., Modeling the interaction of light between diffuse surfaces, 1984, eq. 1",
    rerender="the indirect layer is rendered once; its strength then moves freely",
)

MOTION = Effect(
    name="motion",
    family="motion",
    stage=Stage.SCENE,
    parameters=_components("scene.motion.velocity_m_s", "m/s", 3.0),
    imitates="A sensor on a hand, a robot, a vehicle.",
    law="A point at z smears by f v t / z; motion along the axis smears along the radius.",
    shows=(
        "Infrared: edges and albedo texture smear by direction and nearness; dots on surfaces that "
        "face the sensor stay sharp, as they travel with it. Disparity: at 3 m/s sideways objects "
        "0.23 px of noise and 7.8 % over 1 px, walls as before; at 3 m/s forwards nothing. Holes: "
        "at edges of depth, 1.3 % more of the objects. Time: more in long exposures."
    ),
    confused_with=("turning", "lens_blur"),
    source="Pinhole geometry; closed form",
    rerender="an exposure is the average of many views",
)

TURNING = Effect(
    name="turning",
    family="motion",
    stage=Stage.SCENE,
    parameters=_components("scene.motion.turn_deg_s", "deg/s", 180.0),
    imitates="A sensor that is panned, tilted or rolled during the exposure.",
    law="About x or y the image smears by f w t, equally at all depths; about z by r w t.",
    shows=(
        "Infrared: albedo texture smears equally near and far; dots stay sharp. Disparity: at 90 "
        "deg/s about y no change above 0.01 px, 0.1 % more over 1 px. Holes: 0.2 % more."
    ),
    confused_with=("motion", "lens_blur"),
    source="Pinhole geometry; closed form",
    rerender="an exposure is the average of many views",
)

ROLLING_SHUTTER = Effect(
    name="rolling_shutter",
    family="rolling_shutter",
    stage=Stage.SCENE,
    parameters=(
        Parameter(
            name="readout_s",
            paths=("imager.rolling_shutter_s",),
            unit="s",
            neutral=0.0,
            low=2e-3,
            high=33e-3,
        ),
    ),
    imitates="Imagers that expose their rows one after another (D415), in motion.",
    law="Edges lean by f v t / z over the image's height; nothing where nothing moves.",
    shows=(
        "Infrared: upright edges lean, near ones more. Disparity: none in sideways motion, as both "
        "images lean equally; at 1 m/s forwards and 16 ms an error from top to bottom, 0.18 px of "
        "spread. Holes: as before. Gone when the sensor rests."
    ),
    confused_with=("roll", "model_turn"),
    source="RealSense D400 series comparison: D415 rolling, D435 and D455 global shutter",
    rerender="every row has its own camera pose",
)

MODEL_SHIFT = Effect(
    name="model_shift",
    family="model_pose",
    stage=Stage.SCENE,
    parameters=_components("scene.model_error.shift_m", "m", 0.01),
    imitates="A scene that is shifted relative to its model.",
    law="Points are at p + t: d = f b / (z + t_z), and the image moves by f t_x / z.",
    shows=(
        "Infrared: edges of albedo displaced, near ones more. Disparity: 5 mm in depth -0.10 px on "
        "the wall, -0.25 px on objects, depth error even in metres; 5 mm sideways dipoles at edges "
        "of depth, 5.1 % of the objects over 1 px. Holes: move with the edges."
    ),
    confused_with=("model_turn", "model_scale", "disparity_offset", "transparency"),
    source="Rigid motion; closed form",
    rerender="the sensor has another pose in the model",
)

MODEL_TURN = Effect(
    name="model_turn",
    family="model_pose",
    stage=Stage.SCENE,
    parameters=_components("scene.model_error.turn_deg", "deg", 1.0),
    imitates="A scene that is rotated relative to its model.",
    law="Points are at R p, R about the left imager.",
    shows=(
        "Disparity: about x an error that runs from top to bottom (0.3 deg: +0.09 px, spread "
        "0.19 px), about y and z mostly dipoles at edges, spread 0.15 and 0.17 px. Infrared: the "
        "picture moves as a whole, dots do not."
    ),
    confused_with=("model_shift", "roll", "rolling_shutter"),
    source="Rigid motion; closed form",
    rerender="the sensor has another pose in the model",
)

MODEL_SCALE = Effect(
    name="model_scale",
    family="scale",
    stage=Stage.SCENE,
    parameters=(
        Parameter(
            name="scale",
            paths=("scene.model_error.scale",),
            unit="1",
            neutral=1.0,
            low=0.97,
            high=1.03,
        ),
    ),
    imitates="A model scanned or modelled too small or too large.",
    law="Points are at s p from the left imager: d = f b / (s z), projected light over s^2.",
    shows=(
        "Disparity: off by -1 % of itself at 1.01 (-0.23 px on the wall, -0.35 px on objects): "
        "depth error grows with z. Infrared: edges stay in the left image; light 2 % less."
    ),
    confused_with=("baseline_error", "focal_scale", "disparity_offset", "model_shift"),
    source="Similarity about the left imager; closed form",
    rerender="the rig changes in proportion to the model",
)

BASELINE_ERROR = Effect(
    name="baseline_error",
    family="scale",
    stage=Stage.SCENE,
    parameters=(
        Parameter(
            name="share", paths=("baseline_error",), unit="1", neutral=0.0, low=-0.02, high=0.02
        ),
    ),
    imitates="A baseline that heat or a knock made longer than the device believes.",
    law="d = f b (1 + e) / z, so z' = z / (1 + e): depth error grows with z.",
    shows=(
        "Disparity: off by 1 % of itself at 0.01 (+0.20 px), the same near and far in share. "
        "Infrared: the left image as before, in structured light dots displaced. Holes: as before. "
        "Time: drifts as the device warms up."
    ),
    confused_with=("focal_scale", "model_scale", "disparity_offset"),
    source="Szeliski, Computer Vision, 2nd ed., sec. 12.1",
    rerender="the right imager, or the structured light's projector, has another position",
)

ROWS: tuple[Effect, ...] = (
    AMBIENT,
    AMBIENT_GRADIENT,
    INTERREFLECTION,
    MOTION,
    TURNING,
    ROLLING_SHUTTER,
    MODEL_SHIFT,
    MODEL_TURN,
    MODEL_SCALE,
    BASELINE_ERROR,
)
