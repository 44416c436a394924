"""Folders of images: PNG, TIFF, NPY or EXR files by patterns, or by usual names."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors, regular_file
from starling.sim.captures import depth_file, png
from starling.sim.captures.recordings.recording import RecordedFrame, Recording

SUFFIXES = (".png", ".npy", ".tif", ".tiff", ".exr", ".jpg", ".jpeg", ".bmp", ".pgm")
# Usual patterns without suffix, the first that fits counts.
_USUAL = {
    "left": ("left/*", "ir_left*", "rectified_left*", "left*", "infra1*", "ir1*", "Infrared_1*"),
    "right": ("right/*", "ir_right*", "rectified_right*", "right*", "infra2*", "ir2*"),
    "depth": ("depth/*", "depth*", "Depth*"),
    "colour": ("color/*", "colour/*", "rgb/*", "rgb*", "color*", "colour*"),
}
_UNLIT = re.compile(r"_off(_?\d+)?$")  # Images without dots, which usual patterns fit too.
_FLOATS = (".npy", ".tif", ".tiff", ".exr")


def read(path: Path, patterns: Mapping[str, str]) -> Recording:
    """Find the images of a folder; they are read on demand.

    Args:
        path: the folder.
        patterns: by stream, relative to the folder: `ir1_*.png`.

    Raises:
        InputError: if a pattern leaves the folder or fits no image, no left images are there, or
            streams have no images in common.
    """
    files = {name: _matches(path, name, pattern) for name, pattern in patterns.items()}
    for name, usual in _USUAL.items():
        if "left" in patterns or name in patterns:  # Then the others are named too.
            continue
        first = next(filter(None, (_usual_matches(path, pattern) for pattern in usual)), None)
        if first:
            files[name] = first
    if "left" not in files:
        rule = "must hold left infrared images"
        raise errors.refuse("source", rule, path, "Give their pattern: --left 'ir1_*.png'.")
    truths = files.pop("truth", [])
    rows = _rows(files)
    if len(truths) == 1:  # Of a static scene.
        rows = [{**row, "truth": truths[0][1]} for row in rows]
    elif truths:
        rows = [
            {**row, "truth": truth}
            for row, (_, truth) in zip(rows, truths, strict=False)
            if len(truths) == len(rows)
        ]
        if not rows:
            rule, got = "must be one image, or one for each frame", len(truths)
            raise errors.refuse("--truth", rule, got, "Name them alike.")
    frames = tuple(
        RecordedFrame(
            time_s=None,
            images={name: partial(_image, file, name) for name, file in row.items()},
        )
        for row in rows
    )
    return Recording(
        path=path,
        kind="folder of images",
        frames=frames,
        unpaired=len(files["left"]) - len(rows),
        notes=_notes(files),
    )


def _matches(path: Path, name: str, pattern: str) -> list[tuple[str, Path]]:
    """Return the files of a pattern with the text of its wildcards."""
    flag = f"--{name.replace('_', '-')}"
    if Path(pattern).is_absolute() or ".." in Path(pattern).parts:
        raise errors.refuse(flag, "must be a pattern inside the folder", pattern, "As 'ir1_*.png'.")
    try:
        files = [file for file in path.glob(pattern) if file.is_file()]
    except OSError as error:  # A name that is too long.
        rule, advice = "must be a pattern of file names", f"{error.strerror}."
        raise errors.refuse(flag, rule, pattern[:80], advice) from None
    others = [file for file in files if file.suffix.lower() not in SUFFIXES]
    if others:
        rule, listed = "must name images", ", ".join(SUFFIXES)
        raise errors.refuse(flag, rule, others[0], f"Known: {listed}.")
    if not files:
        raise errors.refuse(flag, "must fit files of the folder", pattern, f"Looked in {path}.")
    wild = re.escape(pattern).replace(r"\*", "(.*)").replace(r"\?", "(.)")
    keyed = []
    for file in sorted(files, key=depth_file.order):
        match = re.fullmatch(wild, file.relative_to(path).as_posix())
        keyed.append((_key("".join(match.groups()) if match else file.stem), file))
    return keyed


def _key(text: str) -> str:
    """Return the text of wildcards; numbers count without leading zeros, suffixes do not."""
    stem = re.sub(r"\.[A-Za-z]+$", "", text)
    return re.sub(r"\d+", lambda number: str(int(number[0])), stem)


def _usual_matches(path: Path, pattern: str) -> list[tuple[str, Path]]:
    keyed = []
    for suffix in SUFFIXES:
        if any(path.glob(pattern + suffix)):
            keyed += _matches(path, "", pattern + suffix)
    return [(key, file) for key, file in keyed if not _UNLIT.search(file.stem)]


def _rows(files: Mapping[str, Sequence[tuple[str, Path]]]) -> list[dict[str, Path]]:
    """Combine the images with equal keys, or else in their order."""
    tables = {name: dict(keyed) for name, keyed in files.items()}
    shared = set.intersection(*(set(table) for table in tables.values()))
    if shared:
        return [
            {name: table[key] for name, table in tables.items()}
            for key in tables["left"]
            if key in shared
        ]
    counts = {name: len(keyed) for name, keyed in files.items()}
    if len(set(counts.values())) > 1:
        listed = ", ".join(f"{count} {name}" for name, count in counts.items())
        rule = "must have names with equal numbers"
        raise errors.refuse("images", rule, listed, "Name the images of one time alike.")
    return [
        {name: keyed[number][1] for name, keyed in files.items()}
        for number in range(counts["left"])
    ]


def _image(path: Path, name: str) -> NDArray[Any]:
    """Read an image: depth as it is stored, pictures of 8 or 16 bits."""
    suffix = path.suffix.lower()
    if suffix == ".npy":
        return _npy(path, name)
    if suffix == ".exr":
        return depth_file.read(path, "m")
    if suffix in _FLOATS:
        return _tiff(path, name)
    return png.read_picture(path, name)


def _npy(path: Path, name: str) -> NDArray[Any]:
    try:
        regular_file.refuse_others(path)
        array = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        rule = "must be a whole NumPy array"
        raise errors.refuse(name, rule, path, f"{error}.") from error
    if array.ndim == 3 and array.shape[-1] == 1:
        array = array[..., 0]
    if array.ndim not in (2, 3) or array.dtype.kind not in "fiu" or not array.size:
        got = f"{path} with {array.shape} {array.dtype}"
        raise errors.refuse(name, "must be an image (h, w)", got, "Save one image a file.")
    return array


def _tiff(path: Path, name: str) -> NDArray[Any]:
    data = regular_file.read(path)
    image = png.decode_picture(data) if data else None
    if image is None:
        raise errors.refuse(name, "must be a readable image", path, "Copy it again.")
    return np.ascontiguousarray(image[..., ::-1]) if image.ndim == 3 else image


def _notes(files: Mapping[str, Sequence[tuple[str, Path]]]) -> tuple[str, ...]:
    return tuple(
        f"{name} images are JPEG: their noise is not the camera's"
        for name, keyed in files.items()
        if keyed[0][1].suffix.lower() in (".jpg", ".jpeg") and name != "colour"
    )
