"""A small diagnosis, made up: what pages and figures are made of in tests."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from starling.diagnosis.diagnosis import Diagnosis
from starling.diagnosis.howfar.evaluation import Judged
from starling.diagnosis.howfar.reduction import Closed
from starling.diagnosis.report.scene_images import Shown
from starling.diagnosis.scenes.observation import Reading
from starling.diagnosis.where import covariates, maps, rules, swap
from starling.diagnosis.where.location import Where
from starling.diagnosis.which import search
from starling.diagnosis.which.candidates import Arm
from starling.diagnosis.which.response import Signature
from starling.diagnosis.which.rows import Columns
from starling.diagnosis.which.segment import OF_BEFORE, UNEXPLAINED, Found, Screen
from starling.diagnosis.which.table import Bench
from tests.unit.diagnosis import test_fit as made
from tests.unit.diagnosis.test_features import GROUND
from tests.unit.diagnosis.test_where import pair_of

NAMES = ("attic", "<b>cellar</b> & yard", "hall", "kitchen", "porch", "stairs")
MINUS = "\N{MINUS SIGN}"
NAN = float("nan")
Leads = tuple[tuple[str, ...], tuple[str, ...]]


def real(*, infrared: bool = True, device: bool = True) -> list[Reading]:
    found = []
    for number in range(len(NAMES)):
        one = pair_of(50 + number, 1.2, 0.05)
        if device:
            one = dataclasses.replace(one, device_px=pair_of(90 + number, 1.0, 0.11).ours_px)
        if not infrared:
            one = dataclasses.replace(one, left=None, right=None, ours_px=None)
        found.append(one)
    return found


SIMULATED = [pair_of(number, 1.0, 0.02) for number in range(len(NAMES))]


def where(captured: list[Reading]) -> Where:
    grounds, rooms = [GROUND] * len(captured), NAMES[: len(captured)]
    simulated = SIMULATED[: len(captured)]
    several = len(captured) > 1
    seen = [one.device_px if one.device_px is not None else one.ours_px for one in captured]
    before = [~np.isfinite(one.ours_px[0]) for one in simulated if one.ours_px is not None]
    after = [~np.isfinite(one[0]) for one in seen if one is not None]
    return Where(
        parts=swap.swap(simulated, captured, grounds, rooms),
        maps=tuple(maps.maps(simulated, captured, grounds, rooms)) if several else (),
        bodies=(),
        rows=tuple(covariates.table(before, after, grounds, rooms)),
        off=(),
        rules=tuple(rules.rules(before, after, grounds, rooms)),
    )


def found(searched: search.Search, *, arm: Arm = Arm.IMAGE, leads: Leads = ((), ())) -> Found:
    names = tuple(f"level.x.{number}" for number in range(made.FEATURES))
    return Found(
        bench=Bench(made.FakeBench.subjects, Columns(arm=arm, names=names, ceiling=255)),
        screen=Screen(
            base=made.BASE,
            rough=tuple(made.SIGNATURES),
            weight=0.5 * made.ONES,
            folds=tuple(made.HELD),
            threshold=12.0,
            noise=1.0,
        ),
        likelihood=made.likelihood_of({}, 9),
        search=searched,
        explained_below=UNEXPLAINED + OF_BEFORE[arm] * 10,
        lead=leads[0],
        varying=leads[1],
    )


def named() -> search.Search:
    """Lens blur, which cannot be told from dot blur; all effects of the bench alone."""
    double = Signature(made.candidate("dot_blur"), made.VALUES, made.MADE["lens_blur"].change * 1.3)
    bench = made.FakeBench({**made.MADE, "dot_blur": double})
    one = made.searched({"lens_blur": 0.3}, bench=bench, names=(*made.NAMES, "dot_blur"))
    likelihood = made.likelihood_of({"lens_blur": 0.3}, 9, bench=bench)
    alone = sorted(
        (made.fit(signature, likelihood, made.HELD) for signature in bench.made.values()),
        key=lambda each: -each.total,
    )
    return dataclasses.replace(one, alone=tuple(alone))


NAMED, NOTHING = named(), made.searched({})
HOWFAR = Judged(
    figures={
        "ndp_brier": Closed(
            before=0.25, after=0.125, floor=0.0625, closed_pct=66.7, interval=(41.0, 83.0)
        ),
        "bias_px": Closed(before=0.1, after=0.3, floor=0.1, closed_pct=None, interval=None),
        "infrared_nll": Closed(
            before=-2.5, after=-3.5, floor=-3.0, closed_pct=-200.0, interval=None
        ),
        "log_nmad": Closed(before=NAN, after=NAN, floor=NAN, closed_pct=None, interval=None),
    },
    shares={"lens_blur": 0.8125},
)


def diagnosis(captured: list[Reading] | None = None, **others: Any) -> Diagnosis:
    captured = real() if captured is None else captured
    names = NAMES[: len(captured)]
    others = {
        "kind": "effects",
        "against": None,
        "scenes": names,
        "locked": names[1:2],
        "fitted": {},
        "limits": (),
        "where": where(captured),
        "arms": (found(NAMED),),
        "settings": NAMED.settings,
        "together": True,
        "taken_up": (),
        "tell_apart": (),
        "howfar": HOWFAR,
        "residual": None,
        "noticed": (),
        "shown": Shown(
            scene=names[-1] if len(names) < 2 else names[1],
            real=captured[0],
            before=SIMULATED[0],
            after=pair_of(7, 1.1, 0.03),
            ground=GROUND,
        ),
        **others,
    }
    return Diagnosis(**others)


FULL = diagnosis()
