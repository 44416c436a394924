"""Names of the two sides of a gap in a report: real and simulated, or two capture sets."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True, slots=True)
class SideNames:
    """The two sides by name, as different sentences need them."""

    title: str  # Title of the diagnosed captures: `Real`.
    reference_title: str  # Title of what they are compared with.
    pair: tuple[str, str]  # `real` minus `simulated`.
    more: str  # `the real` is brighter.
    have: tuple[str, str]  # `real captures` have more than `simulated captures`.
    reference_clause: str  # 5 % have no depth, against 3 % `in simulation`.
    stages: str  # Explains the stage ablation.
    images: tuple[str, str]  # Bar names of stages A and B.
    reference_depth: str  # Bar name of stage D, the reference side's own depth.
    gap: str  # Says what is compared; empty for real against simulated.


SIMULATION = SideNames(
    title="Real",
    reference_title="Simulated, your sensor file",
    pair=("real", "simulated"),
    more="the real",
    have=("real captures", "simulated captures"),
    reference_clause="in simulation",
    stages="A: simulated images, our matcher. B: real images, our matcher. C: the device's own "
    "depth. D: simulated images with all bits that the device's matcher reads. B minus A is the "
    "contribution of the images. C minus B, corrected by D minus A, is the contribution of matcher "
    "and filters. Whiskers are 95 % intervals over rooms.",
    images=("A simulated", "B real images, our matcher"),
    reference_depth="D simulated, all bits",
    gap="",
)
CAPTURES = SideNames(
    title="These captures",
    reference_title="The other captures",
    pair=("these captures", "the other captures"),
    more="this capture",
    have=("these captures", "the other captures"),
    reference_clause="in the other captures",
    stages="A: the other captures' images, our matcher. B: these captures' images, our matcher. "
    "C: this device's own depth. D: the other device's own depth. B minus A is the contribution of "
    "the images. C minus B, corrected by D minus A, is the contribution of matcher and filters. "
    "Whiskers are 95 % intervals over rooms.",
    images=("A other images, our matcher", "B these images, our matcher"),
    reference_depth="D other device",
    gap="Two capture sets of the same scenes are compared. The gap is these captures minus the "
    "other captures. Simulation only predicts what an effect would change.",
)


def side_names(against: str | None) -> SideNames:
    """Choose the names for a comparison with a capture set, or with simulation (None)."""
    return SIMULATION if against is None else CAPTURES
