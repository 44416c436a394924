"""Effect of hiding physics from a share of a hybrid's training crops.

Physics can be hidden from a share of the crops (`learning/networks/samples.py`). For each
room and share, a hybrid is trained on all other rooms and evaluated in this room. Use few rooms,
because rooms used to choose the share are no longer held out.

    STARLING_CAPTURES=... python benchmarks/learning/ndp_hidden.py OUT --sensor TEMPLATE --rooms
    0742 e
"""

import dataclasses
from pathlib import Path

import ndp_faro

from starling.learning.data import captured
from starling.learning.evaluation.metrics import classification, judge, pool
from starling.learning.methods.network import Hybrid
from starling.learning.networks.training import TrainingSettings
from starling.sim.captures import capture
from starling.sim.console import progress


def main() -> None:
    """Print a row for each room and share."""
    parser = ndp_faro.parser(__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--rooms", nargs="+", required=True)
    parser.add_argument("--shares", type=float, nargs="*", default=[0.0, 0.5, 0.75, 0.9])
    options = parser.parse_args()
    path = ndp_faro.captures()
    opened = capture.open_set(path)
    print(f"{'room':>6}{'hidden':>8}{'log loss':>10}{'Brier skill':>13}{'AUC':>8}")
    with progress.on_stderr() as track:
        for room in options.rooms:
            simulation = ndp_faro.simulation(options, room, path)
            examples = captured.examples(opened, simulation=simulation)
            for share in options.shares:
                predictor = Hybrid(
                    settings=dataclasses.replace(TrainingSettings(), hidden=share)
                ).fit(
                    [example for example in examples if example.room != room],
                    folder=options.out / f"{room}-{share:g}",
                    seed=0,
                    track=track,
                )
                figures = classification(
                    pool(
                        judge(predictor.probability(example), example.ndp, example.counted)
                        for example in examples
                        if example.room == room
                    )
                )
                print(
                    f"{room:>6}{share:8g}{figures.log_loss:10.4f}{figures.brier_skill:13.3f}"
                    f"{figures.auc:8.3f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
