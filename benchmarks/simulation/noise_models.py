r"""Compare common noise models of depth with `simulate`, `corrupt` and a real D415.

Models are fitted in five rooms and scored in the others. Each gets the scanner's surface, as
`simulate` renders it. Captures: `d415-faro` in the folder $STARLING_CAPTURES.

Usage:
    python benchmarks/simulation/noise_models.py [--scenes 0060 5881 ...]

Metrics, of pixels whose truth is known: IoU and F1 of the pixels without depth; their boundary IoU
(Cheng et al. 2021, CVPR) with a boundary of 2 px; flying pixels; spread and correlation of noise
after a local mean; flicker, the share of pixels with depth in one of two frames.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial

import corrupt_d415
import cv2
import numpy as np
from noise_rules import Image, Surface, edges, edges_and_shadow, gaussian, handa, nguyen
from numpy.typing import NDArray

from starling.diagnosis.which.makes import SAPIEN
from starling.sim.metrics import MAD_TO_SIGMA, depth_edges, reached_pixels, scored_pixels

FITTED_ROOMS = frozenset({"0060", "1982", "4426", "6422", "g"})  # Those of match_faro.py.
COLUMNS = {
    "holes": 3,
    "IoU": 3,
    "F1": 3,
    "boundary IoU": 3,
    "flying pixels [%]": 2,
    "noise [px]": 3,
    "correlation, 1 px": 2,
    "8 px": 2,
    "flicker [%]": 2,
    "noise between frames [px]": 3,
}
BOUNDARY_PX = 2
MEAN_PX = 31  # Window of the local mean that noise is measured against.
NEAR_PX, APART_PX, OFF_PX = 5, 4.0, 1.0  # Flying pixels: reach, step of surfaces, least distance.
LATERAL_PX = (0.25, 0.5, 1.0, 2.0, 3.0, 4.0)
STEEPEST_DEG = (70.0, 75.0, 80.0, 84.0, 87.0)
RULES = tuple(itertools.product((1, 2, 3, 4, 6), (1.0, 2.0, 4.0, 8.0), (0.5, 0.75, 1.0)))
Model = Callable[[Surface, np.random.Generator], Image]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Case:
    """One scene: truth, the device's reading, and its surface."""

    fitted: bool
    truth_px: Image
    device_px: Image
    surface: Surface
    readings: dict[str, list[Image]] = field(default_factory=dict)  # Two frames of each model.


def main() -> None:
    """Fit the models, and print a row for each."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenes", nargs="*", default=[], help="all scenes if none")
    cases = [load(room) for room in corrupt_d415.rooms(parser.parse_args().scenes)]
    models, notes = fit([case for case in cases if case.fitted])
    held_out = [case for case in cases if not case.fitted]
    print("\n".join(notes))
    print(f"{len(cases) - len(held_out)} scenes fitted, medians over {len(held_out)} others\n")
    print(f"| depth | {' | '.join(COLUMNS)} |\n|{'---|' * (1 + len(COLUMNS))}")
    print_row("D415", [figures(case, [case.device_px]) for case in held_out])
    for name in held_out[0].readings:
        print_row(name, [figures(case, case.readings[name]) for case in held_out])
    for name, model in models.items():
        print_row(name, [figures(case, frames(model, case)) for case in held_out])


def load(room: corrupt_d415.Room) -> Case:
    """Render one scene, and read it twice by each simulation."""
    simulation, sensor = corrupt_d415.Models(room), room.sensor
    depth_m = simulation.layers.truth.depth_m
    sapien = dataclasses.replace(sensor, matcher=SAPIEN)
    readings = {
        "simulate": [simulation.simulated(sensor, frame) for frame in (0, 1)],
        "corrupt": [simulation.corrupted(depth_m, frame) for frame in (0, 1)],
        "SAPIEN's matcher": [simulation.simulated(sapien, frame) for frame in (0, 1)],
    }
    return Case(
        fitted=room.scene.room in FITTED_ROOMS,
        truth_px=room.truth_px,
        device_px=room.device_px,
        surface=Surface.from_depth(depth_m, room.scene.info),
        readings=readings,
    )


def frames(model: Model, case: Case) -> list[Image]:
    """Return two frames of a noise model."""
    return [model(case.surface, np.random.default_rng(seed)) for seed in (1, 2)]


def fit(cases: list[Case]) -> tuple[dict[str, Model], list[str]]:
    """Fit each model: noise and flying pixels as the device's, rules of holes by IoU."""
    target_px = median(noise(case.device_px, case)[0] for case in cases)
    still_px = median(noise(case.surface.disparity_px, case)[0] for case in cases)
    white_px = float(np.sqrt(max(target_px**2 - still_px**2, 0)))
    share = median(1 - np.isfinite(case.device_px)[counted(case)].mean() for case in cases)
    flying = median(flying_share(case.device_px, case) for case in cases)

    def flies(model: Model) -> float:
        rate = median(flying_share(frames(model, case)[0], case) for case in cases)
        return abs(rate - flying)

    def overlap(model: Model) -> float:
        return float(np.mean([hole_figures(frames(model, case)[0], case)[1] for case in cases]))

    handa_px = min(LATERAL_PX, key=lambda s: flies(partial(handa, noise_px=white_px, lateral_px=s)))
    unit = partial(nguyen, axial=1.0, lateral=0.0, steepest_deg=90.0)
    spread = median(noise(frames(unit, case)[0], case)[0] for case in cases)
    axial = white_px / max(float(np.sqrt(max(spread**2 - still_px**2, 0))), 1e-6)
    tilted = partial(nguyen, axial=axial)
    lateral = min(LATERAL_PX, key=lambda s: flies(partial(tilted, lateral=s, steepest_deg=90.0)))
    angle = max(
        STEEPEST_DEG, key=lambda a: overlap(partial(tilted, lateral=lateral, steepest_deg=a))
    )
    rules = {}
    for name, rule in (("edges", edges), ("edges and shadow", edges_and_shadow)):
        reach, jump, part = max(
            RULES,
            key=lambda values, rule=rule: overlap(
                partial(rule, noise_px=0.0, reach_px=values[0], jump_px=values[1], share=values[2])
            ),
        )
        rules[name] = {"reach_px": reach, "jump_px": jump, "share": part}
    notes = [
        f"noise {white_px:.3f} px, holes {share:.3f}, Handa lateral {handa_px} px, "
        f"Nguyen axial x {axial:.2f}, lateral x {lateral}, steepest {angle:g} deg",
        *(f"{name}: {values}" for name, values in rules.items()),
    ]
    models: dict[str, Model] = {
        "Gaussian z^2, random holes": partial(gaussian, noise_px=white_px, share=share),
        "Handa et al. 2014": partial(handa, noise_px=white_px, lateral_px=handa_px),
        "Nguyen et al. 2012": partial(tilted, lateral=lateral, steepest_deg=angle),
        "edge dropout": partial(edges, noise_px=white_px, **rules["edges"]),
        "edge dropout, stereo shadow": partial(
            edges_and_shadow, noise_px=white_px, **rules["edges and shadow"]
        ),
    }
    return models, notes


def figures(case: Case, images: list[Image]) -> list[float]:
    """Return the metrics of one or two frames, in the order of `COLUMNS`."""
    first = images[0]
    temporal = [float("nan")] * 2
    if len(images) == 2:
        where = counted(case)
        flicker = np.isfinite(images[0])[where] != np.isfinite(images[1])[where]
        change = (images[0] - images[1])[where]
        change = change[np.isfinite(change)]
        temporal = [100 * float(flicker.mean()), nmad(change) / np.sqrt(2)]
    flying_pct = 100 * flying_share(first, case)
    return [*hole_figures(first, case), flying_pct, *noise(first, case), *temporal]


def counted(case: Case) -> Mask:
    """Pixels (h, w) whose truth is known, right of the left band."""
    return reached_pixels(case.truth_px)


def hole_figures(image: Image, case: Case) -> list[float]:
    """Return the share of holes, and IoU, F1 and boundary IoU with the device's."""
    where = counted(case)
    ours, device = (~np.isfinite(each) & where for each in (image, case.device_px))
    common = int((ours & device).sum())
    f1 = 2 * common / max(int(ours.sum() + device.sum()), 1)
    rims = [mask & ~eroded(mask) for mask in (ours, device)]
    return [float(ours[where].mean()), iou(ours, device), f1, iou(*rims)]


def eroded(mask: Mask) -> Mask:
    """Mask (h, w) without its boundary."""
    side = 2 * BOUNDARY_PX + 1
    return cv2.erode(mask.astype(np.uint8), np.ones((side, side), np.uint8)).astype(bool)


def iou(first: Mask, second: Mask) -> float:
    """Return intersection over union."""
    return float((first & second).sum() / max((first | second).sum(), 1))


def flying_share(image: Image, case: Case) -> float:
    """Share of measured pixels near a depth step that lie between both surfaces."""
    side = 2 * NEAR_PX + 1
    kernel, known = np.ones((side, side), np.uint8), np.isfinite(case.truth_px)
    low = cv2.erode(np.where(known, case.truth_px, 1e6).astype(np.float32), kernel)
    high = cv2.dilate(np.where(known, case.truth_px, -1e6).astype(np.float32), kernel)
    near = counted(case) & (high - low > APART_PX) & np.isfinite(image)
    between = (image > low + OFF_PX) & (image < high - OFF_PX)
    # A surface between both, or a slope, is no flying pixel.
    off = np.abs(image - case.truth_px) > OFF_PX
    return float((near & between & off).sum() / max(near.sum(), 1))


def noise(image: Image, case: Case) -> list[float]:
    """Return the spread of noise [px], and its correlation over 1 and 8 columns."""
    error = image - case.truth_px
    good = scored_pixels(case.truth_px) & np.isfinite(error) & (np.abs(error) < 2 * OFF_PX)
    good &= ~depth_edges(case.surface.disparity_px)
    side, weight = (MEAN_PX, MEAN_PX), good.astype(np.float32)
    mean = cv2.blur(np.where(good, error, 0).astype(np.float32), side)
    rest = np.where(good, error - mean / np.maximum(cv2.blur(weight, side), 1e-6), np.nan)
    values = [nmad(rest[good])]
    for step in (1, 8):
        pair = np.stack([rest[:, :-step].ravel(), rest[:, step:].ravel()])
        values.append(float(np.corrcoef(pair[:, np.isfinite(pair).all(0)])[0, 1]))
    return values


def nmad(values: NDArray[np.floating]) -> float:
    """Return the normalised median absolute deviation."""
    return float(MAD_TO_SIGMA * np.median(np.abs(values - np.median(values))))


def median(values: Iterable[float]) -> float:
    """Return the median of figures of scenes."""
    return float(np.median(list(values)))


def print_row(name: str, rows: list[list[float]]) -> None:
    """Print medians over scenes."""
    values = np.median(rows, axis=0)
    cells = [
        "" if np.isnan(value) else f"{value:.{digits}f}"
        for value, digits in zip(values, COLUMNS.values(), strict=True)
    ]
    print(f"| {name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
