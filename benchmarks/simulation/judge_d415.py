r"""Judge common noise models, SAPIEN's matcher, our matcher and the preset against a real D415.

Rows: noise on the scanner's surface, SAPIEN's matcher on simulated images, our matcher on the real
images, and simulated captures. Parameters of noise were fitted in five rooms (`noise_models.py`).
With `--nuisances`, known changes of the real depth instead: they state what the judge notices.
With `--judges`, several judges learn, each by other groups of rooms; the area is that of their mean
score. *Single* is the mean area of one judge, with its deviation over judges.
Captures: `d415-faro` in the folder $STARLING_CAPTURES.

Usage:
    starling simulate $STARLING_CAPTURES/d415-faro --sensor d415 --out OUT/preset
    python benchmarks/simulation/judge_d415.py preset=OUT/preset [NAME=FOLDER ...]
    python benchmarks/simulation/judge_d415.py preset=OUT/preset --rows preset --judges 5
    python benchmarks/simulation/judge_d415.py preset=OUT/preset --nuisances
    python benchmarks/simulation/judge_d415.py preset=OUT/preset --null OUT/seed-1
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
import zlib
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from noise_models import FITTED_ROOMS
from noise_rules import QUANTUM_PX, Image, Surface, edges, edges_and_shadow, gaussian, handa, nguyen
from numpy.typing import NDArray
from torch import Tensor

from starling.diagnosis.which.makes import SAPIEN
from starling.learning.judge.figures import interval, pooled_auc
from starling.learning.judge.judge import Judgement, judge, room_scores
from starling.learning.judge.samples import pair, read
from starling.sim.captures import capture, png, writer
from starling.sim.captures import info as capture_info
from starling.sim.captures.capture import CapturedScene, CaptureSet
from starling.sim.console.output import OutputFolder
from starling.sim.sensor import resolve
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import depth_from_disparity, to_code
from starling.sim.stereo.measurement import measure

NOISE_PX = 0.116  # Noise, and parameters below: docs/results/corrupt.md, fitted in five rooms.
NOISES_PX = (0.02, 0.05, 0.1)
PINHOLES_PCT = (0.05, 0.1, 0.5)
SMOOTHING_PX = 1.0
Cells = dict[str, Tensor]  # Statistics by scene.
Row = Callable[[CapturedScene, CapturedScene], Image]  # Real and preset's scene to disparity [px].


def noise_model(
    real: CapturedScene,
    sim: CapturedScene,
    *,
    model: Callable[[Surface, np.random.Generator], Image],
) -> Image:
    """Return the disparity (h, w) [px] of a noise model on the rendered surface."""
    truth_m = sim.truth_m()
    assert truth_m is not None  # Simulated captures have it.
    return model(Surface.from_depth(truth_m, real.info), random(real.name))


def random_holes(surface: Surface, rng: np.random.Generator, *, device: CapturedScene) -> Image:
    """Return even disparity noise and holes of the device's share."""
    share = float(np.isnan(depth_of(device))[:, 128:].mean())
    return gaussian(surface, rng, noise_px=NOISE_PX, share=share)


MODELS: dict[str, Callable[[Surface, np.random.Generator], Image]] = {
    "Handa et al. 2014": partial(handa, noise_px=NOISE_PX, lateral_px=3.0),
    "Nguyen et al. 2012": partial(nguyen, axial=1.28, lateral=4.0, steepest_deg=87.0),
    "edge dropout": partial(edges, noise_px=NOISE_PX, reach_px=4, jump_px=4.0, share=1.0),
    "edge dropout, stereo shadow": partial(
        edges_and_shadow, noise_px=NOISE_PX, reach_px=1, jump_px=4.0, share=1.0
    ),
}


def matched(real: CapturedScene, sim: CapturedScene, *, sensor: Sensor, simulated: bool) -> Image:
    """Return the disparity (h, w) [px] that a sensor's matcher and filters make of a pair."""
    scene = sim if simulated else real
    frame = scene.frame(scene.frames[0])
    assert frame.ir_left is not None  # `d415-faro` has pairs.
    depth = measure(frame.ir_left, frame.ir_right, sensor, causes={})
    return scene.info.disparity_px(depth.depth_m)


def noisy(real: CapturedScene, sim: CapturedScene, *, sigma_px: float) -> Image:
    """Return the device's disparity with Gaussian noise in the device's steps."""
    del sim
    disparity_px = real.info.disparity_px(depth_of(real))
    return changed(disparity_px, sigma_px * random(real.name).standard_normal(disparity_px.shape))


def changed(disparity_px: Image, change_px: NDArray[np.floating]) -> Image:
    """Add a change in whole steps, so that the steps themselves give nothing away."""
    return (disparity_px + np.rint(change_px / QUANTUM_PX) * QUANTUM_PX).astype(np.float32)


def pinholed(real: CapturedScene, sim: CapturedScene, *, percent: float) -> Image:
    """Return the device's disparity with holes of one pixel."""
    del sim
    disparity_px = real.info.disparity_px(depth_of(real))
    disparity_px[random(real.name).random(disparity_px.shape) < percent / 100] = np.nan
    return disparity_px


def smoothed(real: CapturedScene, sim: CapturedScene) -> Image:
    """Return the device's disparity after a Gaussian mean over known pixels."""
    del sim
    disparity_px = real.info.disparity_px(depth_of(real))
    known = np.isfinite(disparity_px)
    weight = cv2.GaussianBlur(known.astype(np.float32), (0, 0), SMOOTHING_PX)
    mean = cv2.GaussianBlur(np.nan_to_num(disparity_px), (0, 0), SMOOTHING_PX)
    return changed(disparity_px, mean / np.maximum(weight, 1e-6) - disparity_px)


def random(scene: str) -> np.random.Generator:
    """Return the random numbers of a scene."""
    return np.random.default_rng(zlib.crc32(scene.encode()))


def depth_of(scene: CapturedScene) -> Image:
    """Read the depth (h, w) [m] of the first frame."""
    depth_m = scene.frame(scene.frames[0]).depth_m
    assert depth_m is not None  # `d415-faro` has it.
    return depth_m


def cells_of(kind: str, captures: CaptureSet) -> Cells:
    """Compute the statistics of all scenes."""
    return {scene.name: read(kind, scene) for scene in captures.scenes}


def write(row: Row, real: CaptureSet, sim: CaptureSet, out: Path) -> CaptureSet:
    """Write the disparity of a row as a capture set with the depth of a device's files."""
    simulated = {scene.name: scene for scene in sim.scenes}
    with OutputFolder(out) as folder:
        folder.write(capture_info.FILE, capture_info.dumps(real.info))
        for scene in real.scenes:
            disparity_px = row(scene, simulated[scene.name])
            depth_m = depth_from_disparity(
                disparity_px, focal_px=real.info.fx_px, baseline_m=real.info.baseline_m
            )
            code = to_code(depth_m, real.info.depth_unit_m)
            unit_m = real.info.depth_unit_m
            writer.write_scene(
                folder, scene.name, room=scene.room, truth_m=None, depth_unit_m=unit_m
            )
            folder.write(f"{scene.name}/0/depth.png", png.encode(code))
    return capture.open_set(out)


def cell(kind: str, first: CaptureSet, known: Cells, second: CaptureSet, judges: int) -> str:
    """Judge two sets and format the area, its interval, that of other rooms, and of one judge."""
    start_s = time.process_time()
    scenes = {scene.name: scene for scene in second.scenes}
    pairs = [
        pair(scene, known[scene.name], scenes[scene.name], read(kind, scenes[scene.name]))
        for scene in first.scenes
    ]
    text = areas(judge(pairs, judges=judges))
    return f"{text} | {time.process_time() - start_s:.0f}"


def areas(judged: Judgement) -> str:
    """Format the area, its interval, that of other rooms, and of one judge."""
    rooms = room_scores(judged.scenes)
    low, high = interval(rooms, 0)
    others = [room for room in rooms if room.room not in FITTED_ROOMS]
    text = f"{pooled_auc(rooms):.3f} [{low:.3f}, {high:.3f}] | {pooled_auc(others):.3f}"
    text += f" | {np.mean(judged.areas):.3f}"
    return text + (f" +- {np.std(judged.areas, ddof=1):.3f}" if len(judged.areas) > 1 else "")


def open_real() -> CaptureSet:
    """Open the captures of the real D415."""
    path = Path(os.environ.get("STARLING_CAPTURES", "")) / "d415-faro"
    if not path.is_dir():
        raise SystemExit(f"no captures at {path}; set STARLING_CAPTURES to their folder")
    return capture.open_set(path)


def open_named(texts: list[str]) -> dict[str, CaptureSet]:
    """Open the sets that are given as NAME=FOLDER, by name."""
    parts = (text.partition("=") for text in texts)
    return {name: capture.open_set(folder) for name, _, folder in parts}


def nuisances(kind: str) -> dict[str, Row]:
    """Return the known changes that a kind can show, by name."""
    if kind == "holes":
        return {f"pinholes, {part} %": partial(pinholed, percent=part) for part in PINHOLES_PCT}
    noises = {f"noise of {px} px": partial(noisy, sigma_px=px) for px in NOISES_PX}
    return {**noises, f"smoothing by {SMOOTHING_PX:g} px": smoothed}


def models(real: CaptureSet) -> dict[str, Row]:
    """Return the models by name."""
    preset = resolve.load("d415", captures=str(real.path))

    def with_random_holes(device: CapturedScene, sim: CapturedScene) -> Image:
        return noise_model(device, sim, model=partial(random_holes, device=device))

    return {
        "Gaussian z^2, random holes": with_random_holes,
        **{name: partial(noise_model, model=model) for name, model in MODELS.items()},
        "SAPIEN's matcher on simulated images": partial(
            matched, sensor=replace(preset, matcher=SAPIEN), simulated=True
        ),
        "our matcher on the real images": partial(matched, sensor=preset, simulated=False),
    }


def main() -> None:
    """Print a row for each model."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("sets", nargs="+", metavar="NAME=FOLDER", help="simulated, preset first")
    parser.add_argument("--nuisances", action="store_true")
    parser.add_argument("--null", type=Path, help="the preset with another seed")
    parser.add_argument("--kinds", nargs="+", default=["holes", "depth"])
    parser.add_argument("--rows", nargs="*", help="all if none")
    parser.add_argument("--judges", type=int, default=1)
    options = parser.parse_args()
    real, simulated = open_real(), open_named(options.sets)
    preset = next(iter(simulated.values()))
    show = partial(report, judges=options.judges)
    print(
        "| depth | seen | AUC | other rooms | single | CPU [s] |\n" + "|---" * 6 + "|", flush=True
    )
    with tempfile.TemporaryDirectory() as temporary:
        for kind in options.kinds:
            if options.null:
                second = capture.open_set(options.null)
                show("two seeds", kind, preset, cells_of(kind, preset), second)
                continue
            known = cells_of(kind, real)
            rows = nuisances(kind) if options.nuisances else models(real)
            for number, (name, row) in enumerate(rows.items()):
                if name not in (options.rows or rows):
                    continue
                out = Path(temporary) / f"{kind if options.nuisances else 'model'}-{number}"
                second = capture.open_set(out) if out.exists() else write(row, real, preset, out)
                show(name, kind, real, known, second)
            for name, captures in ({} if options.nuisances else simulated).items():
                if name not in (options.rows or simulated):
                    continue
                show(name, kind, real, known, captures)


def report(
    name: str, kind: str, first: CaptureSet, known: Cells, second: CaptureSet, *, judges: int
) -> None:
    """Print one row."""
    print(f"| {name} | {kind} | {cell(kind, first, known, second, judges)} |", flush=True)


if __name__ == "__main__":
    main()
