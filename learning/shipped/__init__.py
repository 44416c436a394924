"""Models that come with the program, by name; README.md says what they have learnt from."""

from __future__ import annotations

from pathlib import Path

NAMES = ("hybrid-varied", "network-varied")
COMPLETION = Path(__file__).parent / "completion"  # Weights of the compact network that completes.


def folder(model: Path) -> Path:
    """Where a model lies: a shipped one's name stands for its folder, all else for itself."""
    return Path(__file__).parent / model if str(model) in NAMES else model
