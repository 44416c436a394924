"""Scores of simulated holes of a real D415 against the sigma of their smoothing.

STARLING_CAPTURES=... python benchmarks/learning/ndp_place.py --sensor TEMPLATE
"""

import ndp_faro

from starling.learning.data.physics import physics_probability
from starling.learning.evaluation import evaluate
from starling.learning.evaluation.evaluate import HolePrediction
from starling.sim.console import progress

SIGMAS_PX = (0.0, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0)


def main() -> None:
    """Print means over rooms for each smoothing."""
    options = ndp_faro.parser(__doc__).parse_args()
    predictions = {sigma_px: [] for sigma_px in SIGMAS_PX}
    with progress.on_stderr() as track:
        for _, example in ndp_faro.scenes(options, ndp_faro.captures(), track):
            for sigma_px, smoothed in predictions.items():
                probability = physics_probability(example.physics, place_px=sigma_px)
                smoothed.append(HolePrediction(example=example, probability=probability))
    print(f"{'sigma px':>8}{'AUC':>8}{'TPR 10 %':>10}{'TPR 4 %':>9}{'Brier skill':>13}{'ECE':>8}")
    for sigma_px, smoothed in predictions.items():
        mean = evaluate.scores(smoothed).mean
        print(
            f"{sigma_px:8g}{mean.auc:8.3f}{mean.tpr_at_fpr10:10.3f}{mean.tpr_at_fpr4:9.3f}"
            f"{mean.brier_skill:13.3f}{mean.ece:8.4f}"
        )


if __name__ == "__main__":
    main()
