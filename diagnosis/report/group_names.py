"""What groups of features are called where people read of them."""

from __future__ import annotations

_RIGHT = "right "
WORDS = {
    "level": "brightness",
    "codes": "which codes the converter uses",
    "noise": "noise from pixel to pixel",
    "time": "what changes from frame to frame",
    "texture": "sharpness",
    "dots": "place and width of dots",
    "pair": "the right image against the left",
    "error": "errors of disparity",
    "holes": "pixels without depth",
    "surface": "steps and flat parts of the depth map",
    "range": "the nearest and farthest depth",
    "against": "which way the device's depth is off our matcher's",
    "unlike": "how far the device's depth is from ours",
}


def told(group: str) -> str:
    """A group of features in words.

    Args:
        group: as `starling.diagnosis.which.residuals.group` names it.
    """
    kind, by, covariate = group.removeprefix(_RIGHT).partition(" by ")
    side = " of the right image" if group.startswith(_RIGHT) else ""
    return f"{WORDS[kind]}{side}{by and ','}{by}{covariate}"
