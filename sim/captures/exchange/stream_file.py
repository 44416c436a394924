"""Reading of files that all layouts of RGB-D streams share."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from starling.patterns.errors import refuse
from starling.sim.captures import png
from starling.sim.stereo.depth import from_code


def text(path: Path) -> str:
    """Read a text file.

    Raises:
        InputError: if the file cannot be read, or is not UTF-8.
    """
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise refuse(path.name, "must be readable", path, f"{error}.") from error


def depth(path: Path, unit_m: float) -> NDArray[np.float32]:
    """Read depth z [m] (h, w), NaN = none, from 16-bit codes.

    Raises:
        InputError: if the file cannot be read, or has 8 bits.
    """
    code = png.read(path, "depth")
    if code.dtype != np.uint16:
        raise refuse("depth", "must be of 16 bits", f"{path}, 8-bit", "Extract it again.")
    return from_code(code.astype(np.uint16), unit_m)
