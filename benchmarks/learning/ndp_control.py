"""Controls of the learned residual: training on wrong pairs must not help.

*Shuffled holes*: a network is trained on every scene's reference depth with the holes of another
scene. Held-out rooms must not become predictable. *Shuffled physics*: a hybrid is trained and
evaluated with another scene's simulation and the right reference depth. It must not be better than
the network; otherwise the advantage of hybrids would come from more weights and inputs.

    STARLING_CAPTURES=... python benchmarks/learning/ndp_control.py OUT --sensor TEMPLATE
"""

import dataclasses
from collections import Counter
from pathlib import Path

import ndp_faro

from starling.learning import registry
from starling.learning.data import captured
from starling.learning.evaluation import evaluate
from starling.learning.evaluation.evaluate import HolePrediction
from starling.sim.captures import capture
from starling.sim.console import progress

FIGURES = ("auc", "tpr_at_fpr10", "tpr_at_fpr4", "brier_skill", "ece")


def main() -> None:
    """Train on wrong pairs, room by room, and print the mean over rooms."""
    parser = ndp_faro.parser(__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--steps", type=int, help="see `starling evaluate`")
    parser.add_argument("--rooms", nargs="*", help="see `starling evaluate`")
    options = parser.parse_args()
    path = ndp_faro.captures()
    opened = capture.open_set(path)
    rooms = tuple(dict.fromkeys(scene.room for scene in opened.scenes))
    predictions: dict[str, list[HolePrediction]] = {}
    with progress.on_stderr() as track:
        for held in track(options.rooms or rooms, "rooms"):
            simulation = ndp_faro.simulation(options, held, path)
            examples = captured.examples(opened, simulation=simulation)
            for control, method, wrong in CONTROLS:
                paired = wrong(examples)
                predictor = registry.method(method, steps=options.steps).fit(
                    [example for example in paired if example.room != held],
                    folder=options.out / held / method,
                    seed=0,
                    track=track,
                )
                for example, right in zip(paired, examples, strict=True):
                    if example.room == held:
                        probability = predictor.probability(example)
                        prediction = HolePrediction(example=right, probability=probability)
                        predictions.setdefault(control, []).append(prediction)
    print(f"{'mean over rooms':24}" + "".join(f"{name:>14}" for name in FIGURES))
    for control, scenes in predictions.items():
        mean = evaluate.scores(scenes).mean
        print(f"{control:24}" + "".join(f"{getattr(mean, name):14.4f}" for name in FIGURES))


def _partners(examples):
    """Pair every scene with a scene from another room, each used once."""
    ordered = sorted(examples, key=lambda example: example.room)
    shift = max(Counter(example.room for example in ordered).values())
    partner = dict(
        zip((item.scene for item in ordered), ordered[shift:] + ordered[:shift], strict=True)
    )
    return [(example, partner[example.scene]) for example in examples]


def _shuffled_holes(examples):
    return [
        dataclasses.replace(example, ndp=partner.ndp, counted=partner.counted)
        for example, partner in _partners(examples)
    ]


def _shuffled_physics(examples):
    return [
        dataclasses.replace(example, physics=partner.physics)
        for example, partner in _partners(examples)
    ]


CONTROLS = (
    ("shuffled holes", "network", _shuffled_holes),
    ("shuffled physics", "hybrid", _shuffled_physics),
)


if __name__ == "__main__":
    main()
