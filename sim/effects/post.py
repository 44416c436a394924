"""Rows of the effect table for the post-processing stage."""

from __future__ import annotations

from starling.sim.effects.effect import Effect, Parameter, Stage

_DELTA = "delta in 1/32 px (disparity transform)"
_PAGE = "librealsense doc/post-processing-filters.md"

_RANGE = Effect(
    name="range",
    family="range",
    stage=Stage.POST,
    parameters=(
        Parameter(name="near_m", paths=("post.near_m",), unit="m", neutral=0.0, low=0.1, high=1.0),
        Parameter(
            name="far_m", paths=("post.far_m",), unit="m", neutral=65.535, low=1.0, high=65.535
        ),
    ),
    imitates="A threshold filter, or a device's stated range.",
    law="depth stays where near_m <= z <= far_m",
    shows="No depth beyond one sharp distance, on any surface; the rest is unchanged.",
    confused_with=("disparity_shift", "search_range", "depth_unit"),
    source=(
        "librealsense threshold filter: 0 to 16 m, its defaults 0.1 and 4 m; least distance "
        "of the D4xx f b / 126 (librealsense#2885)"
    ),
)

_DECIMATION = Effect(
    name="decimation",
    family="decimation",
    stage=Stage.POST,
    parameters=(
        Parameter(
            name="side",
            paths=("post.decimation",),
            unit="px",
            neutral=1.0,
            low=1.0,
            high=8.0,
            choices=tuple(float(side) for side in range(1, 9)),
        ),
    ),
    imitates="The decimation filter: a block of pixels becomes one value.",
    law=(
        "2, 3: median depth of the block, of an even count the nearer one; 4 to 8: mean "
        "depth, rounded down to the depth unit; a block has depth where any pixel has"
    ),
    shows=(
        "Square blocks of equal depth from pixel (0, 0). Narrow holes close: on one real room "
        "fill 0.940 became 0.949 with 2, 0.960 with 4. Edges move by up to a block."
    ),
    confused_with=("spatial_filter", "hole_filling", "registration"),
    source=f"{_PAGE}: 2 to 8, default 2",
)

_SPATIAL = Effect(
    name="spatial_filter",
    family="spatial_filter",
    stage=Stage.POST,
    parameters=(
        Parameter(
            name="alpha",
            paths=("post.spatial_alpha",),
            unit="1",
            neutral=1.0,
            low=0.25,
            high=1.0,
        ),
        Parameter(
            name="delta_px",
            paths=("post.spatial_delta_px",),
            unit="px",
            neutral=None,
            low=1 / 32,
            high=50 / 32,
        ),
        Parameter(
            name="iterations",
            paths=("post.spatial_iterations",),
            unit="1",
            neutral=None,
            low=1.0,
            high=5.0,
            choices=tuple(float(count) for count in range(1, 6)),
        ),
        Parameter(
            name="holes",
            paths=("post.spatial_holes",),
            unit="1",
            neutral=None,
            low=0.0,
            high=5.0,
            choices=tuple(float(mode) for mode in range(6)),
        ),
    ),
    imitates=(
        "The edge-preserving filter: recursive passes along rows and columns that restart at jumps."
    ),
    law=(
        "out[i] = alpha in[i] + (1 - alpha) out[i-1] where |in[i] - in[i-1]| < delta_px, four "
        "ways an iteration; white noise keeps mean_w((alpha^2 / (1 + b^2 - 2 b cos w))^(2 "
        "n))^2 of its variance, b = 1 - alpha; then holes are filled along rows, by 2^holes - 1 "
        "pixels (5: 254) from the left and from the right"
    ),
    shows=(
        "Holes and jumps stay, noise falls: in a real room the second difference of disparity "
        "from 0.033 to 0.003 px (median absolute deviation). Pixels move by 0.02 px (median), "
        "0.16 px (99 %). Disparities leave the comb of 1/32 px."
    ),
    confused_with=("decimation", "temporal_filter", "smoothing_mean"),
    source=(
        f"{_PAGE}: alpha 0.25 to 1, 0.5; delta 1 to 50, 20; iterations 1 to 5, 2; holes 0 to 5, 0; "
        f"{_DELTA}; "
        "Gastal and Oliveira 2011, Domain transform, sec. 5"
    ),
)

_TEMPORAL = Effect(
    name="temporal_filter",
    family="temporal_filter",
    stage=Stage.POST,
    parameters=(
        Parameter(
            name="alpha",
            paths=("post.temporal_alpha",),
            unit="1",
            neutral=1.0,
            low=0.05,
            high=1.0,
        ),
        Parameter(
            name="delta_px",
            paths=("post.temporal_delta_px",),
            unit="px",
            neutral=None,
            low=1 / 32,
            high=100 / 32,
        ),
        Parameter(
            name="persistence",
            paths=("post.temporal_persistence",),
            unit="1",
            neutral=None,
            low=0.0,
            high=8.0,
            choices=tuple(float(mode) for mode in range(9)),
        ),
    ),
    imitates=(
        "The temporal filter: a running mean over two or more frames, which also replaces "
        "missing depth."
    ),
    law=(
        "out = alpha new + (1 - alpha) old where |new - old| < delta_px, else new; variance "
        "over time alpha / (2 - alpha), correlation of successive frames 1 - alpha; old "
        "replaces missing depth by the last 8 frames (0 never, 8/8, 2/3, 2/4, 2/8, 1/2, 1/5, "
        "1/8, 8 always)"
    ),
    shows=(
        "Depth of a static scene varies slowly; its spatial noise stays. Flickering pixels "
        "stay filled; moving objects leave old depth in holes. Changed disparities leave the "
        "comb of 1/32 px."
    ),
    confused_with=("spatial_filter", "hole_filling"),
    source=f"{_PAGE}: alpha 0 to 1, 0.4; delta 1 to 100, 20; persistence 0 to 8, 3; {_DELTA}",
)

_HOLE_FILLING = Effect(
    name="hole_filling",
    family="hole_filling",
    stage=Stage.POST,
    parameters=(
        Parameter(
            name="mode",
            paths=("post.hole_filling",),
            unit="1",
            neutral="off",
            choices=("off", "left", "farthest", "nearest"),
        ),
    ),
    imitates="The hole filling filter: missing depth is copied from a neighbour.",
    law=(
        "row by row, filled pixels fill the next ones; left: last depth of the row; farthest, "
        "nearest: among left, upper left, lower left, up, down (nearest: only below a pixel "
        "with depth)"
    ),
    shows=(
        "Almost no hole remains: on one real room fill 0.940 became 0.971 (left), 0.986 "
        "(farthest), 0.984 (nearest). Filled runs copy a neighbour exactly; measured depth is "
        "unchanged."
    ),
    confused_with=("temporal_filter", "decimation", "left_right_threshold"),
    source=f"{_PAGE}: modes 0 (left), 1 (farthest, default), 2 (nearest)",
)

_DEPTH_UNIT = Effect(
    name="depth_unit",
    family="depth_unit",
    stage=Stage.POST,
    parameters=(
        Parameter(
            name="unit_m",
            paths=("post.depth_unit_m",),
            unit="m",
            neutral=None,
            low=1e-4,
            high=1e-2,
        ),
    ),
    imitates="The step of the 16-bit depth image, and its farthest depth.",
    law=(
        "code = round(z / unit_m), kept where 1 <= code <= 65535; error uniform, unit_m / sqrt(12)"
    ),
    shows=(
        "Steps of equal depth; near objects look terraced with 1e-2 m. No depth beyond 65535 "
        "steps: 6.55 m with 1e-4 m."
    ),
    confused_with=("range", "subpixel_steps"),
    source="librealsense#5587: 1e-4 to 1e-2 m; default 1e-3 m, D405 1e-4 m (librealsense#8946)",
)

_REGISTRATION = Effect(
    name="registration",
    family="registration",
    stage=Stage.POST,
    parameters=(
        Parameter(
            name="registered",
            paths=("post.registered",),
            unit="1",
            neutral=0.0,
            low=0.0,
            high=1.0,
            choices=(0.0, 1.0),
        ),
    ),
    imitates="Depth mapped to the image of a colour camera.",
    law=(
        "every depth pixel is moved to where the colour camera sees its point; the nearer one wins"
    ),
    shows=(
        "In the colour image: holes left of near objects if its camera stands to the left. "
        "Gaps where it is finer, doubled edges where far depth shows through. Depth in the "
        "left frame is unchanged."
    ),
    confused_with=("decimation",),
    source="librealsense align block; depth to colour offsets: realsense-ros _d4xx.urdf.xacro",
)

ROWS: tuple[Effect, ...] = (
    _RANGE,
    _DECIMATION,
    _SPATIAL,
    _TEMPORAL,
    _HOLE_FILLING,
    _DEPTH_UNIT,
    _REGISTRATION,
)
