"""Controls of the learned residual: what is learnt from wrong pairs must gain nothing.

*Shuffled holes*: a network learns every scene's holes from another scene's reference depth. Rooms
it has not seen must not look predictable. *Shuffled physics*: a hybrid learns and is judged with
another scene's simulation beside the right reference depth. It must not beat the network, else
what hybrids gain would be more weights and inputs, not physics.

    STARLING_CAPTURES=... python benchmarks/learning/ndp_control.py OUT --sensor TEMPLATE
"""

import dataclasses
from collections import Counter
from pathlib import Path

import ndp_faro

from starling.learning import registry
from starling.learning.data import captured
from starling.learning.evaluation import evaluate
from starling.learning.evaluation.evaluate import Told
from starling.sim.captures import capture
from starling.sim.console import progress

FIGURES = ("auc", "tpr_at_fpr10", "tpr_at_fpr4", "brier_skill", "ece")


def main() -> None:
    """Learn from wrong pairs, room by room, and print the mean over rooms."""
    parser = ndp_faro.parser(__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--steps", type=int, help="as `starling evaluate` takes it")
    parser.add_argument("--rooms", nargs="*", help="as `starling evaluate` takes it")
    asked = parser.parse_args()
    path = ndp_faro.captures()
    opened = capture.open_set(path)
    rooms = tuple(dict.fromkeys(scene.room for scene in opened.scenes))
    told: dict[str, list[Told]] = {}
    with progress.on_stderr() as track:
        for held in track(asked.rooms or rooms, "rooms"):
            simulation = ndp_faro.simulation(asked, held, path)
            examples = captured.examples(opened, simulation=simulation)
            for control, method, wrong in CONTROLS:
                paired = wrong(examples)
                predictor = registry.method(method, steps=asked.steps).fit(
                    [example for example in paired if example.room != held],
                    folder=asked.out / held / method,
                    seed=0,
                    track=track,
                )
                for example, right in zip(paired, examples, strict=True):
                    if example.room == held:
                        one = Told(example=right, probability=predictor.probability(example))
                        told.setdefault(control, []).append(one)
    print(f"{'mean over rooms':24}" + "".join(f"{name:>14}" for name in FIGURES))
    for control, of_it in told.items():
        mean = evaluate.scores(of_it).mean
        print(f"{control:24}" + "".join(f"{getattr(mean, name):14.4f}" for name in FIGURES))


def _others(examples):
    """Of every scene one from another room, each once."""
    ordered = sorted(examples, key=lambda example: example.room)
    shift = max(Counter(example.room for example in ordered).values())
    partner = dict(
        zip((one.scene for one in ordered), ordered[shift:] + ordered[:shift], strict=True)
    )
    return [(example, partner[example.scene]) for example in examples]


def _shuffled_holes(examples):
    return [
        dataclasses.replace(one, ndp=other.ndp, counted=other.counted)
        for one, other in _others(examples)
    ]


def _shuffled_physics(examples):
    return [dataclasses.replace(one, physics=other.physics) for one, other in _others(examples)]


CONTROLS = (
    ("shuffled holes", "network", _shuffled_holes),
    ("shuffled physics", "hybrid", _shuffled_physics),
)


if __name__ == "__main__":
    main()
