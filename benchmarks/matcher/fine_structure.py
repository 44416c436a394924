"""Bound the averaging of a camera by the power of its images in two high-frequency bands.

Averaging is the last step before quantisation, so it attenuates dots, texture, speckle and noise.
The power of the quantisation noise (1/12 DN^2, white) is subtracted. Each scene gives two bounds.

- `most`: with this averaging, the simulation falls off between the bands as fast as the real
  image. Texture in the real image falls off as well, so averaging is at most this.
- `least`: with this averaging, simulated noise alone has the real power in the finer band.

    python benchmarks/matcher/fine_structure.py $STARLING_CAPTURES/d415-faro --sensor FILE
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy import optimize

from starling.diagnosis.scenes.observation import StereoObservation, expect
from starling.diagnosis.scenes.request import Source, simulation
from starling.diagnosis.scenes.scene_model import SceneModel, load_scene_model
from starling.sim.captures import capture
from starling.sim.sensor import resolve

_TILE_PX = 32
_WINDOW = np.outer(np.hanning(_TILE_PX), np.hanning(_TILE_PX))
_BANDS = ((0.35, 0.44), (0.53, 0.62))  # Radial frequency [cycles per pixel].
_RANGE_PX = (0.3, 1.0)
_ROUNDING = 1 / 12  # Quantisation variance [DN^2].


def main() -> None:
    """Print both bounds of each scene and of each half of the rooms."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("captures", type=Path)
    parser.add_argument("--sensor", required=True, help="preset or sensor file")
    options = parser.parse_args()
    captures = capture.open_set(options.captures)
    sensor = resolve.load(options.sensor, captures=str(captures.path))
    rooms = list(dict.fromkeys(scene.room for scene in captures.scenes))
    bounds = []
    for scene in captures.scenes:
        model = load_scene_model(scene, sensor)
        real = _powers(expect(model.real, StereoObservation).left[0]) - _ROUNDING
        most = _root(lambda px, model=model, real=real: _fall(_simulated(model, px)) - _fall(real))
        least = _root(lambda px, model=model, real=real: _noise(model, px)[1] - real[1])
        bounds.append((rooms.index(scene.room) % 2, least, most))
        has_px = sensor.left.smoothing_px
        powers = {
            "real": real,
            "simulated": _simulated(model, has_px),
            "noise": _noise(model, has_px),
        }
        text = ", ".join(f"{name} {power[0]:.3f} {power[1]:.4f}" for name, power in powers.items())
        print(f"{scene.name:6} {text} DN^2; least {least:.3f}, most {most:.3f} px", flush=True)
    for half in (0, 1):
        least, most = np.array([row[1:] for row in bounds if row[0] == half]).T
        print(
            f"rooms {', '.join(rooms[half::2])}: at least {np.nanmax(least):.3f} px, "
            f"at most {np.nanmin(most):.3f} px (medians {np.nanmedian(least):.3f}, "
            f"{np.nanmedian(most):.3f})"
        )


def _simulated(model: SceneModel, smoothing_px: float) -> np.ndarray:
    left = _left(model, smoothing_px)
    return _powers(left[0]) - _ROUNDING


def _left(model: SceneModel, smoothing_px: float) -> np.ndarray:
    request = simulation(Source.INFRARED, {"smoothing": smoothing_px}, seed=1)
    return expect(model.observe(request), StereoObservation).left


def _noise(model: SceneModel, smoothing_px: float) -> np.ndarray:
    left = _left(dataclasses.replace(model, frames=2), smoothing_px)
    return _powers(left[0].astype(float) - left[1]) / 2 - _ROUNDING


def _powers(image: np.ndarray) -> np.ndarray:
    """Return the power of each band, as the variance per pixel of white noise [DN^2]."""
    step = _TILE_PX // 2
    tiles = sliding_window_view(image.astype(float), (_TILE_PX, _TILE_PX))[::step, ::step]
    tiles = tiles.reshape(-1, _TILE_PX, _TILE_PX)
    tiles = (tiles - tiles.mean((1, 2), keepdims=True)) * _WINDOW
    power = (np.abs(np.fft.fft2(tiles)) ** 2).mean(0) / (_WINDOW**2).sum()
    down = np.fft.fftfreq(_TILE_PX)
    radius = np.hypot(down[:, None], down[None, :])
    return np.array([power[(radius >= low) & (radius < high)].mean() for low, high in _BANDS])


def _fall(powers: Sequence[float] | np.ndarray) -> float:
    return float(np.log(max(powers[1], 1e-6) / max(powers[0], 1e-6)))


def _root(function: Callable[[float], float]) -> float:
    """Return the root of a function that decreases with averaging; NaN without a root."""
    ends = [function(px) for px in _RANGE_PX]
    if not ends[0] > 0 > ends[1]:
        return float("nan")
    return float(optimize.root_scalar(function, bracket=_RANGE_PX, xtol=0.005).root)


if __name__ == "__main__":
    main()
