"""A small validation: few scenes and effects, tiny images, and strong effects."""

from __future__ import annotations

from starling.diagnosis.validation.protocol import tier

TRIED = ("gamma", "vignetting", "read_noise", "black_level", "median", "pixel_locking")
STRONG = {
    "gamma": 0.2,
    "vignetting": 1.5,
    "read_noise": 20.0,
    "black_level": 4.0,
    "pixel_locking": 0.08,
}
SMALL = tier.Tier(
    number=1,
    source="starling",
    matcher="starling",
    first_scene=60,
    sets=2,
    scenes=4,
    width=160,
    height=90,
    counts={"single": 10, "null": 6, "pair": 2, "unknown": 4},
    left_out=2,
)
NEUTRAL = {
    "gamma": 1.0,
    "vignetting": 0.0,
    "read_noise": 5.0,
    "black_level": 4.0,
    "pixel_locking": 0.0,
}
