"""Is a real D415's disparity error fixed in the camera, and what would explain it there?

    python benchmarks/matcher/disparity_field.py [--picture FILE]
    python benchmarks/matcher/disparity_field.py --sensor FILE --held ROOM ...

Errors against the laser scanner on the 15 scenes of `d415-faro`, as medians of blocks of 40 x 40
px, of the device's own depth and of our matcher's on the same infrared. Each model is fitted to all
rooms but one and judged there. What both depths share lies in the images, not in the device's
matcher.
With --sensor: `starling calibrate --free warp` on all rooms but the held ones, and what is left
there between captured and simulated pairs.
Captures: `d415-faro` in the folder $STARLING_CAPTURES.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import match_faro
import numpy as np
from numpy.typing import NDArray

from starling.calibration import heldout, observation
from starling.calibration.geometry import warp_fit
from starling.sim.captures import capture
from starling.sim.plotting import canvas
from starling.sim.sensor import resolve
from starling.sim.sensor.matcher import named
from starling.sim.stereo.matching import match

BLOCK_PX = 40
LEAST_PX = 300  # Known pixels of a block.
FARTHEST_PX = 1.5  # Errors beyond are wrong matches, no field.
FOCAL_PX = 896.0  # To scale normalised coordinates; distortion does not depend on it closely.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Blocks:
    """One scene by blocks (rows, columns), NaN where too little is known."""

    room: str
    error_px: NDArray
    disparity_px: NDArray


Model = Callable[[Blocks], NDArray]  # Gives (rows, columns, terms).


def blocks(room: str, found_px: NDArray, truth_px: NDArray) -> Blocks:
    """Take the median error and disparity of each block."""
    error = found_px - truth_px
    error[np.abs(error) > FARTHEST_PX] = np.nan
    rows, columns = (side // BLOCK_PX for side in error.shape)

    def medians(values: NDArray) -> NDArray:
        parted = values[: rows * BLOCK_PX, : columns * BLOCK_PX]
        parted = parted.reshape(rows, BLOCK_PX, columns, BLOCK_PX).swapaxes(1, 2)
        parted = parted.reshape(rows, columns, -1)
        known = np.isfinite(parted).sum(axis=-1) >= LEAST_PX
        found = np.full((rows, columns), np.nan)
        found[known] = np.nanmedian(parted[known], axis=-1)
        return found

    return Blocks(room=room, error_px=medians(error), disparity_px=medians(truth_px))


def places(shape: tuple[int, ...]) -> tuple[NDArray, NDArray]:
    """Centres of blocks from the image's, in half widths."""
    rows, columns = shape
    y, x = np.mgrid[:rows, :columns]
    return (x + 0.5) / (columns / 2) - 1, (y + 0.5 - rows / 2) / (columns / 2)


def polynomial(degree: int) -> Model:
    """A smooth field of the image, the same at any depth."""

    def terms(of: Blocks) -> NDArray:
        x, y = places(of.error_px.shape)
        powers = [(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)]
        return np.stack([x**i * y**j for i, j in powers], axis=-1)

    return terms


def lenses(orders: Sequence[int]) -> Model:
    """Radial distortion left over in each lens, beside an offset and an error of the baseline."""

    def terms(of: Blocks) -> NDArray:
        half = of.error_px.shape[1] * BLOCK_PX / 2 / FOCAL_PX
        x, y = (one * half for one in places(of.error_px.shape))
        shift = np.nan_to_num(of.disparity_px) / FOCAL_PX
        seen = [(x, y), (x - shift, y)]
        radial = [u * (u**2 + v**2) ** k * FOCAL_PX for k in orders for u, v in seen]
        return np.stack([np.ones_like(x), shift * FOCAL_PX, *radial], axis=-1)

    return terms


def grid(of: Blocks) -> NDArray:
    """A value of its own for each block."""
    return np.eye(of.error_px.size).reshape(*of.error_px.shape, -1)


MODELS: dict[str, Model] = {
    "one offset": polynomial(0),
    "radial distortion of each lens, r^3": lenses([1]),
    "radial distortion of each lens, r^3 to r^7": lenses([1, 2, 3]),
    "polynomial of degree 2": polynomial(2),
    "polynomial of degree 4": polynomial(4),
    "polynomial of degree 6": polynomial(6),
    "a value for each block": grid,
}


def left_over(scenes: Sequence[Blocks], model: Model) -> float:
    """Root mean square of what is left [px], mean over rooms that had no say in the fit."""
    rooms = sorted({one.room for one in scenes})
    squares = []
    for room in rooms:
        others = [one for one in scenes if one.room != room]
        known = [np.isfinite(one.error_px) for one in others]
        made = np.concatenate([model(one)[k] for one, k in zip(others, known, strict=True)])
        errors = np.concatenate([one.error_px[k] for one, k in zip(others, known, strict=True)])
        fitted = np.linalg.lstsq(made, errors, rcond=None)[0]
        own = [one for one in scenes if one.room == room]
        squares.append(
            np.mean([np.nanmean((one.error_px - model(one) @ fitted) ** 2) for one in own])
        )
    return float(np.sqrt(np.mean(squares)))


def draw(fields: dict[str, NDArray], path: Path) -> None:
    """Draw mean fields beside each other."""
    figure = canvas.empty((4.4 * len(fields), 2.9), 110, layout="constrained")
    for axes, (label, field) in zip(figure.subplots(1, len(fields)), fields.items(), strict=True):
        shown = axes.imshow(field - np.nanmedian(field), cmap="RdBu_r", vmin=-0.4, vmax=0.4)
        axes.set_axis_off()
        axes.set_title(f"{label}: disparity error less its median [px]", fontsize=9)
        figure.colorbar(shown, ax=axes, shrink=0.7)
    path.write_bytes(canvas.encoded(figure))


def warped(where: Path, file: str, held: Sequence[str]) -> None:
    """Print what the warp leaves in rooms that it was not fitted to."""
    sensor = resolve.load(file, captures=str(where))
    seen = [
        observation.load(scene, sensor, smoothing_px=heldout.SMOOTHING_PX)
        for scene in capture.open_set(where).scenes
    ]
    found = warp_fit.fit_warp([one for one in seen if one.room not in held], sensor)
    print(found.estimates[0])
    squares = []
    for one in seen:
        if one.room in held:
            cells = [warp_fit.difference(one, each) for each in (sensor, found.sensor)]
            squares.append([np.nanmean(each**2) for each in cells])
            before, after = np.sqrt(squares[-1])
            print(f"room {one.room}, {one.name}: RMS {before:.3f} px without, {after:.3f} px with")
    before, after = np.sqrt(np.mean(squares, axis=0))
    print(f"all: {before:.3f} px without, {after:.3f} px with")


def main() -> None:
    """Print what each model leaves, for both depths."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--sensor", help="preset or sensor file, but for the warp calibrated")
    parser.add_argument("--held", nargs="+", default=[], help="rooms that the warp is judged on")
    asked = parser.parse_args()
    where = match_faro.folder()
    if asked.sensor:
        return warped(where, asked.sensor, asked.held)
    device, ours = [], []
    for scene in match_faro.scenes(where):
        room = (where / scene.name / "room").read_text(encoding="utf-8").strip()
        device.append(blocks(room, scene.device_px, scene.truth_px))
        found = match(scene.left, scene.right, named("d4xx")).disparity_px
        ours.append(blocks(room, found, scene.truth_px))
    fields = {
        label: np.nanmean([one.error_px for one in scenes], axis=0)
        for label, scenes in (("device", device), ("d4xx on its infrared", ours))
    }
    first, second = (field.ravel() for field in fields.values())
    both = np.isfinite(first) & np.isfinite(second)
    print(f"correlation of both mean fields: {np.corrcoef(first[both], second[both])[0, 1]:.3f}")
    print("RMS left in rooms kept aside [px]: device, d4xx on its infrared")
    print(f"{'nothing':45} {rms(device):.3f} {rms(ours):.3f}")
    for name, model in MODELS.items():
        print(f"{name:45} {left_over(device, model):.3f} {left_over(ours, model):.3f}")
    if asked.picture:
        draw(fields, asked.picture)


def rms(scenes: Sequence[Blocks]) -> float:
    """Root mean square of the errors [px], mean over scenes."""
    return float(np.sqrt(np.mean([np.nanmean(one.error_px**2) for one in scenes])))


if __name__ == "__main__":
    main()
