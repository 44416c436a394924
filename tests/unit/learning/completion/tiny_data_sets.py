"""Tiny data sets in their publishers' layouts: two walls, the lower one at half the distance."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest

SHAPE = (64, 128)
DISPARITY_PX = np.where(np.arange(SHAPE[0])[:, None] < 32, 8, 16).repeat(SHAPE[1], axis=1)
ROOMS = {"irs": ("Flat", "Shop"), "vkitti2": ("Scene01", "Scene02"), "nyuv2": ("den", "hall")}


def picture(path: Path, image: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    colour = image[..., ::-1] if image.ndim == 3 else image
    path.write_bytes(cv2.imencode(path.suffix, np.ascontiguousarray(colour))[1].tobytes())


def exr(path: Path, **channels: np.ndarray) -> None:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, channels).write(str(path))


def pair(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Left and right image of the walls, textured, with a uniform patch without matches."""
    wide = np.random.default_rng(seed).integers(0, 256, (SHAPE[0], SHAPE[1] + 16, 3))
    wide = cv2.GaussianBlur(wide.astype(np.uint8), (0, 0), 0.8)
    wide[20:44, 70:110] = 128
    left = wide[:, : SHAPE[1]]
    right = np.where(DISPARITY_PX[..., None] == 8, wide[:, 8:-8], wide[:, 16:])
    return np.ascontiguousarray(left), np.ascontiguousarray(right)


def write(layout: str, root: Path) -> Path:
    """Write two frames in different rooms; returns the path for the command line."""
    return {"irs": _irs, "vkitti2": _vkitti2, "nyuv2": _nyuv2}[layout](root)


def _irs(root: Path) -> Path:
    for number, scene in enumerate(("Home/Flat", "Store/Shop")):
        left, right = pair(number)
        picture(root / scene / "l_1.png", left)
        picture(root / scene / "r_1.png", right)
        exr(root / scene / "d_1.exr", G=DISPARITY_PX.astype(np.float32))
    return root


def _vkitti2(root: Path) -> Path:
    steps = np.round(100 * 725.0087 * 0.532725 / DISPARITY_PX).astype(np.uint16)
    for number, scene in enumerate(ROOMS["vkitti2"]):
        frames = root / scene / "clone" / "frames"
        for camera, image in zip(("Camera_0", "Camera_1"), pair(number), strict=True):
            picture(frames / "rgb" / camera / "rgb_00000.jpg", image)
        picture(frames / "depth" / "Camera_0" / "depth_00000.png", steps)
        text = "frame cameraID K[0,0] K[1,1] K[0,2] K[1,2]\n0 0 725.0087 725.0087 63.5 31.5\n"
        (frames.parent / "intrinsic.txt").write_text(text)
    return root


def _nyuv2(root: Path) -> Path:
    h5py = pytest.importorskip("h5py", reason="h5py reads NYU Depth V2")
    root.mkdir(parents=True, exist_ok=True)
    truth = np.stack([48 / DISPARITY_PX.astype(np.float32)] * 2)
    raw = truth.copy()
    raw[:, 20:44, 70:110] = 0
    with h5py.File(root / "nyu.mat", "w") as file:
        file["images"] = np.stack([pair(0)[0], pair(1)[0]]).transpose(0, 3, 2, 1)
        file["rawDepths"] = raw.transpose(0, 2, 1)
        file["depths"] = truth.transpose(0, 2, 1)
        texts = [np.array([list(map(ord, name))], np.uint16).T for name in ROOMS["nyuv2"]]
        places = [
            file.create_dataset(f"#refs#/{number}", data=text).ref
            for number, text in enumerate(texts)
        ]
        file.create_dataset("scenes", data=np.array([places], dtype=h5py.ref_dtype))
    return root / "nyu.mat"
