"""A small constructed diagnosis for tests of the report."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from starling.diagnosis.diagnosis import Diagnosis
from starling.diagnosis.howfar.evaluation import Evaluation
from starling.diagnosis.howfar.evidence import EffectEvidence, SurrogateReason
from starling.diagnosis.howfar.reduction import GapReduction
from starling.diagnosis.howfar.remainder import Remainder
from starling.diagnosis.report.scene_section import SceneImages
from starling.diagnosis.scenes.observation import DepthObservation, SceneObservation
from starling.diagnosis.where import covariates, maps, rules, swap
from starling.diagnosis.where.coherence.shares import CoherenceSplit
from starling.diagnosis.where.location import GapLocation
from starling.diagnosis.which import search
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.which.response import Signature
from starling.diagnosis.which.segment import NOISE_LIMIT, SHARE_OF_INITIAL, Screening, SegmentResult
from starling.diagnosis.which.table import Columns, FeatureTable
from tests.unit.diagnosis import made_gaps as made
from tests.unit.diagnosis.test_features import GROUND
from tests.unit.diagnosis.test_where import pair_of

NAMES = ("attic", "<b>cellar</b> & yard", "hall", "kitchen", "porch", "stairs")
MINUS = "\N{MINUS SIGN}"
NAN = float("nan")
Leads = tuple[tuple[str, ...], tuple[str, ...]]


def real(*, infrared: bool = True, device: bool = True) -> list[SceneObservation]:
    observations = []
    for number in range(len(NAMES)):
        pair, device_px = pair_of(50 + number, 1.2, 0.05), pair_of(90 + number, 1.0, 0.11).ours_px
        observations.append(
            (pair.with_depth(device_px) if device else pair)
            if infrared
            else DepthObservation(device_px=device_px)
        )
    return observations


SIMULATED = [pair_of(number, 1.0, 0.02) for number in range(len(NAMES))]


def where(captured: list[SceneObservation]) -> GapLocation:
    scene_strata, rooms = [GROUND] * len(captured), NAMES[: len(captured)]
    simulated = SIMULATED[: len(captured)]
    several = len(captured) > 1
    before, after = (
        [~np.isfinite(observation.depth_px[0]) for observation in observations]
        for observations in (simulated, captured)
    )
    return GapLocation(
        parts=swap.stage_figures(simulated, captured, scene_strata, rooms),
        maps=tuple(maps.gap_maps(simulated, captured, scene_strata, rooms)) if several else (),
        bodies=(),
        hole_bins=tuple(covariates.bin_gaps(before, after, scene_strata, rooms)),
        error_bins=(),
        rules=tuple(rules.find_rules(before, after, scene_strata, rooms)),
        levels=dict.fromkeys(rooms, 1.0),
        coherence=CoherenceSplit(),
    )


def segment_result(
    searched: search.SearchResult, *, segment: Segment = Segment.IMAGE, leads: Leads = ((), ())
) -> SegmentResult:
    names = tuple(f"level.x.{number}" for number in range(made.FEATURES))
    return SegmentResult(
        table=FeatureTable(
            made.FakeTable.scene_models, Columns(segment=segment, names=names, ceiling=255)
        ),
        screening=Screening(
            base=made.BASE,
            signatures=tuple(made.SIGNATURES),
            weight=0.5 * made.ONES,
            folds=tuple(made.FOLDS),
            threshold=12.0,
            noise=1.0,
        ),
        likelihood=made.likelihood_of({}, 9),
        search=searched,
        explained_below=NOISE_LIMIT + SHARE_OF_INITIAL[segment] * 10,
        lead=leads[0],
        varying=leads[1],
    )


def named() -> search.SearchResult:
    """Return a search that accepts lens blur, which is not separable from dot blur."""
    double = Signature(
        made.candidate("dot_blur"), made.VALUES, made.EFFECTS["lens_blur"].change * 1.3
    )
    table = made.FakeTable({**made.EFFECTS, "dot_blur": double})
    result = made.run_search({"lens_blur": 0.3}, table=table, names=(*made.NAMES, "dot_blur"))
    likelihood = made.likelihood_of({"lens_blur": 0.3}, 9, table=table)
    alone = sorted(
        (made.fit(signature, likelihood, made.FOLDS) for signature in table.signatures.values()),
        key=lambda each: -each.total,
    )
    return dataclasses.replace(result, alone=tuple(alone))


NAMED, NOTHING = named(), made.run_search({})
HOWFAR = Evaluation(
    figures={
        "ndp_brier": GapReduction(
            before=0.25, after=0.125, floor=0.0625, closed_pct=66.7, interval=(41.0, 83.0)
        ),
        "bias_px": GapReduction(before=0.1, after=0.3, floor=0.1, closed_pct=None, interval=None),
        "infrared_nll": GapReduction(
            before=-2.5, after=-3.5, floor=-3.0, closed_pct=-200.0, interval=None
        ),
        "log_nmad": GapReduction(before=NAN, after=NAN, floor=NAN, closed_pct=None, interval=None),
    },
    alone={
        "lens_blur": {
            "ndp_brier": GapReduction(
                before=0.25, after=0.1, floor=0.0625, closed_pct=80.0, interval=None
            )
        }
    },
    shares={"lens_blur": 0.8125},
)


def evidence(*reasons: SurrogateReason) -> EffectEvidence:
    """Return the evidence of an effect, with the reasons for which it is a surrogate."""
    return EffectEvidence(gain=40.0, explained=0.9, improved=5.0, worsened=0.25, reasons=reasons)


def diagnosis(captured: list[SceneObservation] | None = None, **others: Any) -> Diagnosis:
    captured = real() if captured is None else captured
    names = NAMES[: len(captured)]
    others = {
        "kind": "effects",
        "against": None,
        "scenes": names,
        "held_out": names[1:2],
        "fitted": {},
        "limits": (),
        "restricted": False,
        "where": where(captured),
        "segments": (segment_result(NAMED),),
        "evidence": {name: evidence() for name in NAMED.settings},
        "settings": NAMED.settings,
        "compatible": True,
        "remainders": {},
        "places": {},
        "absorbed": (),
        "discriminations": (),
        "howfar": HOWFAR,
        "residual": None,
        "sensitivities": (),
        "example": SceneImages(
            scene=names[-1] if len(names) < 2 else names[1],
            real=captured[0],
            before=SIMULATED[0],
            after=pair_of(7, 1.1, 0.03),
            strata=GROUND,
        ),
        **others,
    }
    unknown = Remainder(share=None, interval=None)
    each = {segment.table.segment.value: unknown for segment in others["segments"]}
    return Diagnosis(**{**others, "remainders": each | others["remainders"]})


def surrogate(*reasons: SurrogateReason, **others: Any) -> Diagnosis:
    """Return a diagnosis whose only accepted effect is a surrogate."""
    others = {
        "kind": "none of the known",
        "evidence": {name: evidence(*reasons) for name in NAMED.settings},
        "settings": {},
        "howfar": dataclasses.replace(HOWFAR, figures={}, shares={}),
        **others,
    }
    return diagnosis(**others)


FULL = diagnosis()
