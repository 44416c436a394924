"""Diagnosis of many capture sets of the same scenes, without any knowledge of their effects."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tyro.conf import Positional

from starling.diagnosis.report import figures
from starling.diagnosis.scenes.observation import SceneObservation, read_observation
from starling.diagnosis.scenes.scene_model import SceneModel, load_scene_model, with_capture
from starling.diagnosis.scenes.selection import pair_scenes, split_test_rooms
from starling.diagnosis.validation.adapters import families
from starling.diagnosis.validation.adapters.own_depth import capture_sets
from starling.diagnosis.which import attribution, baselines
from starling.diagnosis.which.attribution import Attribution
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.which.segment import Screening, SegmentResult, restrict_to_families
from starling.diagnosis.which.table import FeatureTable
from starling.patterns.errors import refuse
from starling.sim import effects, files
from starling.sim.captures import capture
from starling.sim.captures.capture import CapturedScene
from starling.sim.commands.simulate_captures import scene_seed
from starling.sim.console import output, progress, record
from starling.sim.console.threads import single_threaded
from starling.sim.sensor import resolve
from starling.sim.sensor.sensor import Sensor

Screenings = dict[Segment, tuple[FeatureTable, Screening]]


def batch(
    cases: Positional[Path],
    out: Positional[Path],
    *,
    sensor: str,
    against: Path | None = None,
    cache: Path | None = None,
    without: Path | None = None,
) -> None:
    """Diagnose many capture sets of the same scenes.

    OUT gets a verdict FOLDER.json for each. With --without, it gets two verdicts, in `without
    family` and `without twins`. Existing verdicts are kept, so a stopped run continues where it
    stopped. The effects on the scenes are simulated once for all sets, or for each set where scenes
    are estimated from its captures. For one capture set, `starling diagnose` reports more.

    Args:
        cases: folder of capture sets of the same scenes.
        out: folder for the verdicts; created if missing.
        sensor: preset or sensor file of all capture sets.
        against: capture set to compare each set with instead of simulated captures.
        cache: folder that caches simulations for other runs.
        without: JSON file: an effect by name of capture set. The first verdict leaves out its
            family; the second also leaves out the families of effects that the table marks as
            confusable with it. Other capture sets are skipped.

    Raises:
        InputError: if a capture set is missing or damaged, or shows other scenes than the first.
            Also if an effect is unknown.
    """
    single_threaded()
    folders = capture_sets(cases)
    camera = resolve.load(sensor, captures=str(folders[0]))
    reference_set = None if against is None else capture.open_set(against)
    left_out = None if without is None else _left_out(without)
    if left_out is not None:
        folders = [folder for folder in folders if folder.name in left_out]
    todo = [folder for folder in folders if _missing(out, folder.name, left_out)]
    references = {
        scene.name: read_observation(scene, camera)
        for scene in (() if reference_set is None else reference_set.scenes)
    }
    scene_models: list[SceneModel] = []
    screenings: Screenings = {}
    with progress.on_stderr() as track:
        for folder in track(todo, "capture sets"):
            started = time.perf_counter()
            pairs = pair_scenes(capture.open_set(folder), reference_set).pairs
            if _estimated(scene_models):  # Estimates belong to the captures they come from.
                scene_models, screenings = [], {}
            scene_models = _scene_models(folder.name, pairs, camera, scene_models, references)
            training, held_out = split_test_rooms(scene_models)
            screened = [
                _screened(segment, training, screenings, cache, track)
                for segment in attribution.available_segments(scene_models, training)
            ]
            for path, tried in _missing(out, folder.name, left_out).items():
                restricted = [
                    (table, restrict_to_families(screening, tried)) for table, screening in screened
                ]
                result = attribution.attribute_effects(restricted, held_out)
                verdict = _verdict(result, seed=scene_seed(0, folder.name))
                verdict["seconds"] = round(time.perf_counter() - started, 3)
                output.write_file(path, record.dumps(verdict).encode())
                started = time.perf_counter()


def _missing(out: Path, case: str, without: Mapping[str, str] | None) -> dict[Path, frozenset[str]]:
    """Return the missing verdicts of a capture set, with the families to try for each."""
    known = frozenset(families.known())
    tables = {out: known}
    if without is not None:
        effect = effects.named(without[case])
        similar = {effects.named(name).family for name in families.confusable(effect)}
        rest = known - {effect.family}
        tables = {out / "without family": rest, out / "without twins": rest - similar}
    paths = {folder / f"{case}.json": tried for folder, tried in tables.items()}
    return {path: tried for path, tried in paths.items() if not path.exists()}


def _screened(
    segment: Segment,
    training: Sequence[SceneModel],
    screenings: Screenings,
    cache: Path | None,
    track: progress.Progress,
) -> tuple[FeatureTable, Screening]:
    """Screen a segment once for all capture sets; the depth segment depends on each set."""
    if segment is Segment.DEPTH:
        return attribution.screen_segment(segment, training)
    if segment not in screenings:
        screenings[segment] = attribution.screen_segment(
            segment, training, cache=cache, track=track
        )
    table, screening = screenings[segment]
    return table.with_captures(training), screening


def _verdict(result: Attribution, *, seed: int) -> dict[str, Any]:
    """Return the content of a verdict file."""
    return {
        "verdict": result.kind,
        "effects": sorted(
            figures.effects(result.segments, result.evidence, result.howfar),
            key=lambda effect: -effect["gain"],
        ),
        "left": {
            segment.table.segment.value: {
                "before": segment.sizes[0],
                "after": segment.sizes[1],
                "beyond": segment.unexplained_size,
                "below": segment.explained_below,
            }
            for segment in result.segments
        },
        "howfar": figures.howfar(result.howfar),
        "versions": record.versions(),
        "baselines": _baselines(result.segments, seed=seed),
        "baselines_by_arm": {
            segment.table.segment.value: _baselines([segment], seed=seed)
            for segment in result.segments
        },
    }


def _scene_models(
    case: str,
    pairs: Sequence[tuple[CapturedScene, CapturedScene | None]],
    sensor: Sensor,
    previous: Sequence[SceneModel],
    references: Mapping[str, SceneObservation],
) -> list[SceneModel]:
    """Load the scenes of a capture set; their models are reused from the previous set."""
    if not previous:
        return [load_scene_model(scene, sensor, against=reference) for scene, reference in pairs]
    names, known = [scene.name for scene, _ in pairs], [model.name for model in previous]
    if names != known:
        rule = "must be the same in all capture sets"
        raise refuse("scenes", rule, (case, names), "Move the set to another folder.")
    models = [
        with_capture(model, scene, against=references.get(model.name))
        for model, (scene, _) in zip(previous, pairs, strict=True)
    ]
    repeats, known = [model.frames for model in models], [model.frames for model in previous]
    if repeats != known:
        rule = "must be equally many in all capture sets"
        raise refuse("repeats", rule, (case, repeats), f"Give {known}.")
    return models


def _estimated(models: Sequence[SceneModel]) -> bool:
    """Whether reflectance or light of a scene was estimated from its captures."""
    return any(model.estimates and model.against is None for model in models)


def _baselines(segments: Sequence[SegmentResult], *, seed: int) -> dict[str, str | None]:
    """Return the effects that simpler methods select."""
    each = [(segment.screening.signatures, segment.likelihood) for segment in segments]
    return {
        "largest_drop": baselines.largest_drop(each),
        "cosine": baselines.nearest_direction(each),
        "random": baselines.random_choice(each, seed=seed),
    }


def _left_out(path: Path) -> dict[str, str]:
    """Read a JSON file with an effect by capture set."""
    left_out = files.parse_json(files.read_bytes(path), path)
    if not (isinstance(left_out, dict) and all(isinstance(v, str) for v in left_out.values())):
        rule = "must be a JSON object"
        raise refuse(path.name, rule, left_out, "Give an effect by capture set.")
    return left_out
