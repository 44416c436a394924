"""Do objects align as badly in a method's depth as in a real D415's? After a paper's Table I.

Sweeney, Izatt and Tedrake, ICRA 2019. Objects are cut from the scanner's surface, their poses
disturbed, and aligned by ICP in the depth image of each method and in the real one. A method's
depth image is the reference with the holes that it draws; where it builds on physics, with the
simulator's own errors too. Probabilities come from an evaluation by room, so no method has learnt
from the room it is tried in.

    STARLING_CAPTURES=... starling evaluate ... --out EVALUATION
    STARLING_CAPTURES=... python benchmarks/ndp_icp.py EVALUATION --sensor TEMPLATE
"""

from pathlib import Path

import ndp_faro

from learning import registry, sampling
from learning.evaluate_captures import FOLDS, read_told
from learning.icp import comparison, objects, study
from learning.icp.alignment import Disturbance
from sim import progress
from sim.simulate_captures import scene_seed

PUBLISHED = {  # Sweeney et al. 2019, Table I [percent].
    "perfect": (3.90, 18.4, 77.8, 49.8),
    "simple": (3.60, 18.0, 77.2, 49.7),
    "network": (3.60, 6.90, 3.74, 0.10),
    "pix2pix": (187, 179, 53.8, 99.3),
    "cyclegan": (62.3, 196, 227, 95.8),
}
DISTURBANCES = ((0.03, 15.0), (0.08, 40.0))  # [m], [deg]


def main() -> None:
    """Print a table for each disturbance."""
    parser = ndp_faro.parser(__doc__)
    parser.add_argument("evaluation", type=Path)
    parser.add_argument("--captures", type=Path, help="d415-faro if not given")
    parser.add_argument("--trials", type=int, default=50)
    parser.add_argument(
        "--most", type=float, nargs=2, action="append", help="disturbance [m] and [deg]"
    )
    asked = parser.parse_args()
    path = asked.captures or ndp_faro.captures()
    shown = {}
    with progress.on_stderr() as tell:
        for scene, example in ndp_faro.scenes(asked, path, tell):
            pieces = objects.in_room(
                example.depth_m, example.info, scene=scene.name, room=scene.room
            )
            if pieces:
                folder = asked.evaluation / FOLDS / scene.room
                depths = _depths(scene, example, folder)
                shown[scene.name] = (example, pieces, depths)
        for move_m, turn_deg in asked.most or DISTURBANCES:
            outcomes = study.pool(
                [
                    study.align(
                        pieces,
                        example.depth_m,
                        depths,
                        example.info,
                        disturbance=Disturbance(most_m=move_m, most_deg=turn_deg),
                        trials=asked.trials,
                        seed=0,
                    )
                    for example, pieces, depths in tell(list(shown.values()), "align")
                ]
            )
            _table(outcomes, move_m, turn_deg)


def _depths(scene, example, folder):
    """Depth images [m] by method, the device's among them."""
    found = {study.REAL: scene.frame(scene.frames[0]).depth_m}
    error_px = example.simulated_error_px
    for method in sorted(path.name for path in folder.iterdir()):
        probability = read_told(folder / method / f"{scene.name}.png")
        ndp = sampling.ndp(probability, sampling.TYPICAL, seed=scene_seed(0, scene.name))
        for name, error in ((method, None), (f"{method}, with noise", error_px)):
            if error is None or method in registry.ON_PHYSICS:
                found[name] = sampling.depth_image(
                    example.depth_m, ndp, example.info, error_px=error
                )
    return found


def _table(outcomes, move_m, turn_deg):
    real = outcomes[study.REAL]
    print(f"\nfirst guesses off by up to {1e3 * move_m:g} mm and {turn_deg:g} deg; difference [%]")
    print(f"{'':34}{'position: mean, variance':>26}{'rotation: mean, variance':>26}{'objects':>9}")
    for name, outcome in outcomes.items():
        if name == study.REAL:
            continue
        one = comparison.against_real(outcome, real)
        cells = "".join(f"{value:13.1f}" for value in one.difference)
        published = PUBLISHED.get(name)
        beside = f"  published {published}" if published else ""
        print(f"{name:34}{cells}{one.objects:9}  {one.trials} trials{beside}")
    best = "hybrid, with noise"
    if best in outcomes:
        for other in ("perfect", "simple", "network", "physics, with noise"):
            if other in outcomes:
                gain = comparison.nearer(outcomes[best], outcomes[other], real, seed=0)
                spans = "  ".join(
                    f"{low:.1f} to {high:.1f}"
                    for low, high in zip(gain.low, gain.high, strict=True)
                )
                print(f"{best} nearer than {other} by [points, 95 %]: {spans}", flush=True)


if __name__ == "__main__":
    main()
