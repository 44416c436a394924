"""Verbs of simulating: arguments in, one call, the result said; heavy imports inside verbs."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from starling.patterns.errors import refuse
from starling.sim.console import shell
from starling.sim.console.flags import Common, DevicePreset, Edits, Effects, Shared


def doctor(*, common: Shared = Common()) -> None:
    """Say what this machine can do: Mitsuba variant, LLVM, GPU, versions.

    Example: starling doctor
    """
    from starling.sim.render import backend

    shell.say(backend.report(), json=common.json)


def sensors(
    action: Positional[Literal["list", "show"]] = "list",
    name: Positional[str] = "",
    *,
    common: Shared = Common(),
) -> None:
    """List the sensor presets, or show one with the source of every number.

    Example: starling sensors show d435

    Args:
        action: `list` all presets or `show` one.
        name: the preset to show.
    """
    from starling.sim.sensor import presets as presets
    from starling.sim.sensor import structure

    if action == "list":
        shell.say(presets.summary(), json=common.json)
        return
    if not name:
        raise refuse("name", "must be given", "nothing", f"Known: {', '.join(presets.names())}.")
    sensor = presets.load(name)
    shell.say(structure.to_table(sensor), json=common.json, as_text=lambda _: presets.text(name))


def effects(
    action: Positional[Literal["list", "show"]] = "list",
    name: Positional[str] = "",
    *,
    sensor: str = "d435",
    common: Shared = Common(),
) -> None:
    """List what separates a real camera from an ideal one, or show one effect of the table.

    Example: starling effects show lens_blur --sensor d415

    Args:
        action: `list` all effects or `show` one.
        name: the effect to show.
        sensor: preset or sensor file whose own value is neutral where there is no ideal.
    """
    from starling.sim.effects import listing
    from starling.sim.sensor import presets as presets

    if action == "show" and not name:
        raise refuse("name", "must be given", "nothing", "See `starling effects`.")
    rows = listing.rows(presets.load(sensor), name)
    shell.say(rows, json=common.json, as_text=listing.text if action == "list" else listing.page)


def simulate(
    scene: Positional[str],
    *,
    sensor: str,
    out: Path,
    frames: int = 1,
    seed: int = 0,
    samples: int = 0,
    device_preset: DevicePreset = None,
    emitter: Literal["on", "off"] | None = None,
    effect: Effects = (),
    edits: Edits = (),
    force: bool = False,
    common: Shared = Common(),
) -> None:
    """Simulate what a depth camera sees of a scene; writes a capture set.

    Example: starling simulate clutter --sensor d435 --out out/clutter --set projector.power_w=0.2

    Args:
        scene: builtin scene (wall, staircase, tabletop, clutter, room), mesh (PLY, OBJ, GLB),
            Mitsuba XML, capture set or one scene in it.
        sensor: preset (see `starling sensors`) or sensor file (.toml).
        out: folder to make.
        frames: readings of each scene, each with noise of its own.
        seed: equal seeds give equal bits on one machine.
        samples: paths a coarse pixel of indirect light; 0 takes 16 where the scene or an effect
            has interreflection, and leaves indirect light out elsewhere.
        emitter: switch the projector on or off.
        force: replace a folder that starling wrote before.
    """
    from starling.sim.commands import simulate_captures
    from starling.sim.console import progress
    from starling.sim.effects import setting as setting
    from starling.sim.sensor import resolve as asked_sensor

    camera = asked_sensor.load(
        sensor,
        captures=scene,
        device_preset=device_preset,
        emitter=emitter,
        edits=edits,
        note=progress.note_on_stderr,
    )

    with progress.on_stderr() as track:
        result = simulate_captures.simulate_captures(
            scene,
            camera,
            out,
            frames=frames,
            seed=seed,
            samples=samples,
            effects=setting.parse(effect),
            force=force,
            asked={
                "sensor": sensor,
                "device_preset": device_preset,
                "emitter": emitter,
                "set": edits,
            },
            track=track,
        )
    shell.say(result, json=common.json)


def match(
    captures: Positional[str],
    *,
    sensor: str,
    setting: str | None = None,
    device_preset: DevicePreset = None,
    edits: Edits = (),
    out: Path | None = None,
    force: bool = False,
    common: Shared = Common(),
) -> None:
    """Match a capture's own infrared pair; compare with the device's depth and the truth.

    Example: starling match out/mine --sensor d415 --setting fast

    Args:
        captures: capture set or one scene in it.
        sensor: preset (see `starling sensors`) or sensor file (.toml) whose matcher is used.
        setting: stock setting of the matcher, instead of the sensor's: `fast` or `d4xx`.
        out: folder to write depth to.
        force: replace a folder that starling wrote before.
    """
    from starling.sim.commands import match_captures
    from starling.sim.console import progress
    from starling.sim.sensor import resolve as asked_sensor

    chosen = (f"matcher.setting={setting}",) if setting else ()
    camera = asked_sensor.load(
        sensor,
        captures=captures,
        device_preset=device_preset,
        edits=(*chosen, *edits),
        note=progress.note_on_stderr,
    )
    with progress.on_stderr() as track:
        result = match_captures.match_captures(
            captures,
            camera,
            out=out,
            force=force,
            asked={
                "sensor": sensor,
                "setting": setting,
                "device_preset": device_preset,
                "set": edits,
            },
            track=track,
        )
    shell.say(result, json=common.json)


def show(
    captures: Positional[str],
    against: Positional[str] = "",
    *,
    out: Path,
    frame: int = 0,
    force: bool = False,
    common: Shared = Common(),
) -> None:
    """Draw captures: infrared, depth, why depth is missing, error against truth.

    Example: starling show out/check out/check-simulated --out out/check.png

    Args:
        captures: capture set or one scene in it.
        against: a second one, drawn beside the first.
        out: NAME.png for one scene, a folder for several.
        frame: number of the frame.
        force: replace what was drawn before.
    """
    from starling.sim.commands import show_captures
    from starling.sim.console import progress

    with progress.on_stderr() as track:
        result = show_captures.show_captures(
            captures, out, against=against or None, frame=frame, force=force, track=track
        )
    shell.say(result, json=common.json)


def atlas(
    names: Positional[tuple[str, ...]] = (),
    *,
    out: Path,
    sensor: str = "d435",
    force: bool = False,
    common: Shared = Common(),
) -> None:
    """Draw what each effect of the table does: infrared, disparity error and holes; a page each.

    Example: starling atlas lens_blur laser_speckle --out out/atlas

    Args:
        names: effects to draw; all where none is named.
        out: folder to make.
        sensor: preset or sensor file to draw with.
        force: replace an atlas that starling drew before.
    """
    from starling.sim.commands import atlas as drawing
    from starling.sim.console import progress
    from starling.sim.sensor import resolve as asked_sensor

    with progress.on_stderr() as track:
        result = drawing.atlas(out, asked_sensor.load(sensor), names=names, force=force, track=track)
    shell.say(result, json=common.json)


def sweep(
    *,
    sensor: str = "d435",
    out: Path,
    baseline_m: tuple[float, ...] = (),
    focal_px: tuple[float, ...] = (),
    projector_x_m: tuple[float, ...] = (),
    dot_density: tuple[float, ...] = (),
    distance_m: tuple[float, ...] = (),
    full: bool = False,
    seed: int = 0,
    edits: Edits = (),
    force: bool = False,
    common: Shared = Common(),
) -> None:
    """Design a camera: depth noise beside its law and holes against distance, by parameters.

    Example: starling sweep --sensor d435 --baseline-m 0.02 0.1 --out out/sweep

    Args:
        sensor: stereo preset or sensor file that the cameras depart from, one axis at a time.
        out: folder to make: sweep.png, sweep.csv, sweep.json.
        baseline_m: baselines [m]. Where no axis is named, all are swept.
        focal_px: focal lengths [px] at the same image size.
        projector_x_m: places of the projector, right of the left imager [m].
        dot_density: dots in a solid angle over the pattern's own.
        distance_m: what the cameras look at [m]; 0.4 to 6 where none is given.
        full: all combinations of the values.
        seed: of the noise.
        force: replace a folder that starling wrote before.
    """
    from starling.sim.commands.sweep import sweep as sweeping
    from starling.sim.console import progress
    from starling.sim.sensor import resolve as asked_sensor

    camera = asked_sensor.load(sensor, edits=edits)
    axes = {"baseline_m": baseline_m, "focal_px": focal_px}
    axes |= {"projector_x_m": projector_x_m, "dot_density": dot_density}
    with progress.on_stderr() as track:
        result = sweeping.run(
            camera,
            axes,
            out,
            distances_m=distance_m,
            full=full,
            seed=seed,
            force=force,
            asked={"sensor": sensor, "set": edits},
            track=track,
        )
    shell.say(result, json=common.json)


def bench(*, common: Shared = Common()) -> None:
    """Time the whole pipeline against the bare floor: two renders and one matcher call.

    Example: starling bench --json
    """
    from starling.sim.commands import bench as benchmark
    from starling.sim.console import progress

    with progress.on_stderr() as track:
        result = benchmark.bench(track=track)
    shell.say(result, json=common.json)


VERBS = (
    doctor,
    sensors,
    effects,
    simulate,
    match,
    show,
    atlas,
    sweep,
    bench,
)
