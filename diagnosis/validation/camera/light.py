"""Linear light of one scene before any camera: `light.npz`."""

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
class View:
    """What one imager would receive through a perfect lens, every image (h, w)."""

    laser_e: Image  # Projector's dots at nominal power and exposure [electrons].
    even_e: Image  # The same if the projector threw even light of the same mean.
    ambient_e: Image  # Under ambient light of 1 W m^-2.
    other_e: Image  # From another device's projector of 1 W.
    depth_m: Image  # z [m] along this imager's axis, NaN where there is nothing.
    body: NDArray[np.uint32]  # Number of the object, 0 where there is none.
    px: Image  # Tangent x / z of the seen point in the projector's frame.
    py: Image  # y / z there.
    up: NDArray[np.float64]  # (3,) unit, against gravity in this imager's frame.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Light:
    """Both views of one scene."""

    left: View
    right: View

    def view(self, side: str) -> View:
        """The view of one of `SIDES`."""
        return self.left if side == "left" else self.right


def read(path: Path, shape: tuple[int, int]) -> Light:
    """Read `light.npz`.

    Args:
        path: The file.
        shape: (h, w) that every array must have.

    Raises:
        WithheldError: if the file is missing or damaged, or an array is missing or of another size.
    """
    try:
        with path.open("rb") as file, np.load(file) as arrays:
            held = {name: arrays[name] for name in arrays.files}
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise refusal(FILE, "must be a readable archive of arrays", path, f"{error}.") from error
    views = {side: _view(held, side, shape) for side in SIDES}
    return Light(left=views["left"], right=views["right"])


def _view(held: dict[str, np.ndarray], side: str, shape: tuple[int, int]) -> View:
    def image(name: str) -> np.ndarray:
        key = f"{side}_{name}"
        if key not in held:
            raise refusal(FILE, f"must hold {key}", sorted(held), "Make the light again.")
        if held[key].shape != shape:
            raise refusal(
                key,
                f"must be of shape {shape}",
                held[key].shape,
                "Make the light for this nominal.json.",
            )
        return held[key]

    def light(name: str) -> Image:
        values = image(name).astype(np.float64)
        if not (np.isfinite(values).all() and (values >= 0).all()):
            raise refusal(
                f"{side}_{name}", "must be finite and >= 0", np.min(values), "Make it again."
            )
        return values

    return View(
        laser_e=light("laser_e"),
        even_e=light("even_e"),
        ambient_e=light("ambient_e"),
        other_e=light("other_e"),
        depth_m=image("depth_m").astype(np.float64),
        body=image("body").astype(np.uint32),
        px=image("px").astype(np.float64),
        py=image("py").astype(np.float64),
        up=_unit(held, f"{side}_up"),
    )


def _unit(held: dict[str, np.ndarray], key: str) -> NDArray[np.float64]:
    if key not in held:
        raise refusal(FILE, f"must hold {key}", sorted(held), "Make the light again.")
    up = held[key].astype(np.float64)
    length = float(np.sqrt((up**2).sum()))
    if up.shape != (3,) or not np.isfinite(length) or length == 0.0:
        raise refusal(key, "must be three numbers with a length", up, "Give a direction.")
    return up / length
