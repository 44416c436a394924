"""Crop a capture set to its middle rows, for experiments that are slow on whole images.

Rows correspond in a rectified pair, so that the result is a capture of the same camera with a
lower image. Widths and disparities do not change.

Usage:
    python benchmarks/data/crop_captures.py SET OUT --rows 240
"""

from __future__ import annotations

import argparse
import dataclasses
import shutil
from pathlib import Path

import cv2

from starling.sim.captures import capture
from starling.sim.captures import info as capture_info


def main() -> None:
    """Write the cropped set."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("set", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--rows", type=int, required=True)
    options = parser.parse_args()
    info = capture.open_set(options.set).info
    first = (info.height - options.rows) // 2
    shutil.copytree(
        options.set, options.out, ignore=shutil.ignore_patterns("colour*", "scene.toml")
    )
    for path in options.out.rglob("*.png"):
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert image is not None
        cv2.imwrite(str(path), image[first : first + options.rows])
    lower = dataclasses.replace(info, height=options.rows, cy_px=info.cy_px - first)
    (options.out / capture_info.FILE).write_text(capture_info.dumps(lower), encoding="utf-8")


if __name__ == "__main__":
    main()
