"""What a report calls the two sides of a gap: real and simulated, or two captures."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True, slots=True)
class Words:
    """The sides by name, each where it stands in a sentence."""

    one: str  # The captures that are diagnosed, as a title: `Real`.
    other: str
    pair: tuple[str, str]  # `real` less `simulated`.
    more: str  # `the real` is brighter.
    have: tuple[str, str]  # `real captures` have more than `simulated`.
    beside: str  # 5 % have no depth, `simulated` 3 %.
    stages: str  # The stage swap.
    images: tuple[str, str]  # Its first two bars.
    own: str  # Depth of the base's own, beside what our matcher makes of its images.
    gap: str  # What is compared, as a sentence; empty where that goes without saying.


SIMULATION = Words(
    one="Real",
    other="Simulated, base",
    pair=("real", "simulated"),
    more="the real",
    have=("real captures", "simulated"),
    beside="simulated",
    stages="A: simulated images, our matcher. B: real images, our matcher. C: the device's own "
    "depth. D: simulated images with all the bits that the device's matcher reads. B less A is the "
    "part of the images, C less B, less what D is from A, that of matcher and filters; whiskers "
    "are 95 % intervals over rooms.",
    images=("A simulated", "B real images, our matcher"),
    own="D simulated, all bits",
    gap="",
)
CAPTURES = Words(
    one="These captures",
    other="The others",
    pair=("these captures", "the others"),
    more="this capture",
    have=("these captures", "the others"),
    beside="in the other captures",
    stages="A: the other captures' images, our matcher. B: these captures' images, our matcher. "
    "C: this device's own depth; D: the other's. B less A is the part of the images, C less B, "
    "less what D is from A, that of matcher and filters; whiskers are 95 % intervals over rooms.",
    images=("A the others' images, our matcher", "B these images, our matcher"),
    own="D other device",
    gap="Two capture sets of the same scenes are compared, not captures with simulations: the gap "
    "is these captures less the others. Simulation tells only what an effect would change.",
)


def words(against: str | None) -> Words:
    """Choose by what captures are compared with: another set, or None for simulations."""
    return SIMULATION if against is None else CAPTURES
