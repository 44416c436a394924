"""Linear light of one scene, without any camera effect: `light.npz`."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.validation.camera.errors import refusal

FILE = "light.npz"
SIDES = ("left", "right")
Image = NDArray[np.float64]


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
        with path.open("rb") as file, np.load(file) as arrays:
            loaded = {name: arrays[name] for name in arrays.files}
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise refusal(FILE, "must be a readable archive of arrays", path, f"{error}.") from error
    views = {side: _view(loaded, side, shape) for side in SIDES}
    return SceneLight(left=views["left"], right=views["right"])


def _view(loaded: dict[str, np.ndarray], side: str, shape: tuple[int, int]) -> LightView:
    def image(name: str) -> np.ndarray:
        key = f"{side}_{name}"
        if key not in loaded:
            raise refusal(FILE, f"must hold {key}", sorted(loaded), "Make the light again.")
        if loaded[key].shape != shape:
            raise refusal(
                key,
                f"must be of shape {shape}",
                loaded[key].shape,
                "Make the light for this nominal.json.",
            )
        return loaded[key]

    def light(name: str) -> Image:
        values = image(name).astype(np.float64)
        if not (np.isfinite(values).all() and (values >= 0).all()):
            raise refusal(
                f"{side}_{name}", "must be finite and >= 0", np.min(values), "Make it again."
            )
        return values

    return LightView(
        laser_e=light("laser_e"),
        even_e=light("even_e"),
        ambient_e=light("ambient_e"),
        other_e=light("other_e"),
        depth_m=image("depth_m").astype(np.float64),
        body=image("body").astype(np.uint32),
        px=image("px").astype(np.float64),
        py=image("py").astype(np.float64),
        up=_unit(loaded, f"{side}_up"),
    )


def _unit(loaded: dict[str, np.ndarray], key: str) -> NDArray[np.float64]:
    if key not in loaded:
        raise refusal(FILE, f"must hold {key}", sorted(loaded), "Make the light again.")
    up = loaded[key].astype(np.float64)
    length = float(np.sqrt((up**2).sum()))
    if up.shape != (3,) or not np.isfinite(length) or length == 0.0:
        raise refusal(key, "must be three numbers with a length", up, "Give a direction.")
    return up / length
