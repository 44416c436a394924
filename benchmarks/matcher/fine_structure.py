"""How far a camera averages its codes, by how fast the finest structures of its images fall off.

Averaging comes last but for rounding: dots, texture, speckle and noise all pass it. Power of whole
codes (1/12 DN^2, white) is taken off, by bands of radial frequency. Two bounds follow for each
scene. What is in an image falls off towards finer structures by itself as well, so averaging is at
most what makes simulated dots, speckle and noise fall as fast from one of the two bands to the
other (`most`). And simulated noise alone may not be above all there is in the finer one (`least`).

Usage: python benchmarks/matcher/fine_structure.py $STARLING_CAPTURES/d415-faro --sensor my-d415.toml
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy import optimize

from starling.diagnosis.scenes.scene_model import Subject, subject
from starling.sim.captures import capture
from starling.sim.sensor import resolve

_TILE_PX = 32
_WINDOW = np.outer(np.hanning(_TILE_PX), np.hanning(_TILE_PX))
_BANDS = ((0.35, 0.44), (0.53, 0.62))  # Cycles per pixel, along any direction.
_RANGE_PX = (0.3, 1.0)
_ROUNDING = 1 / 12  # Variance of the noise of whole codes [DN^2].


def main() -> None:
    """Print both bounds of each scene, and what the two halves of the rooms say."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("captures", type=Path)
    parser.add_argument("--sensor", required=True, help="preset or sensor file")
    asked = parser.parse_args()
    captures = capture.open_set(asked.captures)
    sensor = resolve.load(asked.sensor, captures=str(captures.path))
    rooms = list(dict.fromkeys(scene.room for scene in captures.scenes))
    found = []
    for scene in captures.scenes:
        of = subject(scene, sensor)
        assert of.real.left is not None
        real = _powers(of.real.left[0]) - _ROUNDING
        most = _root(lambda px, of=of, real=real: _fall(_simulated(of, px)) - _fall(real))
        least = _root(lambda px, of=of, real=real: _noise(of, px)[1] - real[1])
        found.append((rooms.index(scene.room) % 2, least, most))
        has_px = sensor.left.smoothing_px
        powers = {"real": real, "simulated": _simulated(of, has_px), "noise": _noise(of, has_px)}
        told = ", ".join(f"{name} {one[0]:.3f} {one[1]:.4f}" for name, one in powers.items())
        print(f"{scene.name:6} {told} DN^2; least {least:.3f}, most {most:.3f} px", flush=True)
    for half in (0, 1):
        least, most = np.array([row[1:] for row in found if row[0] == half]).T
        print(
            f"rooms {', '.join(rooms[half::2])}: at least {np.nanmax(least):.3f} px, "
            f"at most {np.nanmin(most):.3f} px (medians {np.nanmedian(least):.3f}, "
            f"{np.nanmedian(most):.3f})"
        )


def _simulated(of: Subject, smoothing_px: float) -> np.ndarray:
    left = of.simulate({"smoothing": smoothing_px}, seed=1).left
    assert left is not None
    return _powers(left[0]) - _ROUNDING


def _noise(of: Subject, smoothing_px: float) -> np.ndarray:
    left = dataclasses.replace(of, frames=2).simulate({"smoothing": smoothing_px}, seed=1).left
    assert left is not None
    return _powers(left[0].astype(float) - left[1]) / 2 - _ROUNDING


def _powers(image: np.ndarray) -> np.ndarray:
    """Variance per pixel [DN^2] that white noise of the two bands' power would have."""
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


def _root(of: Callable[[float], float]) -> float:
    """Where a function that falls with averaging crosses 0; NaN where it does not."""
    ends = [of(px) for px in _RANGE_PX]
    if not ends[0] > 0 > ends[1]:
        return float("nan")
    return float(optimize.root_scalar(of, bracket=_RANGE_PX, xtol=0.005).root)


if __name__ == "__main__":
    main()
