"""Compare simulated infrared images of a real D415's rooms with the real ones.

Each scene's reflectance is estimated in full detail from its infrared images. The correlation with
the real right image is that of a scene whose reflectance comes from the left image alone. Its
ceiling is the real right image, warped into the left view, against the left image. Powers, holes
and disparities are those of a scene whose reflectance comes from both images. Captures: `d415-faro`
in the folder $STARLING_CAPTURES.

Usage:
    python benchmarks/simulation/infrared_d415.py --rooms 0060 1982
    python benchmarks/simulation/infrared_d415.py --sensor SENSOR.toml --rooms 0742 3049 e
    python benchmarks/simulation/infrared_d415.py --smoothing 12 --pictures FOLDER

A sensor calibrated on some rooms must be judged on others. The pattern scale is fitted to each
scene unless the sensor is a preset. Pictures show real captures, so their folder must be outside
the project.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from starling import CapturedScene, Sensor
from starling.calibration import correlation, heldout
from starling.diagnosis.scenes import fit_scene
from starling.sim import metrics
from starling.sim.captures import capture
from starling.sim.imaging.noiseless import noiseless
from starling.sim.render.layers import Layers
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.captured import captured_scene
from starling.sim.scene.scene import Scene
from starling.sim.sensor import resolve
from starling.sim.simulate import Shot, expose, render_layers

SIDE_PX = 64  # Side of a window of the power spectrum.
PERIODS_PX = ((2, 4), (4, 8), (8, 16), (16, 33))
COLUMNS = (
    "right NCC, share of ceiling, median",
    "lower quartile",
    *(f"power {low}-{high} px" for low, high in PERIODS_PX),
    "power of the pair's difference 2-4 px",
    "level",
    "NMAD",
    "holes IoU",
)
Image = NDArray[Any]
Mask = NDArray[np.bool_]


def main() -> None:
    """Print a row for each scene, and medians."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--sensor", default="d415")
    parser.add_argument("--rooms", nargs="*", default=[], help="all rooms if none")
    parser.add_argument("--smoothing", type=float, default=0.0, help="of reflectance [px]")
    parser.add_argument("--pictures", type=Path, help="folder for pictures of each scene")
    options = parser.parse_args()
    path = Path(os.environ["STARLING_CAPTURES"]) / "d415-faro"
    base = resolve.load(options.sensor, captures=str(path))
    print(f"| scene | {' | '.join(COLUMNS)} |\n|{'---|' * (1 + len(COLUMNS))}")
    rows = []
    for scene in capture.open_set(path).scenes:
        if options.rooms and scene.room not in options.rooms:
            continue
        rows.append(figures(scene, base, options))
        print_row(f"{scene.name} ({scene.room})", rows[-1])
    print_row("median", np.median(rows, axis=0))


def figures(scene: CapturedScene, base: Sensor, options: argparse.Namespace) -> list[float]:
    """Simulate one scene and return its figures, simulated over real."""
    preset = not Path(options.sensor).suffix
    sensor = base if preset else at_fitted_scale(scene, base)
    room = load_room(scene, sensor, options.smoothing, left_only=True)
    layers = render_layers(MitsubaScene(room), sensor)
    share = right_correlation(scene, sensor, room, layers)
    if not options.smoothing:
        room = load_room(scene, sensor, 0.0, left_only=False)
        layers = render_layers(MitsubaScene(room), sensor)
    shot = expose(layers, room, sensor, seed=1)
    frame, truth_m = scene.fullest(), scene.truth_m()
    assert frame.ir_left is not None and frame.ir_right is not None and truth_m is not None
    assert frame.depth_m is not None and shot.ir_right is not None
    surface_px = scene.info.disparity_px(shot.layers.truth.depth_m)
    real, simulated = (
        pair_powers(pair, surface_px)
        for pair in ((frame.ir_left, frame.ir_right), (shot.ir_left, shot.ir_right))
    )
    truth_px, device_px, simulated_px = (
        scene.info.disparity_px(depth_m) for depth_m in (truth_m, frame.depth_m, shot.depth.depth_m)
    )
    scored, reached = metrics.scored_pixels(truth_px), metrics.reached_pixels(truth_px)
    spreads = [
        metrics.disparity_figures(px, truth_px, scored).nmad_px for px in (simulated_px, device_px)
    ]
    if options.pictures:
        options.pictures.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(options.pictures / f"{scene.name}.png"), picture(frame.ir_left, shot))
    return [
        *share,
        *(simulated / real),
        float(shot.ir_left.mean() / frame.ir_left.mean()),
        spreads[0] / spreads[1],
        metrics.hole_overlap(simulated_px, device_px, reached),
    ]


def at_fitted_scale(scene: CapturedScene, sensor: Sensor) -> Sensor:
    """Return the sensor with the scene's pattern scale."""
    return fit_scene.apply_to_sensor(sensor, fit_scene.fit_pattern_scale(scene, sensor))


def load_room(
    scene: CapturedScene, sensor: Sensor, smoothing_px: float, *, left_only: bool
) -> Scene:
    """Load the scene that is estimated from the infrared images."""
    return captured_scene.load(
        scene.path, sensor, smoothing_px=smoothing_px, within_surfaces=True, left_only=left_only
    )


def right_correlation(
    scene: CapturedScene, sensor: Sensor, room: Scene, layers: Layers
) -> list[float]:
    """Median and lower quartile of the right image's correlation, as shares of the ceiling's."""
    frame, truth_m = scene.fullest(), scene.truth_m()
    assert frame.ir_left is not None and frame.ir_right is not None and truth_m is not None
    assert layers.right is not None
    usable = heldout.away_from_edges(layers.right.depth_m, sensor)
    high = correlation.high_passed
    ncc = correlation.local_ncc(
        high(frame.ir_right), high(noiseless(layers, room, sensor)["right"]), usable
    )
    truth_px = scene.info.disparity_px(truth_m)
    warped, inside = correlation.right_in_left(frame.ir_right, truth_px)
    ceiling = correlation.local_ncc(
        high(frame.ir_left), high(warped), inside & ~metrics.depth_edges(truth_px)
    )
    return [float(np.quantile(ncc, q) / np.quantile(ceiling, q)) for q in (0.5, 0.25)]


def pair_powers(pair: tuple[Image, Image], surface_px: Image) -> NDArray[np.float64]:
    """Power of the left image by period, and of the pair's difference at the shortest periods.

    The difference holds each imager's own noise, and interpolation, which both pairs share.
    """
    left, right = (np.asarray(image, np.float32) for image in pair)
    warped, inside = correlation.right_in_left(right, surface_px)
    surface = inside & ~metrics.depth_edges(surface_px)
    return np.array([*powers(left, surface), powers(left - warped, surface)[0]])


def powers(image: Image, where: Mask) -> list[float]:
    """Mean power by period, over windows that lie on one surface."""
    window = np.hanning(SIDE_PX + 1)[:-1]
    window = np.outer(window, window)
    across = np.fft.fftfreq(SIDE_PX)
    frequency = np.hypot(across, across[:, None])
    total, count = np.zeros(frequency.shape), 0
    starts = [
        range(begin, size - SIDE_PX + 1, SIDE_PX // 2)
        for begin, size in zip((0, metrics.LEFT_BAND_PX), image.shape, strict=True)
    ]
    for row in starts[0]:
        for column in starts[1]:
            part = (slice(row, row + SIDE_PX), slice(column, column + SIDE_PX))
            if where[part].all():
                values = image[part].astype(np.float64)
                total += np.abs(np.fft.fft2((values - values.mean()) * window)) ** 2
                count += 1
    within = [(frequency * low <= 1) & (frequency * high > 1) for low, high in PERIODS_PX]
    return [float(total[mask].sum() / max(count, 1)) for mask in within]


def picture(real: Image, shot: Shot) -> NDArray[np.uint8]:
    """Draw the real left image, then the simulated one."""
    return np.clip(4.0 * np.hstack([real, shot.ir_left]), 0, 255).astype(np.uint8)


def print_row(name: str, values: Iterable[float]) -> None:
    """Print the figures of a scene."""
    print(f"| {name} | {' | '.join(f'{value:.3f}' for value in values)} |", flush=True)


if __name__ == "__main__":
    main()
