"""Linear light of one scene, without any camera effect (`light.npz`), and what the lenses receive.

The effects here are those of the scene: ambient light, subsurface scattering, second projector and
exposure.
"""

from __future__ import annotations

import dataclasses
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from starling.diagnosis.validation.camera import psf
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.camera.psf import Image, Mask

FILE = "light.npz"
SIDES = ("left", "right")
_PLANE_PX = 5  # Side of the window in which a surface normal is fitted [px].
_LIT = 1e-4  # Uniform light over its maximum below which a surface counts as unlit.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class LightView:
    """Light that one imager receives through a perfect lens; every image is (h, w)."""

    laser_e: Image  # Projector dots at nominal power and exposure [electrons].
    even_e: Image  # The same with uniform projector light of equal mean [electrons].
    ambient_e: Image  # Ambient light of 1 W m^-2 [electrons].
    other_e: Image  # Projector of a second device at 1 W [electrons].
    depth_m: Image  # z [m] along the axis of this imager, NaN where there is no surface.
    body: NDArray[np.uint32]  # Number of the object, 0 where there is none.
    px: Image  # Tangent x / z of the surface point in the frame of the projector.
    py: Image  # Tangent y / z of the surface point in the frame of the projector.
    up: NDArray[np.float64]  # (3,) unit vector against gravity in the frame of this imager.

    def lit(self) -> Mask:
        """Return a mask (h, w) of the pixels that see a surface lit by the projector."""
        brightest = float(self.even_e.max(initial=0.0))
        return (self.even_e > _LIT * brightest) & np.isfinite(self.px)

    def pattern(self) -> Image:
        """Return the pattern (h, w): dot light over uniform light, mean about 1, 0 where unlit."""
        lit = self.lit()
        return np.where(lit, self.laser_e / np.where(lit, self.even_e, 1.0), 0.0)

    def with_pattern(self, pattern: Image) -> LightView:
        """Replace the pattern (h, w) of the projector's light."""
        return dataclasses.replace(self, laser_e=self.even_e * pattern)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SceneLight:
    """Both views of one scene."""

    left: LightView
    right: LightView

    def view(self, side: str) -> LightView:
        """Return the view of one of `SIDES`."""
        return self.left if side == "left" else self.right


def read(path: Path, shape: tuple[int, int]) -> SceneLight:
    """Read `light.npz`.

    Args:
        path: The file.
        shape: (h, w) that every array must have.

    Raises:
        WithheldError: if the file is missing or damaged, or an array is missing or has a wrong
            size.
    """
    try:
        with warnings.catch_warnings():  # NumPy warns of odd headers.
            warnings.simplefilter("ignore")
            with path.open("rb") as file, np.load(file) as arrays:
                loaded = {name: arrays[name] for name in arrays.files}
    except Exception as error:  # NumPy raises errors of many types for damaged archives.
        raise refusal(FILE, "must be a readable archive of arrays", path, f"{error}.") from error
    left, right = (_view(loaded, side, shape) for side in SIDES)
    return SceneLight(left=left, right=right)


def _view(loaded: dict[str, np.ndarray], side: str, shape: tuple[int, int]) -> LightView:
    arrays = {}
    for name in (field.name for field in dataclasses.fields(LightView)):
        key = f"{side}_{name}"
        if key not in loaded:
            raise refusal(FILE, f"must hold {key}", sorted(loaded), "Make the light again.")
        values, kinds = loaded[key], "ui" if name == "body" else "f"
        if not isinstance(values, np.ndarray) or values.dtype.kind not in kinds:
            rule = f"must be an array of kind {kinds}"
            raise refusal(key, rule, type(values).__name__, "Make the light again.")
        # NaN can be of a signalling kind, and long numbers exceed 64 bits.
        with np.errstate(invalid="ignore", over="ignore"):
            values = values.astype(np.uint32 if name == "body" else np.float64)
        if name == "up":
            with np.errstate(over="ignore"):
                length = float(np.sqrt((values**2).sum()))
            if values.shape != (3,) or not np.isfinite(length) or length == 0.0:
                rule = "must be three numbers with a length"
                raise refusal(key, rule, values, "Give a direction.")
            values = values / length
        elif values.shape != shape:
            advice = "Make the light for this nominal.json."
            raise refusal(key, f"must be of shape {shape}", values.shape, advice)
        elif name.endswith("_e") and not (np.isfinite(values).all() and (values >= 0).all()):
            raise refusal(key, "must be finite and >= 0", np.min(values), "Make it again.")
        elif name == "depth_m" and ((values <= 0) | np.isinf(values)).any():
            rule = "must be > 0, or NaN where there is no surface"
            raise refusal(key, rule, np.nanmin(values), "Make it again.")
        arrays[name] = values
    return LightView(**arrays)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ReceivedLight:
    """Light that one lens receives during the exposure, as electrons, (h, w) each."""

    laser_e: Image  # Light of the device's own projector; coherent, so it has speckle.
    rest_e: Image  # All other light.


def leave(view: LightView, strengths: Strengths) -> ReceivedLight:
    """Combine the light that one imager receives from the surfaces.

    Args:
        view: Light that includes the effects of the projector.
        strengths: Nominal camera and effect strengths.
    """
    nominal = strengths.nominal
    view = _inside_bodies(view, strengths)
    rest = view.ambient_e * strengths["ambient"]
    if strengths.is_active("ambient_gradient"):
        up = facing_up(view, nominal)
        rendered = _under_gradient(nominal.ambient_gradient, up)
        rest = rest * (_under_gradient(strengths["ambient_gradient"], up) / rendered)
    second_w = strengths["second_projector"]
    if second_w != 0.0:
        rest = rest + second_w * view.other_e
    time = strengths["exposure"] / nominal.exposure_s
    return ReceivedLight(laser_e=view.laser_e * time, rest_e=rest * time)


def facing_up(view: LightView, nominal: Nominal) -> Image:
    """Return the cosine between surface normal and up (h, w), 0 where there is no surface.

    The inverse depth of a plane is affine in pixel coordinates. A least-squares fit of the slopes
    in a window (Savitzky and Golay) gives the normal of the plane.
    """
    x, y = nominal.tangents()
    inverse = 1.0 / view.depth_m
    steps = np.arange(_PLANE_PX) - _PLANE_PX // 2
    slope = steps[::-1] / (_PLANE_PX * float(steps @ steps))
    box = np.ones(_PLANE_PX)
    # A window across an edge or next to missing depth holds no plane; it takes the nearest normal.
    whole = _one_body(view)
    across = ndimage.convolve1d(ndimage.convolve1d(inverse, slope, 1), box, 0)
    down = ndimage.convolve1d(ndimage.convolve1d(inverse, slope, 0), box, 1)
    if not whole.any():
        return np.zeros(view.depth_m.shape)
    nearest = ndimage.distance_transform_edt(~whole, return_distances=False, return_indices=True)
    pixel = tuple(np.asarray(nearest))
    # 1 / z = (n . ray) / (n . p): nx and ny are proportional to the slopes; nz is the remainder.
    nx, ny = across[pixel] * nominal.fx_px, down[pixel] * nominal.fy_px
    nz = inverse[pixel] - nx * x[pixel] - ny * y[pixel]
    length = np.sqrt(nx**2 + ny**2 + nz**2)
    up = view.up
    towards = -(nx * up[0] + ny * up[1] + nz * up[2]) / length
    return np.where(view.body > 0, towards, 0.0)


def _under_gradient(gradient: float, up: Image) -> Image:
    """Ratio (h, w) of light under a sky gradient to that under a uniform sky (effect page)."""
    return 1.0 + 2.0 / 3.0 * gradient * up


def _one_body(view: LightView) -> Mask:
    """Pixels whose window lies on one body and has depth everywhere."""
    same = ndimage.minimum_filter(view.body, _PLANE_PX) == ndimage.maximum_filter(
        view.body, _PLANE_PX
    )
    known = ndimage.minimum_filter(np.isfinite(view.depth_m), _PLANE_PX)
    whole = same & known & (view.body > 0)
    rim = _PLANE_PX // 2
    inner = np.zeros_like(whole)
    inner[rim:-rim, rim:-rim] = whole[rim:-rim, rim:-rim]
    return inner


def _inside_bodies(view: LightView, strengths: Strengths) -> LightView:
    """Spread the projector's light inside each body.

    Diffuse light decays as exp(-r / l), not as a Gaussian (Jensen et al. 2001, eq. 4). The length l
    gives the variance of the effect page, (fx sigma / z)^2. A uniform pattern stays uniform.
    """
    sigma_m = strengths["subsurface"]
    if sigma_m == 0.0:
        return view
    sigma_px = np.nan_to_num(strengths.nominal.fx_px * sigma_m / view.depth_m)
    lit, pattern = view.lit(), view.pattern()
    spread_pattern = np.zeros_like(pattern)
    for body in np.unique(view.body[lit]):
        inside = lit & (view.body == body)
        body_pattern = np.where(inside, pattern, 0.0)
        spread_pattern += psf.scatter_within(body_pattern, sigma_px, "exponential", inside)
    return view.with_pattern(spread_pattern)
