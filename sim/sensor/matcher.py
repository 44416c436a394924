"""Settings of the stereo matcher: engine, search range, refinement and checks.

`starling.sim.stereo.matching` implements them. Each threshold is a single number, so that an
effect can change it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

from starling.patterns.errors import in_interval, one_of, refuse

SubpixelFit = Literal["parabola", "equal_slopes", "equal_slopes_of_sums"]

FIXED_POINT = 16  # OpenCV: disparities in 1/16 px, search range in multiples of 16.
LEFT_RIGHT_STEP_PX = 2.0  # Step that ends the mean before the left-right check [px].
MOST_BITS = 100.0  # Highest penalty of CensusSemiGlobal; it exceeds any cost, so nothing jumps.


def _odd(name: str, value: int, low: int, high: int) -> None:
    """Refuse a window that is not an odd whole number in [low, high]."""
    in_interval(name, value, low, high, "Choose an odd number inside.")
    if int(value) != value or value % 2 == 0:
        raise refuse(name, "must be odd", value, "A window needs a centre pixel.")


def whole(
    name: str, value: int, low: int, high: int, remedy: str = "Choose a value inside."
) -> None:
    """Refuse a count that is not a whole number in [low, high].

    Raises:
        InputError: if the value is outside or not whole.
    """
    in_interval(name, value, low, high, remedy)
    if int(value) != value:
        raise refuse(name, "must be a whole number", value, "Round it.")


@dataclass(frozen=True, kw_only=True, slots=True)
class SemiGlobalBlock:
    """OpenCV's StereoSGBM: Birchfield-Tomasi cost in a block, then scanline optimisation."""

    mode: Literal["3way", "hh"] = "3way"  # Paths: left, right and down, or all eight.
    block_px: int = 5  # Side of the block the cost is summed over.
    small_penalty: int = 200  # P1, for a disparity step of 1 px [summed cost].
    large_penalty: int = 800  # P2, for a larger step [summed cost].
    prefilter_cap: int = 0  # Clip of the horizontal derivative; 0 is OpenCV's default.

    def __post_init__(self) -> None:
        one_of("mode", self.mode, ("3way", "hh"))
        _odd("block_px", self.block_px, 1, 21)
        whole("small_penalty", self.small_penalty, 0, 100_000)
        whole("large_penalty", self.large_penalty, 0, 100_000)
        whole("prefilter_cap", self.prefilter_cap, 0, 127)
        if self.large_penalty <= self.small_penalty:
            raise refuse(
                "large_penalty",
                f"must be > small_penalty {self.small_penalty}",
                self.large_penalty,
                "A larger jump has to cost more than a step.",
            )


@dataclass(frozen=True, kw_only=True, slots=True)
class Block:
    """OpenCV's StereoBM: winner takes all by the sum of absolute differences over a block."""

    block_px: int = 15  # Side of the block.
    prefilter_cap: int = 31  # Clip of the horizontal derivative.

    def __post_init__(self) -> None:
        _odd("block_px", self.block_px, 5, 51)
        whole("prefilter_cap", self.prefilter_cap, 1, 63)


@dataclass(frozen=True, kw_only=True, slots=True)
class CensusSemiGlobal:
    """Census + absolute difference, averaged over a cross-shaped support, then scanlines.

    Cost of a pixel pair [bit] = Hamming distance of the census + weighted, clipped absolute
    difference. The cost is averaged over a support that ends at brightness steps, which often
    separate surfaces. Penalties are in bits too, so they do not depend on the support's size.
    Brightness is in DN of an 8-bit image at any bit depth.

    The sub-pixel fit is a parabola or a V of equal slopes through the averaged cost, or a V through
    the sums of the scanlines. Where costs rise linearly, the vertex of a parabola is too near a
    whole pixel.

    Source: Mei et al. 2011, AD-Census; Hirschmueller 2008, SGM; Shimizu and Okutomi 2005, fits.
    """

    census_px: int = 9  # Side of the census window; every second pixel is compared.
    presmooth_px: float = 0.6  # Standard deviation of the Gaussian before the census [px].
    tolerance_dn: float = 0.2  # Least difference for a neighbour to count as darker [DN].
    difference_weight: float = 0.125  # Cost of one DN of absolute difference [bit/DN].
    difference_cap_dn: float = 8.0  # Upper limit of the absolute difference [DN].
    support_px: int = 11  # Largest side of the support.
    arm_step_dn: float = 6.0  # The support ends at larger differences in the left image [DN].
    small_penalty: float = 12.0  # P1, for a step of one disparity [bit].
    large_penalty: float = 48.0  # P2, for a larger step [bit].
    second_peak: float = 0.0  # Least extra cost of the second-best disparity [bit, sum of paths].
    neighbour_peak: float = 0.0  # Least extra cost next to the best [bit, sum of paths].
    subpixel_fit: SubpixelFit = "parabola"

    def __post_init__(self) -> None:
        _odd("census_px", self.census_px, 3, 11)
        in_interval("presmooth_px", self.presmooth_px, 0.0, 5.0)
        in_interval("tolerance_dn", self.tolerance_dn, 0.0, 64.0)
        in_interval("difference_weight", self.difference_weight, 0.0, 8.0)
        in_interval("difference_cap_dn", self.difference_cap_dn, 0.0, 255.0)
        _odd("support_px", self.support_px, 1, 15)
        in_interval("arm_step_dn", self.arm_step_dn, 0.0, 255.0)
        in_interval("small_penalty", self.small_penalty, 0.0, MOST_BITS)
        in_interval("large_penalty", self.large_penalty, 0.0, MOST_BITS)
        in_interval("second_peak", self.second_peak, 0.0, 1000.0)
        in_interval("neighbour_peak", self.neighbour_peak, 0.0, 1000.0)
        one_of("subpixel_fit", self.subpixel_fit, get_args(SubpixelFit))
        if self.large_penalty < self.small_penalty:
            raise refuse(
                "large_penalty",
                f"must be >= small_penalty {self.small_penalty:g}",
                self.large_penalty,
                "A larger jump has to cost at least a step.",
            )
        if self.difference_weight * self.difference_cap_dn > 128:
            raise refuse(
                "difference_weight",
                "times difference_cap_dn must be <= 128 bit",
                self.difference_weight * self.difference_cap_dn,
                "Lower either.",
            )


Engine = SemiGlobalBlock | Block | CensusSemiGlobal


@dataclass(frozen=True, kw_only=True, slots=True)
class Refinement:
    """Refinement of the winning disparities. A filter of 0 or 1 px is off."""

    median_px: int = 0  # Side of the median filter on the winners: 0, 3 or 5.
    smooth_px: int = 0  # Width of the jump-preserving mean, odd or 0.
    smooth_rows_px: int = 31  # Largest height of that window; at most its width.
    smooth_step_px: float = 2.0  # Neighbours with a larger difference are excluded [px].
    mean_quantum_px: float = 0.0  # Step of the mean's shift along columns [px]; 0 = no rounding.
    locking_px: float = 0.0  # Amplitude of pixel locking, which has a period of 1 px [px].
    quantum_px: float = 0.0  # Disparity step of the output [px]; 0 = no rounding.

    def __post_init__(self) -> None:
        if self.median_px not in (0, 3, 5):
            raise refuse("median_px", "must be 0, 3 or 5", self.median_px, "0 switches it off.")
        if self.smooth_px:
            _odd("smooth_px", self.smooth_px, 1, 31)
        whole("smooth_rows_px", self.smooth_rows_px, 1, 31)
        in_interval("smooth_step_px", self.smooth_step_px, 0.0, 16.0)
        in_interval("mean_quantum_px", self.mean_quantum_px, 0.0, 1.0)
        in_interval("locking_px", self.locking_px, -0.15, 0.15, "More would fold disparities.")
        in_interval("quantum_px", self.quantum_px, 0.0, 1.0)


@dataclass(frozen=True, kw_only=True, slots=True)
class Checks:
    """Checks of a match. The default of each check accepts all matches."""

    uniqueness: float = 0.0  # Least extra cost of the second-best disparity [percent]; 0 = off.
    left_right_px: float = 1024.0  # Largest left-right difference of the disparities [px].
    left_right_mean_px: int = 0  # Width of a jump-preserving mean before it; 0 = whole px compared.
    left_right_rows_px: int = 31  # Largest height of that window, odd; at most its width.
    texture_dn: float = 0.0  # Least deviation in the left window [DN of 8 bits]; 0 = off.
    dark_noise: float = 0.0  # Least deviation of a lit window [deviations of a dark one]; 0 = off.
    jump_px: float = 1024.0  # Largest range of disparities in 3x3 pixels [px].
    support_share: float = 0.0  # Least share of 13x13 px whose views agree on a like disparity.
    support_step_px: float = 4.0  # Largest difference of like disparities [px].
    speckle_count: int = 0  # Islands of at most this many pixels are removed; 0 = off.
    speckle_step_px: float = 1.0  # A larger step separates two islands [px].
    border_px: float = 0.0  # Least distance of a match from the right image's first column [px].
    near_end: bool = False  # Accept the largest disparity of the search, as a whole pixel.

    def __post_init__(self) -> None:
        in_interval("uniqueness", self.uniqueness, 0.0, 100.0)
        in_interval("left_right_px", self.left_right_px, 0.0, 1024.0)
        if self.left_right_mean_px:
            _odd("left_right_mean_px", self.left_right_mean_px, 1, 31)
        _odd("left_right_rows_px", self.left_right_rows_px, 1, 31)
        in_interval("texture_dn", self.texture_dn, 0.0, 255.0)
        in_interval("dark_noise", self.dark_noise, 0.0, 10.0)
        in_interval("jump_px", self.jump_px, 0.0, 1024.0)
        in_interval("support_share", self.support_share, 0.0, 1.0)
        in_interval("support_step_px", self.support_step_px, 0.0, 16.0)
        whole("speckle_count", self.speckle_count, 0, 1_000_000)
        in_interval("speckle_step_px", self.speckle_step_px, 0.0, 64.0)
        in_interval("border_px", self.border_px, 0.0, 64.0)


@dataclass(frozen=True, kw_only=True, slots=True)
class Matcher:
    """A complete matcher. It searches x_left - x_right in [min, min + search - 1].

    `extended` doubles the largest disparity, as depthai's extended disparity does. `post.near_m`
    has to follow.
    """

    engine: Engine = field(default_factory=CensusSemiGlobal)
    min_disparity_px: int = 0  # RealSense devices call it disparity shift.
    search_px: int = 128  # Number of disparities, a multiple of 16 up to 256.
    extended: bool = False  # Larger disparities come from a match at half the resolution.
    refinement: Refinement = field(default_factory=Refinement)
    checks: Checks = field(default_factory=Checks)

    def __post_init__(self) -> None:
        if not isinstance(self.engine, Engine):
            raise refuse(
                "engine",
                "must be SemiGlobalBlock, Block or CensusSemiGlobal",
                type(self.engine).__name__,
                "Build one from starling.sim.sensor.matcher.",
            )
        whole("min_disparity_px", self.min_disparity_px, 0, 512)
        whole("search_px", self.search_px, FIXED_POINT, 256)
        if self.search_px % FIXED_POINT:
            raise refuse(
                "search_px", f"must be a multiple of {FIXED_POINT}", self.search_px, "Round it up."
            )

    @property
    def largest_px(self) -> int:
        """Largest disparity of the search [px]."""
        if self.extended:
            return 2 * (self.min_disparity_px // 2 + self.search_px - 1)
        return self.min_disparity_px + self.search_px - 1


FAST = Matcher(
    engine=SemiGlobalBlock(),
    checks=Checks(uniqueness=10.0, left_right_px=1.0, speckle_count=100, speckle_step_px=2.0),
)
"""OpenCV's semi-global matcher with common settings: fast, but unlike a device's matcher."""

D4XX = Matcher(
    engine=CensusSemiGlobal(),
    refinement=Refinement(median_px=5, smooth_px=15, smooth_step_px=2.0, quantum_px=1 / 32),
    checks=Checks(
        left_right_px=0.75,  # The device's threshold of 24, read as 1/32 px.
        left_right_mean_px=9,
        texture_dn=0.1,
        dark_noise=1.2,  # Four standard errors of the deviation of 225 pixels.
        jump_px=5.0,
        speckle_count=300,
        speckle_step_px=1.0,
    ),
)
"""The RealSense D4 family's matcher, tuned on its infrared pairs (docs/design/matcher.md).

The device searches 126 disparities (librealsense issue 2885). Here the search has 128 disparities,
and matches at both ends are refused.
"""

KINECT = Matcher(
    engine=CensusSemiGlobal(
        census_px=3,  # A wider census would widen the matching window.
        presmooth_px=0.0,
        difference_weight=0.0,  # The contrasts of reference and image differ.
        support_px=9,
        arm_step_dn=255.0,  # The support is a full square.
        small_penalty=0.0,
        large_penalty=0.0,
    ),
    # Cancels pixel locking of 0.075 px by the fit, which the device's depth does not show.
    refinement=Refinement(locking_px=-0.1, quantum_px=1 / 8),
    checks=Checks(uniqueness=8.0, left_right_px=1.0, speckle_count=60, speckle_step_px=1.0),
)
"""A structured-light camera's matcher: local window, disparities in 1/8 px.

Window 9 px and 1/8 px: Konolige and Mihelich, Technical description of Kinect calibration, 2011.
The thresholds are assumed: docs/decisions/0015-structured-light.md.
"""

OAK = Matcher(
    engine=CensusSemiGlobal(
        census_px=5,
        presmooth_px=0.0,
        tolerance_dn=0.0,  # Threshold of 0.
        difference_weight=0.0,  # Alpha of 0: the cost is the census alone.
        support_px=1,  # No mean of the cost.
        small_penalty=12.0,  # P1 is half of P2, as 250 of 500. Their unit is unknown: both are
        large_penalty=24.0,  # chosen on half a real frame (docs/results/matcher.md).
        subpixel_fit="equal_slopes_of_sums",  # Its disparities' fractions are the device's (same).
    ),
    search_px=96,
    refinement=Refinement(median_px=5, quantum_px=1 / 8),  # Median 7x7, 3 bits of sub-pixels.
    checks=Checks(
        uniqueness=6.0,  # Confidence of 15 of 255, read as a share; assumed.
        left_right_px=10.0,
        dark_noise=1.2,  # As d4xx, assumed.
        speckle_count=50,
        speckle_step_px=2.0,
        near_end=True,  # "94 x 8 steps + 2 (min/max values)": depthai-python#645.
    ),
)
"""The Myriad X in cameras of Luxonis: settings of depthai-core, as far as the engine has them.

What it leaves out is in docs/design/matcher.md.
"""

_NAMED = {"fast": FAST, "d4xx": D4XX, "kinect": KINECT, "oak": OAK}


def names() -> tuple[str, ...]:
    """List the stock settings."""
    return tuple(sorted(_NAMED))


def named(name: str) -> Matcher:
    """Return a stock setting by name.

    Raises:
        InputError: if the name is unknown; the message lists the known names.
    """
    one_of("matcher", name, _NAMED)
    return _NAMED[name]
