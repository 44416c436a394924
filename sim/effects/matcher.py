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
        imitates="Size of the window whose brightness order is compared (param-censususize).",
        law="cost = bits that differ among the window's chequerboard",
        shows=(
            "Infrared unchanged. At 5 px: weak texture fails (1.41 % over 1 px, not 0.88 %), "
            "edges are tighter (holes near them 12.8 %, not 16.2 %). At 11 px: holes 2.2 %; near "
            "surfaces grow by half the window."
        ),
        confused_with=("support_window", "presmooth", "cost_mix", "median", "pixel_locking"),
        source="Zabih and Woodfill 1994, ECCV; window 9 in librealsense presets.cpp",
    ),
    _row(
        "cost_mix",
        "matching_cost",
        _sensor_parameter("weight", "engine.difference_weight", "bit/DN", 0.0, 1.0),
        _sensor_parameter("cap_dn", "engine.difference_cap_dn", "DN", 1.0, 32.0),
        imitates="Share of the absolute difference in the cost (lambdaAD and lambdaCensus).",
        law="cost = census bits + weight min(|left - right|, cap)",
        shows=(
            "Errors where the imagers see one surface at different levels. A matched pair hardly "
            "changes: 0 and 1 bit/DN differ from the device by 0.104 and 0.108 px, 0.88 and 0.91 "
            "% over 1 px."
        ),
        confused_with=("census_window", "presmooth", "small_penalty", "median", "pixel_locking"),
        source=f"{_AD_CENSUS}; lambdas in librealsense presets.cpp",
    ),
    _row(
        "support_window",
        "matching_window",
        _sensor_parameter("side", "engine.support_px", "px", 1, 15, (1, 3, 5, 7, 9, 11, 13, 15)),
        _sensor_parameter("arm_step_dn", "engine.arm_step_dn", "DN", 1.0, 64.0),
        imitates="Area over which the cost is averaged, and the brightness step that ends it.",
        law="cost averaged over arms along the row, then the column, of side // 2 at most",
        shows=(
            "Smaller is noisier: at 5 px neighbours differ by 0.036 px (0.035 before), holes 2.3 "
            "%. Larger is smoother: 0.034 px at 15 px, holes 1.9 %."
        ),
        confused_with=("census_window", "smoothing_mean", "small_penalty", "large_penalty"),
        source=_AD_CENSUS,
    ),
    _row(
        "presmooth",
        "presmooth",
        _sensor_parameter("sigma", "engine.presmooth_px", "px", 0.0, 2.0),
        imitates="Blur before the census, as in a device that matches more bits than it streams.",
        law="Gaussian of that standard deviation on both images",
        shows=(
            "Infrared unchanged, unlike lens blur. At 0: 0.98 % over 1 px, in dark areas. At 1.5 "
            "px: 0.96 %, 0.127 px from the device (0.104 before)."
        ),
        confused_with=("lens_blur", "census_window", "support_window", "pixel_locking"),
        source="decision 0003",
    ),
    _row(
        "small_penalty",
        "smoothness",
        _sensor_parameter("p1", "engine.small_penalty", "bit", 2.0, 48.0),
        imitates="P1: price of a step of one disparity along a scanline (param-scanlinep1).",
        law="path(p, d) = cost + min(path(d), path(d +- 1) + P1, least + P2) - least",
        shows=(
            "High: slopes become stairs of whole disparities; at 40 bit 0.93 % over 1 px, holes "
            "2.1 %. Low: single pixels vary (2.2 % at 3 bit)."
        ),
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
            "At 16 bit: holes in specks on dark surfaces (2.6 %), ragged edges, 0.75 % over 1 px. "
            "At 100 bit: late jumps, 0.95 % over, overlap with the device's holes 0.49 to 0.43."
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
        imitates=(
            "Least margin of the winner over the second best (percent in OpenCV, "
            "param-secondpeakdelta) or a neighbour (param-neighborthresh)."
        ),
        law=(
            "refused if second < best (1 + percent / 100), second - best < second_peak, or "
            "max(neighbours) - best < neighbour; the best's two neighbours are not second"
        ),
        shows=(
            "Only holes, first where texture is dim or repeats: dark grains, edges, folds, "
            "glints. At 50 %: holes 4.0 %, 0.64 % over 1 px; at 60 bit: 6.7 %, 0.44 %."
        ),
        confused_with=("left_right_threshold", "texture_threshold"),
        source=(
            f"{_DSAPI}: secondPeakThreshold, neighborThreshold; librealsense issue 10224 (second "
            "peak 0 closes holes)"
        ),
    ),
    _row(
        "left_right_threshold",
        "left_right",
        _sensor_parameter("largest_px", "checks.left_right_px", "px", 0.25, 4.0),
        imitates="Largest difference of the two disparities (param-leftrightthreshold, 1/32 px).",
        law="refused if |d_left(x) - d_right(x - d_left)| > largest",
        shows=(
            "Only holes: the shadow left of near objects. Off: gaps close with false depth (1.2 % "
            "holes, 8.9 % near edges). At 0.3 px: holes on curved and dark parts (3.9 %, 29 % "
            "near edges)."
        ),
        confused_with=("uniqueness", "edge_jump", "speckle_filter"),
        source=f"{_DSAPI}: lrThreshold",
    ),
    _row(
        "overlap_border",
        "overlap_border",
        _sensor_parameter("width_px", "checks.border_px", "px", 0.0, 24.0),
        imitates="Windows that must lie inside the other image.",
        law="refused if x - d < width",
        shows=(
            "A band of holes to the right of the unseen one, equally wide at any depth. At 7 px: "
            "overlap with the device's holes 0.71 to 0.77 (held-out rooms: 0.65 to 0.69)."
        ),
        confused_with=("left_right_threshold",),
        source=(
            "a D415 has depth at 0 % of the pixels for x - d = 0, half at 7 px, 95 % at 19 px "
            "(benchmarks/matcher/match_faro.py)"
        ),
    ),
    _row(
        "texture_threshold",
        "texture",
        _sensor_parameter("least_dn", "checks.texture_dn", "DN", 0.0, 3.0),
        imitates=(
            "Least contrast of a window (param-texturecountthresh, param-texturedifferencethresh)."
        ),
        law="refused if the 15x15 window's standard deviation < least (DN of 8 bits)",
        shows=(
            "Whole dark or far surfaces become holes, edges remain: 1 DN 6.1 %, 3 DN 41 %. A "
            "hole's border follows the image's level, not depth."
        ),
        confused_with=("uniqueness",),
        source=f"{_DSAPI}: textureCountThreshold; librealsense issue 10608",
    ),
    _row(
        "edge_jump",
        "edge_jump",
        _sensor_parameter("largest_px", "checks.jump_px", "px", 1.0, 32.0),
        imitates="The 1 to 3 px that a device leaves empty on every side of a depth edge.",
        law="refused if disparities in 3x3 pixels span more than largest",
        shows=(
            "A line of holes along all edges, also where no surface is occluded. Off: only "
            "left-hand shadows remain (11 % near edges, not 16 %)."
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
            "Off: islands of false depth in shadows and at borders (0.89 % over 1 px). At 3000 "
            "px: small free-standing objects vanish (2.2 % holes)."
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
        shows="Off: single wrong winners, which the checks remove (2.16 % holes, not 2.04 %).",
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
            "A mean that stops at jumps, as in devices with correlated errors (12 px of a row, 6 "
            "of a column)."
        ),
        law="weighted mean over side columns x rows, no more than side, of neighbours within step",
        shows=(
            "Off: grain, 0.048 px between neighbours, 0.239 px from the scanner. At 31 px each "
            "way: 0.030 px, curved parts flattened (1.2 % over 1 px). Holes stay."
        ),
        confused_with=("support_window", "spatial_filter", "median"),
        source=(
            "decision 0003, autocorrelation of the device's error; docs/results/matcher.md, its "
            "noise on walls"
        ),
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
        shows=(
            "Planes become terraces; the histogram of f b / z is a comb. Spread 0.209 px at 1/8 "
            "px, 0.265 at 1/2. Holes stay."
        ),
        confused_with=("pixel_locking", "depth_unit"),
        source=(
            "D400: Grunnet-Jepsen et al., Subpixel linearity improvement; Kinect: Konolige and "
            "Mihelich 2011"
        ),
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
        imitates=(
            "A sub-pixel fit biased to whole pixels; below 0 an excessive correction (RealSense "
            "A-factor)."
        ),
        law="d' = d - a sin(2 pi d)",
        shows=(
            "Disparity error against the fraction of d is a sine; a plane ripples. Spread 0.222 "
            "px at 0.08, 0.251 at 0.15. Holes stay."
        ),
        confused_with=("subpixel_steps", "support_window"),
        source=(
            "Shimizu and Okutomi 2005, IJCV 63(3); Haller et al. 2010, ITSC; Grunnet-Jepsen et "
            "al., Subpixel linearity improvement"
        ),
    ),
)

_SEARCH = (
    _row(
        "disparity_shift",
        "search_range",
        _sensor_parameter("least_px", "min_disparity_px", "px", 0, 64),
        imitates="Start of the search (param-disparityshift): nearer objects instead of far ones.",
        law="least < d < least + search - 1: z from f b / (least + search - 1) to f b / least",
        shows=(
            "Everything beyond f b / least is lost: 5.8 % holes at 20 px, 41 % at 40 px, where "
            "the remaining depth there is false. The left band widens."
        ),
        confused_with=("search_range", "range"),
        source="RealSense, Tuning depth cameras for best performance (disparity shift)",
    ),
    _row(
        "search_range",
        "search_range",
        _sensor_parameter("count", "search_px", "px", 16, 256, tuple(range(16, 257, 16))),
        imitates="Number of disparities tried: 126 in a D400.",
        law="see disparity_shift",
        shows=(
            "Objects nearer than a sharp limit lose their depth (64 px: 4.4 % holes) or have "
            "false depth (2.4 % over 1 px). A longer search changes almost nothing."
        ),
        confused_with=("disparity_shift", "range"),
        source="librealsense issue 2885 (126 disparities)",
    ),
)

ROWS: tuple[Effect, ...] = (*_COST, *_CHECKS, *_REFINEMENT, *_SEARCH)
