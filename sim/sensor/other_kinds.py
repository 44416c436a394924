"""Depth cameras that measure by another principle, which the simulator does not have."""

from __future__ import annotations

from starling.patterns import errors

_TIME_OF_FLIGHT = "measures the time of flight of light, and matches no images"
_LIDAR = "scans the scene with a laser, and matches no images"
_CODED = "projects several patterns in turn, and matches no fixed one"
# Nearest preset by field of view and range.
_NEAREST = {
    _TIME_OF_FLIGHT: {
        "azure-kinect": "gemini-335l",
        "femto": "gemini-335l",
        "femto-bolt": "gemini-335l",
        "femto-mega": "gemini-335l",
        "kinect-v2": "d435",
        "helios2": "d455",
        "blaze-101": "d415",
        "flexx2": "d405",
        "oak-d-tof": "oak-d-sr",
        "oak-d-sr-poe": "oak-d-sr",
    },
    _LIDAR: {"l515": "d415"},
    _CODED: {
        "f200": "d415",
        "sr300": "d415",
        "sr305": "d415",
        "zivid": "structure-core",
        "photoneo": "structure-core",
    },
}
_REASONS = {
    camera: (reason, preset)
    for reason, cameras in _NEAREST.items()
    for camera, preset in cameras.items()
}


def names() -> list[str]:
    """List the cameras that are refused by name."""
    return sorted(_REASONS)


def refuse(key: str, name: str) -> None:
    """Refuse a camera of another principle, and name the preset that comes nearest.

    Args:
        key: name of the value in messages.
        name: camera as the user wrote it; case does not matter, nor space and underscore.

    Raises:
        InputError: if the camera measures by another principle.
    """
    camera = name.lower().replace("_", "-").replace(" ", "-")
    if camera in _REASONS:
        reason, preset = _REASONS[camera]
        rule = "must be a stereo or structured-light camera"
        raise errors.refuse(key, rule, f"{name}, which {reason}", f"Nearest preset: {preset}.")
