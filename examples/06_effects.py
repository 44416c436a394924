"""Effects: the cost of each departure from an ideal camera.

Starts from an ideal camera, changes one effect of the table at a time, and prints the change of
level, disparity error and holes. The scene is rendered only once where possible.

Usage:
    python examples/06_effects.py
    python examples/06_effects.py lens_blur=1.5 vertical_offset=0.8 laser_speckle=0.3
"""

import sys

import numpy as np

from starling.sim import metrics, simulate
from starling.sim.effects import named, setting
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene import sources
from starling.sim.sensor import presets
from starling.sim.stereo.depth import disparity_from_depth

EFFECTS = ("lens_blur=1.2", "laser_speckle=0.3", "vertical_offset=0.8", "disparity_offset=0.4")


def main(*effects: str) -> None:
    """Print one line for each effect."""
    preset = presets.load("d435")
    scene = sources.load("tabletop", preset)
    sensor, scene = setting.ideal(preset, scene)
    scene = setting.on_scene(scene, {"ambient": 0.1})
    layers = simulate.simulate(MitsubaScene(scene), sensor).layers
    truth = disparity_from_depth(
        layers.truth.depth_m, focal_px=sensor.fx_px, baseline_m=sensor.baseline_m
    )
    print(f"{'effect':24}{'level DN':>10}{'bias px':>10}{'NMAD px':>10}{'holes':>8}")
    for text in ("", *(effects or EFFECTS)):
        settings = setting.parse([text] if text else [])
        camera, lit = setting.apply(sensor, scene, settings)
        if any(named(name.partition(".")[0]).rerender for name in settings):
            shot = simulate.simulate(lit, camera)
        else:
            shot = simulate.expose(layers, lit, camera)
        figures = metrics.disparity_figures(
            shot.depth.disparity_px, truth, metrics.scored_pixels(truth)
        )
        level = 255 * np.mean(shot.ir_left) / camera.left.ceiling_dn
        print(
            f"{text or 'ideal camera':24}{level:10.1f}"
            f"{figures.bias_px:+10.3f}{figures.nmad_px:10.3f}"
            f"{1 - shot.depth.valid.mean():8.1%}"
        )


if __name__ == "__main__":
    main(*sys.argv[1:])
