"""Verbs of learning, and of `compare` (see `starling.sim.commands.verbs`)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import Positional, arg

from starling.patterns.errors import needs, refuse
from starling.sim.console import shell
from starling.sim.console.flags import Common, Edits, ModeName, Shared

if TYPE_CHECKING:
    from starling.learning.data.captured import Simulation

ROOM = "{room}"  # Placeholder of the held-out room in a sensor's name.
Kind = Literal["depth", "holes", "infrared"]  # What the judge sees.
Draws = Annotated[int, arg(help="Simulated draws of noise and speckle for the physics.")]
Even = Annotated[bool, arg(help="Simulate with a uniform reflectance, without the captured image.")]
Cache = Annotated[Path | None, arg(help="Folder for simulations, reused by other runs.")]


def train(
    method: Positional[str],
    captures: Positional[str],
    *,
    out: Path,
    sensor: str | None = None,
    mode: ModeName = "",
    rooms: tuple[str, ...] | None = None,
    steps: int | None = None,
    start: Path | None = None,
    draws: Draws = 8,
    even: Even = False,
    cache: Cache = None,
    seed: int = 0,
    edits: Edits = (),
    force: bool = False,
    common: Shared = Common(),
) -> None:
    """Train a prediction of where a real camera has no depth. Interrupted training continues.

    Methods: perfect, simple, trees, physics, physics_recalibrated, network, hybrid, hybrid_trees,
    pix2pix, cyclegan; trees_reflectance, network_reflectance and hybrid_reflectance also use the
    smoothed infrared image.

    Example: starling train hybrid out/real --sensor d435 --out out/hybrid

    To fill depth instead: `starling train completion`.

    Args:
        method: method to train.
        captures: capture set with the device's depth (depth.png) and reference depth (truth.png).
            Without truth.png it is estimated from depth.png, with a warning.
        out: folder for model, checkpoint and loss curve.
        sensor: preset or sensor file, for the methods that use physics.
        rooms: training rooms; all if not given.
        steps: training steps of a network; its default if not given.
        start: trained network or hybrid as initial weights, for few scenes: its folder, or
            hybrid-varied, network-varied, which were trained on simulated cameras.
        seed: seed of all random draws.
        force: delete earlier results of starling in the folder.
    """
    from starling.learning.commands import train_captures
    from starling.sim.console import progress

    simulation = None
    if sensor is not None:
        simulation = _simulation(
            sensor, captures, mode=mode, draws=draws, seed=seed, even=even, edits=edits, cache=cache
        )
    with progress.on_stderr() as track:
        result = train_captures.train_captures(
            method,
            captures,
            out,
            simulation=simulation,
            rooms=rooms,
            steps=steps,
            start=start,
            seed=seed,
            force=force,
            options={"sensor": sensor, "mode": mode, "draws": draws, "even": even, "set": edits},
            track=track,
        )
    shell.say(result, json=common.json)


def evaluate(
    captures: Positional[str],
    *,
    out: Path,
    methods: tuple[str, ...] = (),
    models: tuple[Path, ...] = (),
    sensor: str | None = None,
    mode: ModeName = "",
    rooms: tuple[str, ...] | None = None,
    heldout: str | None = None,
    learn_from: int | None = None,
    steps: int | None = None,
    start: tuple[Path, ...] = (),
    icp: int = 0,
    judge: bool = False,
    judges: int = 1,
    draws: Draws = 8,
    even: Even = False,
    cache: Cache = None,
    seed: int = 0,
    edits: Edits = (),
    force: bool = False,
    common: Shared = Common(),
) -> None:
    """Evaluate methods on held-out rooms. An interrupted evaluation continues.

    Example: starling evaluate out/real --methods trees network --out out/evaluation

    To fill depth instead: `starling evaluate completion`.

    Args:
        captures: capture set with the device's depth (depth.png) and reference depth (truth.png).
            Without truth.png it is estimated from depth.png, with a warning.
        out: folder for figures, pictures, and models and predictions of each fold.
        methods: trained for each held-out room on the other rooms.
        models: folders of `starling train`, or the shipped hybrid-varied, network-varied; evaluated
            without training, on any data they were trained on.
        sensor: preset or sensor file, for the methods that use physics. `{room}` in its name
            stands in for the held-out room. The sensor can then be calibrated without it.
        rooms: held-out rooms; all if not given.
        heldout: another capture set with the held-out rooms. Methods are trained once, on all rooms
            of the first.
        learn_from: number of training rooms, the next ones in order; all others if not given.
        steps: training steps of a network; its default if not given.
        start: trained models as initial weights of the same methods (see `starling train`).
        icp: align objects by ICP in the device's depth and in each method's, with this number of
            trials per object, 2 or more; 0 omits it.
        judge: let networks separate each method's drawn holes from the device's, by room, three or
            more; 0.5 means indistinguishable (see `starling compare --judge`).
        judges: number of judges, as for `starling compare`.
        seed: seed of all random draws.
        force: delete earlier results of starling in the folder.
    """
    from starling.learning.commands import evaluate_captures
    from starling.sim.console import progress

    _refuse_judges_alone(judges, judge=judge)

    def simulate_as(held: str, seen: str) -> Simulation:
        assert sensor is not None  # Called only with a sensor.
        camera = sensor.replace(ROOM, held)
        return _simulation(
            camera, seen, mode=mode, draws=draws, seed=seed, even=even, edits=edits, cache=cache
        )

    plan = evaluate_captures.EvaluationPlan(
        methods=methods,
        models=models,
        held=rooms,
        heldout=heldout,
        learn_from=learn_from,
        steps=steps,
        start=start,
        icp=icp,
        judge=judge,
        judges=judges,
        seed=seed,
    )
    with progress.on_stderr() as track:
        result = evaluate_captures.evaluate_captures(
            captures,
            out,
            plan,
            simulations=(lambda held: simulate_as(held, captures)) if sensor else None,
            heldout_simulations=(lambda held: simulate_as(held, heldout or captures))
            if sensor
            else None,
            force=force,
            options={"sensor": sensor, "mode": mode, "draws": draws, "even": even, "set": edits},
            track=track,
        )
    shell.say(result, json=common.json)


def compare(
    real: Positional[str],
    sim: Positional[str] = "",
    *,
    methods: tuple[str, ...] = (),
    sensor: str | None = None,
    mode: ModeName = "",
    out: Path | None = None,
    judge: bool = False,
    judge_kinds: tuple[Kind, ...] = ("depth", "holes", "infrared"),
    judges: int = 1,
    draws: Draws = 8,
    cache: Cache = None,
    seed: int = 0,
    edits: Edits = (),
    force: bool = False,
    common: Shared = Common(),
) -> None:
    """Compare simulated captures with real ones, or the holes drawn by several methods.

    Example: starling compare out/check out/check-simulated --json

    Example: starling compare out/real out/simulated --judge --out out/judged

    Example: starling compare out/real --methods physics out/hybrid --sensor d435
    --out out/methods.png

    Args:
        real: capture set or one scene in it.
        sim: the same scenes, simulated.
        methods: instead of `sim`: perfect, physics, folders of `starling train`, or the shipped
            hybrid-varied, network-varied.
        sensor: preset or sensor file, for the methods that use physics.
        out: NAME.png for the depth images of the device and of the methods; with `judge`, a folder
            for figures, scores by place and the windows that convict most.
        judge: also train networks to separate simulated windows from real ones. Their AUC in rooms
            that they did not learn from is reported; 0.5 = indistinguishable.
        judge_kinds: what the networks see: depth with holes, holes alone, infrared pairs.
        judges: number of judges, whose mean scores count. The AUC of one varies with its seed by
            0.01 to 0.05; that of five was larger.
        seed: seed of the drawn holes, and of the judge.
        force: replace earlier results.
    """
    from starling.sim.captures import capture
    from starling.sim.console import output, progress

    if bool(sim) == bool(methods):
        got = "both" if sim else "neither"
        rule = "must be one of the two"
        raise refuse("sim and methods", rule, got, "Give simulated captures, or --methods.")
    _refuse_judges_alone(judges, judge=judge)
    if methods and judge:
        raise refuse("judge", "must come with simulated captures", "methods", "Give one of them.")
    if sim and out is not None and not judge:
        advice = "`starling show` draws two captures."
        raise refuse("out", "must come with methods or judge", out, advice)
    if not methods:
        result = _compare_sets(
            real, sim, judge_kinds if judge else (), out, judges=judges, seed=seed, force=force
        )
        shell.say(result, json=common.json)
        return
    from starling.learning.commands import compare_methods

    if out is not None:
        output.refuse_taken(out, force=force)
    simulation = None
    if sensor is not None:
        simulation = _simulation(
            sensor, real, mode=mode, draws=draws, seed=seed, edits=edits, cache=cache
        )
    with progress.on_stderr() as track:
        result, picture = compare_methods.compare_methods(
            capture.open_set(real),
            compare_methods.predictors(methods),
            simulation=simulation,
            seed=seed,
            track=track,
        )
    if out is not None:
        output.write_file(out, picture, force=force)
    shell.say(result, json=common.json)


def _refuse_judges_alone(judges: int, *, judge: bool) -> None:
    if judges != 1 and not judge:
        raise refuse("judges", "must come with judge", judges, "Add --judge.")


def _compare_sets(
    real: str,
    sim: str,
    kinds: Sequence[str],
    out: Path | None,
    *,
    judges: int,
    seed: int,
    force: bool,
) -> dict[str, Any]:
    """Compare two sets, and judge them by networks if kinds are given."""
    from starling.sim.captures import capture
    from starling.sim.commands import compare as comparison
    from starling.sim.console import progress

    sets = capture.open_set(real), capture.open_set(sim)
    with progress.on_stderr() as track:
        if not kinds:
            return comparison.compare(*sets, track=track)
        try:
            from starling.learning.commands import judge_captures
        except ModuleNotFoundError as error:
            raise needs("judge", str(error.name), "learning") from error
        return judge_captures.compare_and_judge(
            *sets, kinds, out, judges=judges, seed=seed, force=force, track=track
        )


def _simulation(
    sensor: str,
    captures: str,
    *,
    mode: str,
    draws: int,
    seed: int,
    edits: tuple[str, ...],
    even: bool = False,
    cache: Path | None = None,
) -> Simulation:
    from starling.learning.data.captured import Simulation
    from starling.sim.console import progress
    from starling.sim.sensor import resolve

    camera = resolve.load(
        sensor, mode=mode, captures=captures, edits=edits, note=progress.note_on_stderr
    )
    return Simulation(sensor=camera, draws=draws, seed=seed, even=even, cache=cache)
