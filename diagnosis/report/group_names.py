"""Names of feature groups in reports."""

from __future__ import annotations

_RIGHT = "right "
WORDS = {
    "level": "brightness",
    "codes": "codes used by the converter",
    "noise": "pixel-to-pixel noise",
    "time": "change from frame to frame",
    "texture": "sharpness",
    "dots": "position and width of dots",
    "pair": "difference of right and left image",
    "error": "disparity error",
    "holes": "pixels without depth",
    "surface": "steps and flat parts of the depth map",
    "range": "nearest and farthest depth",
    "against": "sign of the difference between the device's depth and our matcher's",
    "unlike": "size of the difference between the device's depth and our matcher's",
}


def describe(group: str) -> str:
    """Describe a group of features in words.

    Args:
        group: name as `starling.diagnosis.which.residuals.group` returns it.
    """
    kind, separator, covariate = group.removeprefix(_RIGHT).partition(" by ")
    side = " of the right image" if group.startswith(_RIGHT) else ""
    return f"{WORDS[kind]}{side}{separator and ','}{separator}{covariate}"
