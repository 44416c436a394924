r"""Compare corrupted depth images with the full simulation, and measure their CPU time.

The full simulation renders a scene; `corrupt` gets its true depth and reflectance, then also depth
seen from the right imager and the projector. Another seed of the full simulation is the ceiling of
each overlap. Depth of `mujoco:overhead` and `mujoco:wrist` is MuJoCo's own; those scenes need the
package `mujoco`.

Usage:
    python benchmarks/simulation/corrupt.py [--scenes tabletop mujoco:wrist] [--size 848 480]
"""

from __future__ import annotations

import argparse
import dataclasses
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import cv2
import mujoco_scenes
import numpy as np
from numpy.typing import NDArray

import starling
from starling import Corruptor, Scene, Sensor, Shot
from starling.sim.geometry.frames import Pose
from starling.sim.render import direct
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.simulate import Quality, simulate

FOV_DEG = 58.2  # Vertical.
MUJOCO = "mujoco:"
SCENES = ["tabletop", "clutter:1", "staircase"]
SCENES += [f"{MUJOCO}{camera}" for camera in mujoco_scenes.CAMERAS]
BAND_PX = 100  # Columns at the left, most of them outside the overlap of both views.
REPEATS = 5
DISPARITIES = 128
MATT_TILT = 2 / 3  # Irradiance of a tilted matt surface below a sky with a gradient.
QUALITIES: tuple[Quality, ...] = ("full", "draft")
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A scene, and depth images of it from poses near the left imager."""

    scene: Scene
    depth_from: Callable[[Pose], NDArray[np.float32]]  # `left_from_place` to (h, w) [m].


def main() -> None:
    """Print a row for each scene."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenes", nargs="+", default=SCENES)
    parser.add_argument("--size", nargs=2, type=int, default=[640, 480], metavar=("W", "H"))
    options = parser.parse_args()
    names = usable(options.scenes)
    width, height = options.size
    matrix = camera_matrix(width, height)
    sensor = starling.load_sensor("d435", camera_matrix=matrix, size=(width, height))
    views = load_views(names, sensor)
    print(
        "| scene | holes, full | holes, corrupt | three images | IoU | three images | other seed "
        "| IoU, x >= 100 | three images | other seed | NMAD, corrupt [px] | full [px] "
        "| light, correlation | CPU [ms] | over SGBM |"
    )
    print(f"|{'---|' * 15}")
    drafts, differences = [], []
    for name, view in views.items():
        scene = view.scene
        full, again = (starling.simulate(scene, sensor, seed=seed) for seed in (1, 2))
        truth_m = full.layers.truth.depth_m
        ambient = max(scene.ambient.irradiance_w_m2, 0.01)
        corruptor = Corruptor(sensor, matrix, effects={"ambient": ambient})
        depth_m = view.depth_from(np.eye(4))
        difference = np.abs(depth_m - truth_m)
        difference = difference[np.isfinite(difference)]
        differences.append(
            f"| {name} | {np.median(difference):.1e} | {np.quantile(difference, 0.99):.1e} |"
        )
        reflected = reflectance(full, scene)
        up = scene.world_from_left[:3, :3].T @ np.asarray(scene.ambient.up)
        shot = corruptor.light(depth_m, reflectance=reflected, up=up).shoot(seed=3)
        exact = corruptor.light(
            depth_m,
            reflectance=reflected,
            up=up,
            right_depth_m=view.depth_from(corruptor.left_from_right),
            projector_depth_m=view.depth_from(corruptor.left_from_projector),
        ).shoot(seed=3)
        known = np.isfinite(truth_m)
        holes = [~each.depth.valid & known for each in (full, shot, exact, again)]
        inside = np.zeros(known.shape, bool)
        inside[:, BAND_PX:] = True
        numbers = (np.arange(REPEATS)).tolist()
        corrupt_ms = cpu_ms(
            lambda n, c=corruptor, d=depth_m, r=reflected: c(d, reflectance=r, frame=n), numbers
        )
        engine = cv2.StereoSGBM.create(
            0, DISPARITIES, 7, 8 * 49, 32 * 49, mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY
        )
        left, right = (np.asarray(image, np.uint8) for image in (shot.ir_left, shot.ir_right))
        sgbm_ms = cpu_ms(lambda _, e=engine, a=left, b=right: e.compute(a, b), numbers)
        cells = [
            name,
            *(f"{each.mean():.3f}" for each in holes[:3]),
            *(f"{iou(each, holes[0]):.3f}" for each in holes[1:]),
            *(f"{iou(each & inside, holes[0] & inside):.3f}" for each in holes[1:]),
            *(f"{nmad_px(each, truth_m, sensor.focal_baseline_px_m):.3f}" for each in (shot, full)),
            f"{correlation(shot, full):.3f}",
            f"{corrupt_ms:.0f}",
            f"{corrupt_ms / sgbm_ms:.1f}",
        ]
        print(f"| {' | '.join(cells)} |", flush=True)
        drafts.append(draft_row(name, scene, sensor, full, iou(holes[-1], holes[0])))
    print(
        "\n| scene | IoU of a draft | other seed | CPU time over the full one |\n|---|---|---|---|"
    )
    print("\n".join(drafts))
    print("\n| scene | depth minus the full simulation's, median [m] | 99 % [m] |\n|---|---|---|")
    print("\n".join(differences))


def usable(names: list[str]) -> list[str]:
    """Return the scenes without those of MuJoCo if it is missing, and print why."""
    lost = [name for name in names if name.startswith(MUJOCO)]
    reason = mujoco_scenes.unavailable() if lost else None
    if reason is None:
        return names
    print(f"skipped {', '.join(lost)}: {reason}")
    return [name for name in names if name not in lost]


def camera_matrix(width: int, height: int) -> NDArray[np.float64]:
    """Return intrinsics (3, 3) of an image with a vertical field of 58.2 degrees [px]."""
    focal = height / 2 / np.tan(np.deg2rad(FOV_DEG) / 2)
    return np.array([[focal, 0, width / 2 - 0.5], [0, focal, height / 2 - 0.5], [0, 0, 1]])


def load_views(names: list[str], sensor: Sensor) -> dict[str, View]:
    """Load scenes by name; those of MuJoCo share one table."""
    views = {}
    table = None
    for name in names:
        if not name.startswith(MUJOCO):
            scene = starling.load_scene(name, sensor)
            views[name] = View(scene, partial(depth_from, scene, sensor))
            continue
        table = table or mujoco_scenes.Table(FOV_DEG)
        camera = name.removeprefix(MUJOCO)
        views[name] = View(table.scene(camera), partial(table.depth_from, camera, sensor))
    return views


def draft_row(name: str, scene: Scene, sensor: Sensor, full: Shot, ceiling: float) -> str:
    """Return a row on `quality="draft"`."""
    mi_scene = MitsubaScene(scene)
    known = np.isfinite(full.layers.truth.depth_m)
    draft = simulate(mi_scene, sensor, seed=2, quality="draft")
    overlap = iou(~draft.depth.valid & known, ~full.depth.valid & known)
    numbers = list(range(REPEATS))
    times = {
        quality: cpu_ms(
            lambda n, q=quality: simulate(mi_scene, sensor, frame=n, quality=q), numbers
        )
        for quality in QUALITIES
    }
    ratio = times["draft"] / times["full"]
    return f"| {name} | {overlap:.3f} | {ceiling:.3f} | {ratio:.2f} |"


def depth_from(scene: Scene, sensor: Sensor, left_from_place: Pose) -> NDArray[np.float32]:
    """Render the depth (h, w) seen from another place [m]."""
    moved = dataclasses.replace(scene, world_from_left=scene.world_from_left @ left_from_place)
    return direct.layers(MitsubaScene(moved), sensor).truth.depth_m


def reflectance(shot: Shot, scene: Scene) -> NDArray[np.float32]:
    """Return the reflectance (h, w) of a rendered scene, from its ambient light."""
    up = scene.world_from_left[:3, :3].T @ np.asarray(scene.ambient.up)
    tilt = shot.layers.truth.normal @ up.astype(np.float32)
    light = 1 + np.float32(scene.ambient.gradient * MATT_TILT) * tilt
    share = np.nan_to_num(shot.layers.left.ambient * np.float32(np.pi) / light, nan=0.5)
    return np.clip(share, 0, 1).astype(np.float32)


def cpu_ms(run: Callable[[int], object], numbers: list[int]) -> float:
    """Return the median CPU time of runs [ms]."""
    times = []
    for number in numbers:
        started = time.process_time()
        run(number)
        times.append(1e3 * (time.process_time() - started))
    return float(np.median(times))


def iou(first: Mask, second: Mask) -> float:
    """Return intersection over union."""
    return float((first & second).sum() / max((first | second).sum(), 1))


def nmad_px(shot: Shot, truth_m: NDArray[np.float32], focal_baseline: float) -> float:
    """Return the spread of disparity errors [px]."""
    error = (focal_baseline / shot.depth.depth_m - focal_baseline / truth_m)[shot.depth.valid]
    error = error[np.isfinite(error)]
    return float(1.4826 * np.median(np.abs(error - np.median(error))))


def correlation(shot: Shot, full: Shot) -> float:
    """Return the correlation of the dots' light in both left images, blurred by the lens."""
    first, second = (
        cv2.GaussianBlur(each.layers.left.projector_direct, (0, 0), 0.6).ravel()
        for each in (shot, full)
    )
    return float(np.corrcoef(first, second)[0, 1])


if __name__ == "__main__":
    main()
