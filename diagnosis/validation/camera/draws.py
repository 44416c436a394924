"""Random streams of the second camera: one independent stream per cause."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np

# Root seed of this package, drawn once. With this root and SFC64 in place of NumPy's default bit
# generator, no stream coincides with a stream of the simulator.
_ROOT = 0x9B1E_57C3_60DA_4F82_A6E0_33D9_1C75_8E4B


@dataclass(frozen=True, kw_only=True, slots=True)
class Draws:
    """Random streams of one frame of one scene, captured by one camera.

    Device streams depend on the seed alone. Scene streams depend on the scene name as well, and
    frame streams on the frame number too.
    """

    seed: int
    scene: str = ""
    frame: int = 0

    def device_rng(self, cause: str) -> np.random.Generator:
        """Return a stream of the device, equal in all scenes and frames."""
        return _stream(self.seed, "device", cause)

    def scene_rng(self, cause: str) -> np.random.Generator:
        """Return a stream of the scene, equal in all its frames."""
        return _stream(self.seed, "scene", self.scene, cause)

    def frame_rng(self, cause: str) -> np.random.Generator:
        """Return a stream of the frame."""
        return _stream(self.seed, "frame", self.scene, str(self.frame), cause)


def _stream(seed: int, *words: str) -> np.random.Generator:
    digest = hashlib.blake2b("\x1f".join(words).encode(), digest_size=16).digest()
    root = np.random.SeedSequence([_ROOT, seed, int.from_bytes(digest, "big")])
    return np.random.Generator(np.random.SFC64(root))
