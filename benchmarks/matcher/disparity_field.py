"""Test whether the disparity error of a real D415 is fixed in the camera, and fit models to it.

    python benchmarks/matcher/disparity_field.py [--picture FILE]
    python benchmarks/matcher/disparity_field.py --waves ROOM ... [--depth FOLDER]
    python benchmarks/matcher/disparity_field.py --waves ROOM ... --units 24
    python benchmarks/matcher/disparity_field.py --sensor FILE --held ROOM ...

The errors are medians of blocks of 40 x 40 px against the laser scanner, on the 15 scenes of
`d415-faro`. They are computed for the device's depth and for our matcher's depth on the same
infrared images. Each model is fitted to all rooms except one, and scored on that room. An error
that both depths share comes from the images, not from the device's matcher.

With --waves, it prints the size and the correlation of what repeats in these rooms. These are
covariances of the block medians of different rooms, less each scene's median. FOLDER is a capture
set with another depth of the same scenes, such as a simulated one. With --units, it also prints
what the waves alone of that many units of the preset `d415` give at these places and disparities.

With --sensor, the script runs `starling calibrate --free warp` without the held-out rooms. It then
prints the remaining difference between captured and simulated pairs in these rooms.
Captures: `d415-faro` in the folder $STARLING_CAPTURES.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import match_faro
import numpy as np
from numpy.typing import NDArray

from starling.calibration import observation
from starling.calibration.geometry import warp_fit
from starling.sim.captures import capture
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.imaging.imager.charge import Die
from starling.sim.imaging.optics.waves import field as wave_field
from starling.sim.metrics import LEFT_BAND_PX
from starling.sim.plotting import sheet
from starling.sim.sensor import resolve
from starling.sim.sensor.matcher import named
from starling.sim.stereo.matching import match

BLOCK_PX = 40
LEAST_PX = 300  # Minimum number of known pixels in a block.
FARTHEST_PX = 1.5  # Larger errors are wrong matches.
FOCAL_PX = 896.0  # Approximate focal length for normalised coordinates.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Blocks:
    """One scene by blocks (rows, columns), NaN with too few pixels."""

    room: str
    error_px: NDArray
    disparity_px: NDArray


Model = Callable[[Blocks], NDArray]  # Gives (rows, columns, terms).


def blocks(room: str, found_px: NDArray, truth_px: NDArray) -> Blocks:
    """Return the median error and disparity of each block."""
    error = found_px - truth_px
    error[np.abs(error) > FARTHEST_PX] = np.nan
    rows, columns = (side // BLOCK_PX for side in error.shape)

    def medians(values: NDArray) -> NDArray:
        tiles = values[: rows * BLOCK_PX, : columns * BLOCK_PX]
        tiles = tiles.reshape(rows, BLOCK_PX, columns, BLOCK_PX).swapaxes(1, 2)
        tiles = tiles.reshape(rows, columns, -1)
        known = np.isfinite(tiles).sum(axis=-1) >= LEAST_PX
        result = np.full((rows, columns), np.nan)
        result[known] = np.nanmedian(tiles[known], axis=-1)
        return result

    return Blocks(room=room, error_px=medians(error), disparity_px=medians(truth_px))


def places(shape: tuple[int, ...]) -> tuple[NDArray, NDArray]:
    """Return the positions of blocks relative to the image centre, in half widths."""
    rows, columns = shape
    y, x = np.mgrid[:rows, :columns]
    return (x + 0.5) / (columns / 2) - 1, (y + 0.5 - rows / 2) / (columns / 2)


def polynomial(degree: int) -> Model:
    """Return a model that is a polynomial of the image position, independent of depth."""

    def terms(scene: Blocks) -> NDArray:
        x, y = places(scene.error_px.shape)
        powers = [(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)]
        return np.stack([x**i * y**j for i, j in powers], axis=-1)

    return terms


def lenses(orders: Sequence[int]) -> Model:
    """Return a model of residual radial distortion in each lens, with offset and baseline error."""

    def terms(scene: Blocks) -> NDArray:
        half = scene.error_px.shape[1] * BLOCK_PX / 2 / FOCAL_PX
        x, y = (coordinate * half for coordinate in places(scene.error_px.shape))
        shift = np.nan_to_num(scene.disparity_px) / FOCAL_PX
        views = [(x, y), (x - shift, y)]
        radial = [u * (u**2 + v**2) ** k * FOCAL_PX for k in orders for u, v in views]
        return np.stack([np.ones_like(x), shift * FOCAL_PX, *radial], axis=-1)

    return terms


def grid(scene: Blocks) -> NDArray:
    """Return the terms of a model with one free value for each block."""
    return np.eye(scene.error_px.size).reshape(*scene.error_px.shape, -1)


MODELS: dict[str, Model] = {
    "one offset": polynomial(0),
    "radial distortion of each lens, r^3": lenses([1]),
    "radial distortion of each lens, r^3 to r^7": lenses([1, 2, 3]),
    "polynomial of degree 2": polynomial(2),
    "polynomial of degree 4": polynomial(4),
    "polynomial of degree 6": polynomial(6),
    "a value for each block": grid,
}


def heldout_rms(scenes: Sequence[Blocks], model: Model) -> float:
    """Return the root mean square residual [px], mean over held-out rooms."""
    rooms = sorted({scene.room for scene in scenes})
    squares = []
    for room in rooms:
        fitted_scenes = [scene for scene in scenes if scene.room != room]
        known = [np.isfinite(scene.error_px) for scene in fitted_scenes]
        terms = np.concatenate(
            [model(scene)[mask] for scene, mask in zip(fitted_scenes, known, strict=True)]
        )
        errors = np.concatenate(
            [scene.error_px[mask] for scene, mask in zip(fitted_scenes, known, strict=True)]
        )
        fitted = np.linalg.lstsq(terms, errors, rcond=None)[0]
        held_out = [scene for scene in scenes if scene.room == room]
        squares.append(
            np.mean(
                [np.nanmean((scene.error_px - model(scene) @ fitted) ** 2) for scene in held_out]
            )
        )
    return float(np.sqrt(np.mean(squares)))


def draw(fields: dict[str, NDArray], path: Path) -> None:
    """Draw mean fields side by side."""
    figure = sheet.new_figure((4.4 * len(fields), 2.9), 110, layout="constrained")
    for axes, (label, field) in zip(figure.subplots(1, len(fields)), fields.items(), strict=True):
        shown = axes.imshow(field - np.nanmedian(field), cmap="RdBu_r", vmin=-0.4, vmax=0.4)
        axes.set_axis_off()
        axes.set_title(f"{label}: disparity error less its median [px]", fontsize=9)
        figure.colorbar(shown, ax=axes, shrink=0.7)
    path.write_bytes(sheet.encode(figure))


def repeated(scenes: Sequence[Blocks], down: int, across: int) -> float:
    """Return the mean product [px^2] of blocks some blocks apart, in different rooms."""
    products = []
    for first in scenes:
        for second in scenes:
            if first.room != second.room:
                rows, columns = first.error_px.shape
                near = first.error_px[: rows - down, : columns - across]
                far = second.error_px[down:, across:]
                both = (near - np.nanmedian(first.error_px)) * (far - np.nanmedian(second.error_px))
                products.append(both[np.isfinite(both)])
    return float(np.concatenate(products).mean())


def waving(scenes: Sequence[Blocks], unit: int) -> list[Blocks]:
    """Return the disparity errors of a unit's waves at the blocks' middles."""
    sensor = resolve.load("d415")
    pinhole = Pinhole.from_camera(sensor)
    left = wave_field(sensor.left.alignment, pinhole, Die(unit, "left"))
    right = wave_field(sensor.right.alignment, pinhole, Die(unit, "right"))
    result = []
    for scene in scenes:
        down, across = np.round((np.indices(scene.error_px.shape) + 0.5) * BLOCK_PX - 0.5).astype(
            int
        )
        opposite = np.round(across - np.nan_to_num(scene.disparity_px)).astype(int)
        opposite = np.clip(opposite, 0, pinhole.width - 1)
        error_px = (left[down, across] - right[down, opposite]).astype(np.float64)
        error_px[np.isnan(scene.error_px)] = np.nan
        result.append(dataclasses.replace(scene, error_px=error_px))
    return result


def waves(where: Path, rooms: Sequence[str], depth: Path, units: int) -> None:
    """Print size and correlation of the errors that repeat from room to room."""
    seen = []
    for scene in capture.open_set(where).scenes:
        place = depth / scene.name
        if scene.room not in rooms or not place.is_dir():
            continue
        depth_m = capture.open_set(place).scenes[0].frame(0).depth_m
        truth_m = scene.truth_m()
        assert depth_m is not None and truth_m is not None
        pair = (scene.info.disparity_px(each) for each in (depth_m, truth_m))
        found_px, truth_px = pair
        found_px[:, :LEFT_BAND_PX] = np.nan
        seen.append(blocks(scene.room, found_px, truth_px))
    spread = np.mean([np.nanvar(scene.error_px) for scene in seen])
    size = repeated(seen, 0, 0)
    print(f"block medians: RMS {spread**0.5:.3f} px, repeated {max(size, 0) ** 0.5:.3f} px")
    steps = range(0, 12, 2)
    if units:
        sizes = [max(repeated(waving(seen, unit), 0, 0), 0) ** 0.5 for unit in range(units)]
        spread = f"standard deviation {np.std(sizes):.3f}, {min(sizes):.3f} to {max(sizes):.3f} px"
        print(f"waves of {units} units: repeated {np.mean(sizes):.3f} px, {spread}")
        print(f"unit 0: {sizes[0]:.3f} px")
    for label, places in (("across", [(0, k) for k in steps]), ("down", [(k, 0) for k in steps])):
        shares = " ".join(f"{repeated(seen, *place) / size:5.2f}" for place in places)
        print(f"correlation {label}, by {2 * BLOCK_PX} px: {shares}")


def warped(where: Path, file: str, held: Sequence[str]) -> None:
    """Print the residual of a fitted warp in held-out rooms."""
    sensor = resolve.load(file, captures=str(where))
    seen = [observation.load(scene, sensor) for scene in capture.open_set(where).scenes]
    result = warp_fit.fit_warp(
        [scene_observation for scene_observation in seen if scene_observation.room not in held],
        sensor,
    )
    print(result.estimates[0])
    squares = []
    for scene_observation in seen:
        if scene_observation.room in held:
            cells = [
                warp_fit.difference(scene_observation, candidate)
                for candidate in (sensor, result.sensor)
            ]
            squares.append([np.nanmean(candidate**2) for candidate in cells])
            before, after = np.sqrt(squares[-1])
            print(
                f"room {scene_observation.room}, {scene_observation.name}: "
                f"RMS {before:.3f} px without, {after:.3f} px with"
            )
    before, after = np.sqrt(np.mean(squares, axis=0))
    print(f"all: {before:.3f} px without, {after:.3f} px with")


def main() -> None:
    """Print the residual of each model, for both depths."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--sensor", help="preset or sensor file, calibrated except for the warp")
    parser.add_argument("--held", nargs="+", default=[], help="rooms to hold out from the warp fit")
    parser.add_argument("--waves", nargs="+", default=[], help="rooms to measure what repeats in")
    parser.add_argument("--units", type=int, default=0, help="units whose waves --waves compares")
    parser.add_argument("--depth", type=Path, help="capture set with another depth for --waves")
    options = parser.parse_args()
    where = match_faro.folder()
    if options.waves:
        return waves(where, options.waves, options.depth or where, options.units)
    if options.sensor:
        return warped(where, options.sensor, options.held)
    device, ours = [], []
    for scene in match_faro.scenes(where):
        room = (where / scene.name / "room").read_text(encoding="utf-8").strip()
        device.append(blocks(room, scene.device_px, scene.truth_px))
        disparity = match(scene.left, scene.right, named("d4xx")).disparity_px
        ours.append(blocks(room, disparity, scene.truth_px))
    fields = {
        label: np.nanmean([scene_blocks.error_px for scene_blocks in scenes], axis=0)
        for label, scenes in (("device", device), ("d4xx on its infrared", ours))
    }
    first, second = (field.ravel() for field in fields.values())
    both = np.isfinite(first) & np.isfinite(second)
    print(f"correlation of both mean fields: {np.corrcoef(first[both], second[both])[0, 1]:.3f}")
    print("RMS left in rooms kept aside [px]: device, d4xx on its infrared")
    print(f"{'nothing':45} {rms(device):.3f} {rms(ours):.3f}")
    for name, model in MODELS.items():
        print(f"{name:45} {heldout_rms(device, model):.3f} {heldout_rms(ours, model):.3f}")
    if options.picture:
        draw(fields, options.picture)


def rms(scenes: Sequence[Blocks]) -> float:
    """Return the root mean square error [px], mean over scenes."""
    return float(np.sqrt(np.mean([np.nanmean(scene.error_px**2) for scene in scenes])))


if __name__ == "__main__":
    main()
