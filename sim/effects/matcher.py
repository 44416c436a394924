"""Rows of the effect table for the matcher stage.

Most parameters have no ideal value, so the sensor's value is neutral. Rows that set
`matcher.engine` need the CensusSemiGlobal engine, which the `matcher.setting` d4xx and kinect use.
The figures in `shows` were measured on real D415 pairs of three rooms with the setting d4xx, one
parameter at a time. There 2.0 % of the pixels have no depth (16 % near depth edges), and 0.88 %
have an error above 1 px.
"""

from __future__ import annotations

from starling.sim.effects.effect import Effect, Parameter, Stage

_DSAPI = "DSAPITypes.h (RealSense DS4 library), DSDepthControlParameters"
_AD_CENSUS = "Mei et al. 2011, AD-Census, ICCV workshops"
_SGM = "Hirschmueller 2008, TPAMI 30(2)"


def _sensor_parameter(
    name: str,
    path: str,
    unit: str,
    low: float,
    high: float,
    choices: tuple[float, ...] = (),
) -> Parameter:
    """Return a parameter whose neutral value is the sensor's value."""
    return Parameter(
        name=name,
        paths=(f"matcher.{path}",),
        unit=unit,
        neutral=None,
        low=low,
        high=high,
        choices=choices,
    )


def _row(
    name: str,
    family: str,
    *parameters: Parameter,
    imitates: str,
    law: str,
    shows: str,
    confused_with: tuple[str, ...],
    source: str,
) -> Effect:
    """Return a row of this stage; none needs a new render."""
    return Effect(
        name=name,
        family=family,
        stage=Stage.MATCHER,
        parameters=parameters,
        imitates=imitates,
        law=law,
        shows=shows,
        confused_with=confused_with,
        source=source,
    )


_COST = (
    _row(
        "census_window",
        "matching_window",
        _sensor_parameter("side", "engine.census_px", "px", 3, 11, (3, 5, 7, 9, 11)),
        imitates="Size of the neighbourhood whose order of brightness is compared (the JSON's "
        "param-censususize).",
        law="cost = bits that differ among the window's chequerboard",
        shows="Infrared unchanged. Smaller: wrong winners on weak texture (5 px: 1.41 % off by "
        "more than 1 px against 0.88 %), edges tighter (holes near edges 12.8 % against 16.2 %). "
        "Larger: holes 2.2 % at 11 px; by theory near surfaces grow by half the window, whatever "
        "the depth.",
        confused_with=("support_window", "presmooth", "cost_mix", "median", "pixel_locking"),
        source="Zabih and Woodfill 1994, ECCV; window 9 in librealsense presets.cpp",
    ),
    _row(
        "cost_mix",
        "matching_cost",
        _sensor_parameter("weight", "engine.difference_weight", "bit/DN", 0.0, 1.0),
        _sensor_parameter("cap_dn", "engine.difference_cap_dn", "DN", 1.0, 32.0),
        imitates="Share of the absolute difference in the cost (lambdaAD and lambdaCensus). A "
        "high one fails where the two imagers see one surface at different levels.",
        law="cost = census bits + weight min(|left - right|, cap)",
        shows="Almost nothing on a matched pair: 0.104 px against the device at 0, 0.108 at 1 "
        "bit/DN; 0.88 and 0.91 % off.",
        confused_with=("census_window", "presmooth", "small_penalty", "median", "pixel_locking"),
        source=f"{_AD_CENSUS}; lambdas in librealsense presets.cpp",
    ),
    _row(
        "support_window",
        "matching_window",
        _sensor_parameter("side", "engine.support_px", "px", 1, 15, (1, 3, 5, 7, 9, 11, 13, 15)),
        _sensor_parameter("arm_step_dn", "engine.arm_step_dn", "DN", 1.0, 64.0),
        imitates="Area the cost is averaged over, and the step of brightness that ends it.",
        law="cost averaged over arms along the row, then the column, of side // 2 at most",
        shows="Smaller: noisier, step between neighbours 0.036 px at 5 px against 0.035, more "
        "holes (2.3 %). Larger: smoother (0.034 px at 15 px), fewer holes (1.9 %).",
        confused_with=("census_window", "smoothing_mean", "small_penalty", "large_penalty"),
        source=_AD_CENSUS,
    ),
    _row(
        "presmooth",
        "presmooth",
        _sensor_parameter("sigma", "engine.presmooth_px", "px", 0.0, 2.0),
        imitates="Averaging before the census, as a device that matches more bits than it streams.",
        law="Gaussian of that standard deviation on both images",
        shows="Infrared unchanged, unlike a blurred lens. 0: off 0.98 %, in dark areas. 1.5 px: "
        "0.96 % off, 0.127 px against the device where 0.104 was.",
        confused_with=("lens_blur", "census_window", "support_window", "pixel_locking"),
        source="decision 0003",
    ),
    _row(
        "small_penalty",
        "smoothness",
        _sensor_parameter("p1", "engine.small_penalty", "bit", 2.0, 48.0),
        imitates="P1: price of a step of one disparity along a scanline (param-scanlinep1).",
        law="path(p, d) = cost + min(path(d), path(d +- 1) + P1, least + P2) - least",
        shows="High: by its law slopes become stairs of whole disparities; 0.93 % off at 40 bit, "
        "holes 2.1 %. Low: single pixels waver (2.2 % at 3 bit).",
        confused_with=("large_penalty", "support_window"),
        source=_SGM,
    ),
    _row(
        "large_penalty",
        "smoothness",
        _sensor_parameter("p2", "engine.large_penalty", "bit", 12.0, 100.0),
        imitates="P2: price of a larger jump (param-scanlinep2).",
        law="see small_penalty; P2 >= P1",
        shows=(
            "Low (16 bit): specks of no depth on dark surfaces (2.6 %), edges ragged, the "
            "remaining depth more often correct (0.75 % off). High (100 bit): jumps come late "
            "(0.95 % off), overlap with the device's holes down from 0.49 to 0.43."
        ),
        confused_with=("small_penalty", "support_window"),
        source=_SGM,
    ),
)

_CHECKS = (
    _row(
        "uniqueness",
        "uniqueness",
        _sensor_parameter("percent", "checks.uniqueness", "%", 0.0, 60.0),
        _sensor_parameter("second_peak_bit", "engine.second_peak", "bit", 0.0, 60.0),
        _sensor_parameter("neighbour_bit", "engine.neighbour_peak", "bit", 0.0, 40.0),
        imitates="How far the winner must stand out: over the second best in percent (OpenCV) or "
        "as a difference (param-secondpeakdelta), or over a disparity next to it "
        "(param-neighborthresh).",
        law=(
            "refused if second < best (1 + percent / 100), second - best < second_peak, or "
            "max(neighbours) - best < neighbour; the two neighbours of the best do not count as "
            "second"
        ),
        shows=(
            "Only holes; the remaining depth keeps its value and is more often correct (50 %: off "
            "0.64 %, holes 4.0 %; 60 bit: 0.44 %, 6.7 %). They come first where texture is dim or "
            "repeats: grains in dark areas, wider gaps at edges, folds and glints."
        ),
        confused_with=("left_right_threshold", "texture_threshold"),
        source=f"{_DSAPI}: secondPeakThreshold, neighborThreshold; librealsense issue 10224 "
        "(second peak 0 closes holes)",
    ),
    _row(
        "left_right_threshold",
        "left_right",
        _sensor_parameter("largest_px", "checks.left_right_px", "px", 0.25, 4.0),
        imitates="Largest difference of both views' disparities (param-leftrightthreshold, 1/32 "
        "px).",
        law="refused if |d_left(x) - d_right(x - d_left)| > largest",
        shows=(
            "Only holes. It makes the shadow left of near objects: off, gaps there close with "
            "false depth (1.2 % holes, 8.9 % near edges); 0.3 px: blobs along curved and dark "
            "parts (3.9 %, 29 % near edges)."
        ),
        confused_with=("uniqueness", "edge_jump", "speckle_filter"),
        source=f"{_DSAPI}: lrThreshold",
    ),
    _row(
        "overlap_border",
        "overlap_border",
        _sensor_parameter("width_px", "checks.border_px", "px", 0.0, 24.0),
        imitates=(
            "Windows that must stay inside the other image: pixels near its border find no match."
        ),
        law="refused if x - d < width",
        shows=(
            "A band of holes to the right of the one that the other imager does not see, as wide "
            "at any depth. On all columns the overlap with the device's holes goes up from 0.71 to "
            "0.77 at 7 px (held-out rooms: 0.65 to 0.69)."
        ),
        confused_with=("left_right_threshold",),
        source=(
            "benchmarks/matcher/match_faro.py: of the pixels matched on a D415's infrared, the "
            "device has depth at 0 % for x - d = 0, half at 7 px, 95 % at 19 px"
        ),
    ),
    _row(
        "texture_threshold",
        "texture",
        _sensor_parameter("least_dn", "checks.texture_dn", "DN", 0.0, 3.0),
        imitates="Least contrast of a window (param-texturecountthresh, "
        "param-texturedifferencethresh).",
        law="refused if the 15x15 window's standard deviation < least (DN of 8 bits)",
        shows="Whole dark or far surfaces go at once, edges and near ones stay: 1 DN 6.1 % holes, "
        "3 DN 41 %. The border of a hole follows the image's level, not depth.",
        confused_with=("uniqueness",),
        source=f"{_DSAPI}: textureCountThreshold; librealsense issue 10608",
    ),
    _row(
        "edge_jump",
        "edge_jump",
        _sensor_parameter("largest_px", "checks.jump_px", "px", 1.0, 32.0),
        imitates="The 1 to 3 px a device leaves free on every side of a depth edge.",
        law="refused if disparities in 3x3 pixels span more than largest",
        shows=(
            "A line of holes along all edges, right and lower ones too, where no surface is "
            "occluded. Off, only the left-hand shadows remain (11 % near edges against 16 %)."
        ),
        confused_with=("left_right_threshold", "uniqueness"),
        source="decision 0003, the device's gaps at edges",
    ),
    _row(
        "speckle_filter",
        "speckle_filter",
        _sensor_parameter("count", "checks.speckle_count", "px", 0, 3000),
        _sensor_parameter("step_px", "checks.speckle_step_px", "px", 0.25, 4.0),
        imitates="Removal of small islands of depth.",
        law="islands of at most count pixels, separated by steps above step, are removed",
        shows=(
            "Off: crumbs of false depth inside shadows and at borders (0.89 % off). 3000 px: small "
            "free-standing objects vanish whole (2.2 % holes)."
        ),
        confused_with=("left_right_threshold", "median"),
        source="Hirschmueller 2008, section 2.7 (peak filtering); OpenCV filterSpeckles",
    ),
)

_REFINEMENT = (
    _row(
        "median",
        "winner_median",
        _sensor_parameter("side", "refinement.median_px", "px", 0, 5, (0, 3, 5)),
        imitates="Median of the winners before the checks.",
        law="d = median over side x side",
        shows="Off: single wrong winners, which the checks then remove (2.16 % holes against 2.04 "
        "%).",
        confused_with=(
            "smoothing_mean",
            "speckle_filter",
            "presmooth",
            "support_window",
            "spatial_filter",
            "pixel_locking",
        ),
        source="Hirschmueller 2008, section 2.6",
    ),
    _row(
        "smoothing_mean",
        "disparity_smoothing",
        _sensor_parameter(
            "side", "refinement.smooth_px", "px", 0, 31, (0, 5, 7, 9, 11, 13, 15, 17, 21, 31)
        ),
        _sensor_parameter("step_px", "refinement.smooth_step_px", "px", 0.5, 4.0),
        _sensor_parameter(
            "rows", "refinement.smooth_rows_px", "px", 1, 31, (1, 3, 5, 7, 9, 11, 15, 21, 31)
        ),
        imitates=(
            "A mean that stops at jumps: the device's errors are correlated over about 12 px of a "
            "row and 6 of a column."
        ),
        law="weighted mean over side columns x rows, no more than side, of neighbours within step",
        shows=(
            "Off: grain, 0.048 px between neighbours, 0.239 px against the scanner. 31 px each "
            "way: grain gone (0.030 px), curved parts flattened (1.2 % off). Fewer rows than "
            "columns: errors are correlated further along rows than along columns. Holes stay."
        ),
        confused_with=("support_window", "spatial_filter", "median"),
        source="decision 0003, autocorrelation of the device's error; "
        "docs/results/matcher.md, its noise on walls",
    ),
    _row(
        "subpixel_steps",
        "disparity_quantisation",
        Parameter(
            name="step",
            paths=("matcher.refinement.quantum_px",),
            unit="px",
            neutral=0.0,
            low=0.0,
            high=0.5,
        ),
        imitates=(
            "Fractional bits of a disparity: 1/32 px in the D400, 1/16 in OpenCV, 1/8 in "
            "structured light."
        ),
        law="d = step round(d / step); depth steps of z^2 step / (f b)",
        shows="Planes fall into terraces at lines of constant disparity, their height growing "
        "with z^2: comb in the histogram of f b / z. Spread 0.209 px at 1/8 px, 0.265 at 1/2. "
        "Holes stay.",
        confused_with=("pixel_locking", "depth_unit"),
        source="D400: Grunnet-Jepsen et al., Subpixel linearity improvement; Kinect: Konolige and "
        "Mihelich 2011",
    ),
    _row(
        "pixel_locking",
        "pixel_locking",
        Parameter(
            name="amplitude",
            paths=("matcher.refinement.locking_px",),
            unit="px",
            neutral=0.0,
            low=-0.15,
            high=0.15,
        ),
        imitates="A sub-pixel fit that pulls to whole pixels, or (below 0) a correction that "
        "overdoes it, as a RealSense A-factor set too high.",
        law="d' = d - a sin(2 pi d)",
        shows="Disparity error against the fraction of d is a sine of amplitude a; a plane "
        "ripples, crowding at whole disparities. Spread 0.222 px at 0.08, 0.251 at 0.15. Holes "
        "stay.",
        confused_with=("subpixel_steps", "support_window"),
        source="Shimizu and Okutomi 2005, IJCV 63(3); Haller et al. 2010, ITSC; Grunnet-Jepsen et "
        "al., Subpixel linearity improvement (3 to 5 times better by its correction)",
    ),
)

_SEARCH = (
    _row(
        "disparity_shift",
        "search_range",
        _sensor_parameter("least_px", "min_disparity_px", "px", 0, 64),
        imitates=(
            "Start of the search (param-disparityshift): nearer objects, at the price of far ones."
        ),
        law="least < d < least + search - 1: z from f b / (least + search - 1) to f b / least",
        shows="All that is farther than f b / least is lost, whole backgrounds at once: 5.8 % "
        "holes at 20 px, 41 % at 40 px, where what remains there is false. The left band widens.",
        confused_with=("search_range", "range"),
        source="RealSense, Tuning depth cameras for best performance (disparity shift)",
    ),
    _row(
        "search_range",
        "search_range",
        _sensor_parameter("count", "search_px", "px", 16, 256, tuple(range(16, 257, 16))),
        imitates="How many disparities are tried: 126 in a D400.",
        law="see disparity_shift",
        shows=(
            "Near objects beyond the search lose their depth with a sharp limit (64 px: 4.4 % "
            "holes) or take false ones (2.4 % off). More than is needed changes next to nothing."
        ),
        confused_with=("disparity_shift", "range"),
        source="librealsense issue 2885 (126 disparities)",
    ),
)

ROWS: tuple[Effect, ...] = (*_COST, *_CHECKS, *_REFINEMENT, *_SEARCH)
