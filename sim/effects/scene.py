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
    imitates="Daylight and lamps: light in the imager's band that is not the projector's.",
    law="L = rho / pi E (1 + 2/3 g n . up); the dots' amplitude stays.",
    shows=(
        "The level between dots rises with the albedo. Auto exposure shortens, and the dots' "
        "contrast falls. Noise 0.30 px at 1 W m^-2, 0.65 at 5, 1.2 at 20. Fill 98 %, 79 %, 42 "
        "%: plain walls go first."
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
    imitates="Light from above that is stronger than light from below.",
    law=("Sky of radiance L0 (1 + g w . up); a surface of normal n receives (1 + 2/3 g n . up)."),
    shows=(
        "Tops are brighter than undersides by (1 + 2g/3) / (1 - 2g/3). At 1 W m^-2 noise 0.28 "
        "px without, 0.32 px with g = 1."
    ),
    confused_with=("ambient", "nir_reflectance"),
    source="Integral of the cosine over the hemisphere",
    rerender="the gradient is within the ambient layer",
)

AMBIENT_OCCLUSION = Effect(
    name="ambient_occlusion",
    family="ambient_occlusion",
    stage=Stage.SCENE,
    parameters=(
        Parameter(
            name="share",
            paths=("scene.ambient.occlusion",),
            unit="1",
            neutral=0.0,
            low=0.2,
            high=1.0,
        ),
        Parameter(
            name="reach_m",
            paths=("scene.ambient.reach_m",),
            unit="m",
            neutral=1.0,
            low=0.2,
            high=5.0,
        ),
    ),
    imitates="Furniture that blocks room light: dark corners, shadows under objects.",
    law=(
        "E = E_open (1 - share (1 - V)); V is the share of the sky, by radiance and cosine, that "
        "no surface within reach blocks."
    ),
    shows=(
        "Concave places and ground under objects are darker between the dots: level of objects "
        "-15 % at 1 W m^-2 with a reach of 1 m, walls unchanged. Depth hardly changes: objects "
        "0.24 instead of 0.22 px of noise."
    ),
    confused_with=("ambient_gradient", "nir_reflectance", "interreflection"),
    source="Zhukov, Iones and Kronin, An ambient light illumination model, 1998, eq. 2",
    rerender="shadows are within the ambient layer",
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
    law="E = E_direct + F rho E (radiosity): all bounces, matt surfaces.",
    shows=(
        "A smooth pedestal near bright objects, which goes out with the projector. Depth "
        "changes by less than 0.01 px and 0.1 % holes."
    ),
    confused_with=("veil", "ambient", "subsurface"),
    source=(
        "Goral et al., Modeling the interaction of light between diffuse surfaces, 1984, eq. 1"
    ),
    rerender="the indirect layer is rendered once; its strength moves freely",
)

MOTION = Effect(
    name="motion",
    family="motion",
    stage=Stage.SCENE,
    parameters=_components("scene.motion.velocity_m_s", "m/s", 3.0),
    imitates="A sensor that translates: on a hand, a robot, a vehicle.",
    law="A point at z smears by f v t / z; motion along the axis smears along the radius.",
    shows=(
        "Edges and albedo texture smear, near ones more; dots on facing surfaces stay sharp. "
        "At 3 m/s sideways: objects 0.23 px of noise, 7.8 % over 1 px, 1.3 % more holes at "
        "edges. Walls are unchanged."
    ),
    confused_with=("turning", "lens_blur"),
    source="Pinhole geometry",
    rerender="an exposure is the average of many views",
)

TURNING = Effect(
    name="turning",
    family="motion",
    stage=Stage.SCENE,
    parameters=_components("scene.motion.turn_deg_s", "deg/s", 180.0),
    imitates="A sensor that is panned, tilted or rolled.",
    law="About x or y the image smears by f w t, equally at all depths; about z by r w t.",
    shows=(
        "Albedo texture smears equally near and far; dots stay sharp. At 90 deg/s about y: "
        "disparity within 0.01 px, 0.2 % more holes."
    ),
    confused_with=("motion", "lens_blur"),
    source="Pinhole geometry",
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
    imitates="Imagers that expose their rows in sequence (D415), in motion.",
    law="Edges lean by f v t / z over the image's height; no effect at rest.",
    shows=(
        "Upright edges lean, near ones more. Sideways motion leaves disparity unchanged. At 1 "
        "m/s forwards and 16 ms the error changes from top to bottom by 0.18 px of spread."
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
    law="Points are at p + t: d = f b / (z + t_z); the image moves by f t_x / z.",
    shows=(
        "Albedo edges are displaced, near ones more. At 5 mm in depth: -0.10 px on the wall, "
        "-0.25 px on objects. At 5 mm sideways: dipoles at depth edges, 5.1 % of objects over "
        "1 px."
    ),
    confused_with=("model_turn", "model_scale", "disparity_offset", "transparency"),
    source="Rigid motion",
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
        "At 0.3 deg about x: an error that changes from top to bottom, +0.09 px, spread 0.19 "
        "px. About y and z: dipoles at edges, spread 0.15 and 0.17 px. The picture moves, the "
        "dots do not."
    ),
    confused_with=("model_shift", "roll", "rolling_shutter"),
    source="Rigid motion",
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
        "1.01 changes disparity by -1 %: -0.23 px on the wall, -0.35 px on objects. Edges "
        "stay in the left image; light falls by 2 %."
    ),
    confused_with=("baseline_error", "focal_scale", "disparity_offset", "model_shift"),
    source="Similarity about the left imager",
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
    imitates="A baseline that heat or a shock made longer than stored.",
    law="d = f b (1 + e) / z, so z' = z / (1 + e).",
    shows=(
        "0.01 changes disparity by 1 % (+0.20 px) at all distances. The left image and holes "
        "are unchanged. It drifts as the device warms up."
    ),
    confused_with=("focal_scale", "model_scale", "disparity_offset"),
    source="Szeliski, Computer Vision, 2nd ed., sec. 12.1",
    rerender="the right imager, or the structured light's projector, has another position",
)

ROWS: tuple[Effect, ...] = (
    AMBIENT,
    AMBIENT_GRADIENT,
    AMBIENT_OCCLUSION,
    INTERREFLECTION,
    MOTION,
    TURNING,
    ROLLING_SHUTTER,
    MODEL_SHIFT,
    MODEL_TURN,
    MODEL_SCALE,
    BASELINE_ERROR,
)
