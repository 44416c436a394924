"""Rows of the effect table for the post-processing stage."""

from __future__ import annotations

from starling.sim.effects.effect import Effect, Parameter, Stage

_DELTA = "librealsense counts it in 1/32 px (disparity transform, five fractional bits)"
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
    imitates="A threshold filter, or a device that reports no depth outside its stated range.",
    law="depth stays where near_m <= z <= far_m, both ends included",
    shows=(
        "No depth beyond one sharp distance, on any surface; infrared and the remaining depth are "
        "unchanged. Histograms of depth with and without it differ beyond the limit only."
    ),
    confused_with=("disparity_shift", "search_range", "depth_unit"),
    source="librealsense threshold filter: 0 to 16 m, its defaults 0.1 and 4 m; least distance of "
    "the D4xx f b / 126 (librealsense#2885)",
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
    imitates=(
        "The decimation filter: a block of pixels becomes one value, taken from its pixels with "
        "depth."
    ),
    law="2, 3: median depth of the block, of an even count the nearer one; 4 to 8: mean depth; a "
    "block has depth where any of its pixels has",
    shows="Square blocks of equal depth from pixel (0, 0) on; holes narrower than a block close "
    "(0.940 filled became 0.949 with 2 and 0.960 with 4 on one real room) and edges move by up to "
    "a block, tens of px of disparity on a thin rim. Neighbours are equal within blocks only.",
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
    ),
    imitates=(
        "The edge-preserving spatial filter: recursive passes along rows and columns that restart "
        "at every jump."
    ),
    law="out[i] = alpha in[i] + (1 - alpha) out[i-1] where |in[i] - in[i-1]| < delta_px, four ways "
    "an iteration; white noise keeps mean_w((alpha^2 / (1 + b^2 - 2 b cos w))^(2 n))^2 of its "
    "variance, b = 1 - alpha",
    shows="Holes and jumps stay, noise between them goes: the second difference of a real room's "
    "disparity fell from 0.033 to 0.003 px (median absolute deviation), single pixels moved by "
    "0.02 px (median), 0.16 px (99 %). Disparities leave the comb of 1/32 px: beyond 2.5 m all "
    "codes of the raw device sit on it, after the filter no more than by chance (0.18 to 0.26).",
    confused_with=("decimation", "temporal_filter", "smoothing_mean"),
    source=f"{_PAGE}: alpha 0.25 to 1, 0.5; delta 1 to 50, 20; iterations 1 to 5, 2; {_DELTA}; "
    "Gastal and Oliveira 2011, Domain transform, sec. 5",
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
        "The temporal filter: a running mean over frames, and old depth in place of missing depth; "
        "needs two frames or more."
    ),
    law=(
        "out = alpha new + (1 - alpha) old where |new - old| < delta_px, else new; variance over "
        "time alpha / (2 - alpha), correlation of successive frames 1 - alpha; old replaces "
        "missing depth, depending on the last 8 frames (0 never, 8/8, 2/3, 2/4, 2/8, 1/2, 1/5, "
        "1/8, 8 always)"
    ),
    shows="One frame alone looks raw. Over time: depth of a static scene varies less and slowly, "
    "while its spatial noise stays; pixels that flicker stay filled; what moves drags its old "
    "depth into new holes. Disparities leave the comb of 1/32 px where they changed.",
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
        "nearest: among left, upper left, lower left, up, down (nearest: only below a pixel with "
        "depth)"
    ),
    shows=(
        "Hardly a hole remains (0.940 filled became 0.971 with left, 0.986 with farthest, 0.984 "
        "with nearest on one real room), except in the first column, or with left in the band "
        "without overlap. Filled runs equal a neighbour bit for bit and smear to the right and "
        "downwards; measured depth is unchanged."
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
    imitates="The step of the 16-bit depth image, and the farthest depth that it holds.",
    law="code = round(z / unit_m), kept where 1 <= code <= 65535; error uniform, unit_m / sqrt(12)",
    shows=(
        "Steps of equal depth, which are fewer px of disparity far away; near objects look "
        "terraced with 1e-2 m. Nothing beyond 65535 steps: 6.55 m with 1e-4 m."
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
    imitates="Depth mapped to the colour camera's image; needs a colour camera.",
    law="every depth pixel is moved to where the colour camera sees its point; the nearer one wins",
    shows=(
        "In the colour image: holes on the left of near objects where the colour camera stands to "
        "the left of the left imager, gaps where the colour image is finer, doubled edges where "
        "far depth shows through. Depth in the left imager's frame is unchanged."
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
