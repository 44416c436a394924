"""A pose estimate that works on clean depth and fails on a real camera's: ICP of a thin bracket.

The same alignment runs on the ground truth and on the depth of a simulated D435. Prongs of four
pixels merge with what is behind them, so it turns the bracket.

Usage:
    python examples/11_pose_from_depth.py
"""

import numpy as np
import trimesh

import starling
from starling.sim.geometry import frames
from starling.sim.scene.builtin import solids
from starling.sim.scene.scene import Material, Scene

LEFT_FROM_PART = frames.pose((0.03, -0.02, 0.62), (35, 20, 10))
GUESS = LEFT_FROM_PART @ frames.pose((0.005, -0.004, 0.005), (3, -4, 2))


def bracket() -> trimesh.Trimesh:
    """A plate with four prongs of 5 mm."""
    plate = trimesh.creation.box((0.12, 0.03, 0.006))
    prongs = [trimesh.creation.box((0.005, 0.07, 0.006)) for _ in range(4)]
    for place, prong in zip((-0.05, -0.02, 0.01, 0.05), prongs, strict=True):
        prong.apply_translation((place, 0.045, 0))
    return solids.join([plate, *prongs])


def pose_error(depth_m: np.ndarray, on_part: np.ndarray, sensor: starling.Sensor) -> str:
    """Align the model to the depth on the part, and describe the error."""
    rows, columns = np.nonzero(on_part & np.isfinite(depth_m))
    z = depth_m[rows, columns]
    x = (columns - sensor.cx_px) / sensor.fx_px * z
    y = (rows - sensor.cy_px) / sensor.fy_px * z
    points = np.stack([x, y, z], axis=1)
    model = trimesh.sample.sample_surface(bracket().apply_transform(GUESS), 50_000, seed=0)[0]
    options = {"threshold": 1e-12, "max_iterations": 300, "scale": False, "reflection": False}
    part_from_left, *_ = trimesh.registration.icp(points, model, **options)
    error = np.linalg.inv(LEFT_FROM_PART) @ np.linalg.inv(part_from_left) @ GUESS
    turn = np.rad2deg(np.arccos(np.clip((np.trace(error[:3, :3]) - 1) / 2, -1, 1)))
    return f"{1e3 * np.linalg.norm(error[:3, 3]):.1f} mm, {turn:.1f} degrees"


def main() -> None:
    """Print the errors on clean and on simulated depth."""
    paint = Material(name="paint", reflectance=0.5)
    part = solids.body("bracket", bracket(), paint, LEFT_FROM_PART)
    table = solids.body("table", solids.plane(2, 2), paint, frames.pose((0, 0, 0.72), (8, 0, 0)))
    sensor = starling.load_sensor("d435")
    shot = starling.simulate(Scene(name="bracket", bodies=(table, part)), sensor)
    on_part = shot.layers.truth.material == 2
    print("clean depth:", pose_error(shot.layers.truth.depth_m, on_part, sensor))
    print("D435:       ", pose_error(shot.depth.depth_m, on_part, sensor))


if __name__ == "__main__":
    main()
