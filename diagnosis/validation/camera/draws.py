"""Random numbers of the withheld camera: one stream for every cause, none shared with anybody."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np

# Drawn once for this package. With another bit generator than NumPy's default on top, no stream of
# anybody who does not use this very constant can meet one of these.
_ROOT = 0x9B1E_57C3_60DA_4F82_A6E0_33D9_1C75_8E4B


@dataclass(frozen=True, kw_only=True, slots=True)
class Draws:
    """Where random numbers come from for one scene and frame of one camera.

    What a camera or a projector has by birth depends on the seed alone, what the scene has also on
    its name, what time brings also on the frame.
    """

    seed: int
    scene: str = ""
    frame: int = 0

    def of_device(self, cause: str) -> np.random.Generator:
        """Stream of what the device has by birth: the same in all scenes and frames."""
        return _stream(self.seed, "device", cause)

    def of_scene(self, cause: str) -> np.random.Generator:
        """Stream of what stands still in one scene: the same in all its frames."""
        return _stream(self.seed, "scene", self.scene, cause)

    def of_frame(self, cause: str) -> np.random.Generator:
        """Stream of what changes from frame to frame."""
        return _stream(self.seed, "frame", self.scene, str(self.frame), cause)


def _stream(seed: int, *words: str) -> np.random.Generator:
    digest = hashlib.blake2b("\x1f".join(words).encode(), digest_size=16).digest()
    root = np.random.SeedSequence([_ROOT, seed, int.from_bytes(digest, "big")])
    return np.random.Generator(np.random.SFC64(root))
