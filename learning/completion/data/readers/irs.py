"""IRS, the Indoor Robotics Stereo data set: rendered rooms, stereo pairs and disparity.

    ROOT/{Home,Office,Restaurant,Store}/SCENE/l_N.png, r_N.png    960x540, colour
    ROOT/.../SCENE/d_N.exr      disparity of the left image [px], float; one channel, G, or R G B
    ROOT/.../SCENE/n_N.exr      normals, not read

Focal length 480 px, baseline 0.1 m, principal point at the image centre. N has five digits in the
lists, and no leading zeros in some archives.

Source: Wang et al., IRS: a large naturalistic indoor robotics stereo dataset, ICME 2021.
The layout follows github.com/HKBU-HPML/IRS: `lists/*.list`; `dataloader/IRSLoader.py` (size, focal
length); `scripts/EXRloader.py` (channels); `scripts/disp2pcd.py` (baseline, principal point).
"""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import numpy as np

from starling.learning.completion.data.readers.item import (
    Item,
    ItemSource,
    check_folder,
    read_colour,
)
from starling.learning.completion.method import Image
from starling.patterns.errors import refuse
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.stereo.depth import depth_from_disparity

FOCAL_PX = 480.0
BASELINE_M = 0.1
_LEFT = re.compile(r"l_([0-9]+)\.png")


def sources(root: Path) -> list[ItemSource]:
    """List the items of a folder by name. Images are read on demand.

    Variants of one scene (`Kitchen`, `Kitchen_Dark`) show the same room. The room is the part of
    the folder's name before the first underscore.

    Args:
        root: the data set's folder, or a folder inside it.

    Raises:
        InputError: if the folder does not exist or has no left image.
    """
    sources_found = []
    for path in sorted(check_folder(root).rglob("l_*.png")):
        number = _LEFT.fullmatch(path.name)
        if number:
            scene = path.parent
            sources_found.append(
                ItemSource(
                    name=path.relative_to(root).with_suffix("").as_posix(),
                    room=scene.name.partition("_")[0],
                    files=(path, _right(scene, number[1]), _truth(scene, number[1])),
                    load=partial(_load, scene, number[1]),
                )
            )
    if not sources_found:
        raise refuse("IRS", "must hold SCENE/l_N.png", root, "Give the folder it was unpacked to.")
    return sources_found


def _right(scene: Path, number: str) -> Path:
    return scene / f"r_{number}.png"


def _truth(scene: Path, number: str) -> Path:
    return scene / f"d_{number}.exr"


def _load(scene: Path, number: str) -> Item:
    rgb = read_colour(scene / f"l_{number}.png")
    height, width = rgb.shape[:2]
    disparity = _disparity(_truth(scene, number))
    return Item(
        rgb=rgb,
        right=read_colour(_right(scene, number)),
        truth_m=depth_from_disparity(disparity, focal_px=FOCAL_PX, baseline_m=BASELINE_M),
        camera=Pinhole(
            width=width,
            height=height,
            fx_px=FOCAL_PX,
            fy_px=FOCAL_PX,
            cx_px=(width - 1) / 2,
            cy_px=(height - 1) / 2,
        ),
        baseline_m=BASELINE_M,
    )


def _disparity(path: Path) -> Image:
    import OpenEXR

    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: channel.pixels for name, channel in file.parts[0].channels.items()}
    except (RuntimeError, ValueError, TypeError, OSError) as error:
        raise refuse("disparity", "must be a readable OpenEXR file", path, f"{error}.") from error
    pixels = channels.get("G")
    if pixels is None:
        got = f"{path} with {', '.join(channels) or 'none'}"
        raise refuse("disparity", "must have the channel G", got, "Is it a file of IRS?")
    return np.asarray(pixels, np.float32)
