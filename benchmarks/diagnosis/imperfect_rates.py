"""Check the diagnosis on nulls and single effects with an imperfect base, as tier 5.

Two sets of scenes serve any number of cases, so that the simulations of the scenes are shared.
OUT holds all files, and a stopped run continues. The truth is opened once, by the scores.

Usage:
    python benchmarks/diagnosis/imperfect_rates.py --out OUT [--imperfect all] [--cases 16 8]
"""

from __future__ import annotations

import argparse
import dataclasses
import json
from pathlib import Path

from starling.diagnosis.validation.protocol import plan, score_table
from starling.diagnosis.validation.protocol.check import Check
from starling.diagnosis.validation.protocol.tier import TIERS


def main() -> None:
    """Run the check and print its scores."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--imperfect", choices=plan.PLANS, default=plan.ALL)
    counts = "numbers of single effects and of nulls"
    parser.add_argument("--cases", type=int, nargs=2, default=(16, 8), help=counts)
    parser.add_argument("--sets", type=int, default=2, help="number of scene sets")
    options = parser.parse_args()
    single, null = options.cases
    tier = dataclasses.replace(TIERS[5], sets=options.sets, counts={"single": single, "null": null})
    check = Check(
        out=options.out,
        tier=tier,
        blender=Path(),
        imperfect=options.imperfect,
        jobs=options.sets,
    )
    cases = check.prepare()
    check.diagnose(cases)
    scores = check.score(cases)
    (check.folder / "scores.json").write_text(json.dumps(scores, indent=1), encoding="utf-8")
    print(score_table.text(scores))


if __name__ == "__main__":
    main()
