"""How often should physics be hidden from a hybrid that learns?

A hybrid learns with physics hidden from a share of its crops (`learning/networks/training/samples.py`). For
each room named, a hybrid learns from all others by each share, and is judged there. Name few rooms:
what is chosen by them is no longer judged fairly in them.

    STARLING_CAPTURES=... python benchmarks/learning/ndp_hidden.py OUT --sensor TEMPLATE --rooms 0742 e
"""

import dataclasses
from pathlib import Path

import ndp_faro

from starling.learning.data import captured
from starling.learning.evaluation.figures.classification import classification
from starling.learning.evaluation.figures.judged import judge, pool
from starling.learning.methods.hybrid import Hybrid
from starling.learning.networks.training.settings import Settings
from starling.sim.captures import capture
from starling.sim.console import progress


def main() -> None:
    """Print a row for each room and share."""
    parser = ndp_faro.parser(__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--rooms", nargs="+", required=True)
    parser.add_argument("--shares", type=float, nargs="*", default=[0.0, 0.5, 0.75, 0.9])
    asked = parser.parse_args()
    path = ndp_faro.captures()
    opened = capture.open_set(path)
    print(f"{'room':>6}{'hidden':>8}{'log loss':>10}{'Brier skill':>13}{'AUC':>8}")
    with progress.on_stderr() as track:
        for room in asked.rooms:
            simulation = ndp_faro.simulation(asked, room, path)
            examples = captured.examples(opened, simulation=simulation)
            for share in asked.shares:
                predictor = Hybrid(settings=dataclasses.replace(Settings(), hidden=share)).fit(
                    [one for one in examples if one.room != room],
                    folder=asked.out / f"{room}-{share:g}",
                    seed=0,
                    track=track,
                )
                found = classification(
                    pool(
                        judge(predictor.probability(one), one.ndp, one.counted)
                        for one in examples
                        if one.room == room
                    )
                )
                print(
                    f"{room:>6}{share:8g}{found.log_loss:10.4f}{found.brier_skill:13.3f}"
                    f"{found.auc:8.3f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
