"""Virtual KITTI 2: rendered streets, stereo pairs and depth.

    ROOT/SceneNN/VARIATION/frames/rgb/Camera_{0,1}/rgb_NNNNN.jpg      1242x375; 0 is the left one
    ROOT/.../frames/depth/Camera_{0,1}/depth_NNNNN.png    uint16, z in cm; 65535 = sky, or farther
    ROOT/SceneNN/VARIATION/intrinsic.txt    frame cameraID K[0,0] K[1,1] K[0,2] K[1,2]; a header

The archives unpack to `vkitti_2.0.3_rgb`, `vkitti_2.0.3_depth` and `vkitti_2.0.3_textgt` (the text
files). ROOT holds these three folders, or their merged content. Without text files the default
camera is used: 725.0087 px, principal point 620.5, 187. Baseline 0.532725 m.

Source: Cabon, Murray and Humenberger, Virtual KITTI 2, arXiv:2001.10773; names, depth unit and
numbers as in public programs that read it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from starling.learning.completion.data.readers.item import (
    Item,
    ItemSource,
    check_folder,
    read_code,
    read_colour,
)
from starling.patterns.errors import refuse
from starling.sim.geometry.pinhole import Pinhole

BASELINE_M = 0.532725
_FOCAL_PX, _CX_PX, _CY_PX = 725.0087, 620.5, 187.0
_STEP_M = 0.01
_SKY = 65535
_LEFT, _RIGHT = "Camera_0", "Camera_1"


def sources(root: Path) -> list[ItemSource]:
    """List the items of a folder by name. Images are read on demand.

    All variations of a scene (weather, light, turned cameras) are one room.

    Args:
        root: folder that holds the archives' folders or the merged scenes.

    Raises:
        InputError: if the folder does not exist or has no left image.
    """
    pictures = _part(check_folder(root), "rgb")
    sources_found = []
    for path in sorted(pictures.glob(f"Scene*/*/frames/rgb/{_LEFT}/rgb_*.jpg")):
        scene, variation = path.relative_to(pictures).parts[:2]
        number = path.stem.removeprefix("rgb_")
        files = _Files.from_names(root, f"{scene}/{variation}", number)
        sources_found.append(
            ItemSource(
                name=f"{scene}/{variation}/{number}",
                room=scene,
                files=files.existing,
                load=partial(_load, files, int(number)),
            )
        )
    if not sources_found:
        rule = f"must hold SceneNN/VARIATION/frames/rgb/{_LEFT}/rgb_NNNNN.jpg"
        raise refuse("Virtual KITTI 2", rule, root, "Give the folder it was unpacked to.")
    return sources_found


@dataclass(frozen=True, kw_only=True, slots=True)
class _Files:
    """Paths of one frame."""

    left: Path
    right: Path
    depth: Path
    text: Path  # Intrinsics of all frames; optional.

    @property
    def existing(self) -> tuple[Path, ...]:
        """All paths; the text file only if it exists."""
        images = (self.left, self.right, self.depth)
        return (*images, self.text) if self.text.exists() else images

    @classmethod
    def from_names(cls, root: Path, place: str, number: str) -> _Files:
        pictures = _part(root, "rgb") / place / "frames/rgb"
        depths = _part(root, "depth") / place / "frames/depth"
        return cls(
            left=pictures / _LEFT / f"rgb_{number}.jpg",
            right=pictures / _RIGHT / f"rgb_{number}.jpg",
            depth=depths / _LEFT / f"depth_{number}.png",
            text=_part(root, "textgt") / place / "intrinsic.txt",
        )


def _part(root: Path, kind: str) -> Path:
    """Return the folder of one archive."""
    archive = root / f"vkitti_2.0.3_{kind}"
    return archive if archive.is_dir() else root


def _load(files: _Files, number: int) -> Item:
    rgb = read_colour(files.left)
    steps = read_code(files.depth)
    known = (steps > 0) & (steps < _SKY)
    fx, fy, cx, cy = _intrinsics(files.text, number)
    height, width = rgb.shape[:2]
    return Item(
        rgb=rgb,
        right=read_colour(files.right),
        truth_m=np.where(known, steps * np.float32(_STEP_M), np.float32(np.nan)),
        camera=Pinhole(width=width, height=height, fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy),
        baseline_m=BASELINE_M,
    )


def _intrinsics(path: Path, frame: int) -> tuple[float, float, float, float]:
    """Return the intrinsics of the left camera for one frame."""
    if not path.exists():
        return _FOCAL_PX, _FOCAL_PX, _CX_PX, _CY_PX
    try:
        for line in path.read_text(encoding="ascii").splitlines()[1:]:
            number, camera, fx, fy, cx, cy = line.split()
            if int(number) == frame and int(camera) == 0:
                return float(fx), float(fy), float(cx), float(cy)
    except (OSError, ValueError) as error:
        rule = "must have lines of frame, camera and four numbers"
        raise refuse("intrinsic.txt", rule, path, f"{error}.") from error
    raise refuse("intrinsic.txt", f"must have a line for frame {frame}", path, "Copy it again.")
