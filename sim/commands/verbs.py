"""Command-line verbs of the simulator: parse arguments, make one call, print the result.

Heavy imports stand inside the verbs, so that `--help` is quick.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from tyro.conf import Positional

from starling.patterns.errors import refuse
from starling.sim.console import shell
from starling.sim.console.flags import (
    CameraMatrix,
    Common,
    DevicePreset,
    Edits,
    Effects,
    ModeName,
    Shared,
    ViewFlags,
    Views,
)


def doctor(*, common: Shared = Common()) -> None:
    """Report what this machine supports: Mitsuba variant, LLVM, GPU, package versions.

    Example: starling doctor
    """
    from starling.sim.render import backend

    shell.say(backend.report(), json=common.json)


def effects(
    action: Positional[Literal["list", "show"]] = "list",
    name: Positional[str] = "",
    *,
    sensor: str = "d435",
    mode: ModeName = "",
    common: Shared = Common(),
) -> None:
    """List the effects that separate a real camera from an ideal one, or show one of them.

    Example: starling effects show lens_blur --sensor d415

    Args:
        action: `list` all effects, or `show` one.
        name: Effect to show.
        sensor: Preset or sensor file (.toml), whose values are listed.
            They are also the neutral values of parameters that have no ideal value.
    """
    from starling.sim.effects import listing
    from starling.sim.sensor import presets

    if action == "show" and not name:
        raise refuse("name", "must be given", "nothing", "See `starling effects`.")
    rows = listing.rows(presets.load(sensor, mode=mode), name)
    shell.say(rows, json=common.json, as_text=listing.text if action == "list" else listing.page)


def simulate(
    scene: Positional[str],
    further: Positional[tuple[str, ...]] = (),
    *,
    sensor: str,
    mode: ModeName = "",
    out: Path,
    frames: int = 1,
    seed: int = 0,
    samples: int = 0,
    quality: Literal["full", "draft"] = "full",
    device_preset: DevicePreset = None,
    emitter: Literal["on", "off"] | None = None,
    effect: Effects = (),
    edits: Edits = (),
    view: Views = ViewFlags(),
    camera_matrix: CameraMatrix = None,
    depth_unit: str = "",
    rgb: Path | None = None,
    own_camera: bool = False,
    empty: bool = False,
    force: bool = False,
    common: Shared = Common(),
) -> None:
    """Simulate infrared images and depth of scenes, and write them as a capture set.

    With --camera-matrix the scene is a clean depth image, or a folder of them.

    Example: starling simulate clutter --sensor d435 --out out/clutter --set projector.power_w=0.2

    Example: starling simulate clutter:1 clutter:2 clutter:3 --sensor d435 --out out/rooms

    Args:
        scene: Builtin scene (wall, staircase, tabletop, clutter, room), or a path. A number after
            a colon is the distance of wall and staircase; others draw another scene: clutter:3.
            Files: mesh (GLB, OBJ, PLY, STL, DAE, USD), Mitsuba XML, model of MuJoCo, URDF, TOML of
            a scene. Folders: capture set, or one scene of a capture set.
            With --camera-matrix: a depth image (.npy, .png, .exr) or a folder of them.
        further: More builtin scenes or files of the set. Each is a room of its own.
        sensor: Preset (see `starling sensors`) or sensor file (.toml).
        out: Folder to create.
        frames: Frames per scene. Each frame has independent noise.
        seed: Seed of the noise. Equal seeds give bit-identical output on one machine.
        samples: Paths per coarse pixel for indirect light.
            0 uses 16 if the scene or an effect has interreflection, and none otherwise.
        quality: `draft` renders one position a pixel in place of four.
        emitter: Switch the projector on or off. By default it is as in the sensor.
        depth_unit: Unit of depth images: m, mm, or the step of their values [m].
            By default floating-point numbers are metres and whole numbers millimetres.
        rgb: Colour picture of a depth image, or folder of them, as a hint of its reflectance.
        own_camera: Keep the camera of the depth images in place of the sensor's.
        empty: Allow a scene, or depth images, without a surface in view.
        force: Replace a folder that starling wrote earlier.
    """
    from starling.sim.captures import depth_file
    from starling.sim.commands import simulate_captures
    from starling.sim.console import progress
    from starling.sim.effects import setting
    from starling.sim.scene import placing, pose_file
    from starling.sim.sensor import resolve
    from starling.sim.sensor.edits import OF_CAMERA, path_of

    device_file = None
    if isinstance(camera_matrix, Path) and not depth_file.files(Path(scene)):
        device_file, camera_matrix = camera_matrix, None
    camera = resolve.load(
        sensor,
        mode=mode,
        camera_matrix=device_file,
        captures=scene,
        device_preset=device_preset,
        emitter=emitter,
        edits=edits,
        note=progress.note_on_stderr,
    )

    strengths = setting.parse(effect)
    setting.warn_of_edits(strengths, map(path_of, edits))
    options: dict[str, Any] = {
        "sensor": sensor,
        "mode": mode,
        "device_preset": device_preset,
        "emitter": emitter,
        "set": edits,
    }
    if device_file is not None:
        options["camera_matrix"] = str(device_file)
    if camera_matrix is not None:
        if further:
            rule = "must be one file or folder of depth images"
            raise refuse("scene", rule, 1 + len(further), "Put the images into one folder.")
        if view.given():
            rule = "must not be given with depth images"
            raise refuse(", ".join(view.given()), rule, view.given(), "They are for scenes.")
        if samples or quality != "full":
            rule = "must not be given with depth images"
            got = f"samples {samples}, quality {quality}"
            raise refuse("samples, quality", rule, got, "They are for scenes: leave them out.")
        from starling.sim.commands import corrupt_captures

        camera_matrix = corrupt_captures.intrinsics_of(camera_matrix, Path(scene), depth_unit)
        replaced = [each for each in edits if path_of(each) in OF_CAMERA]
        if own_camera and replaced:
            rule = "must not change the camera that --own-camera replaces"
            raise refuse("set", rule, replaced[0], "Leave one of the two out.")

        with progress.on_stderr() as track:
            result = corrupt_captures.corrupt_captures(
                Path(scene),
                camera,
                out,
                camera_matrix=camera_matrix,
                unit=depth_unit,
                rgb=rgb,
                own_camera=own_camera,
                frames=frames,
                seed=seed,
                effects=strengths,
                empty=empty,
                force=force,
                options={
                    **options,
                    "camera_matrix": camera_matrix,
                    "depth_unit": depth_unit,
                    "rgb": None if rgb is None else str(rgb),
                    "own_camera": own_camera,
                },
                track=track,
            )
        shell.say(result, json=common.json)
        return
    if depth_unit or rgb or own_camera or Path(scene).suffix.lower() in depth_file.SUFFIXES:
        rule = "must be given with depth images"
        raise refuse("camera-matrix", rule, "nothing", "Give FX FY CX CY in pixels.")
    with progress.on_stderr() as track:
        result = simulate_captures.simulate_captures(
            scene,
            camera,
            out,
            further=further,
            frames=frames,
            seed=seed,
            samples=samples,
            quality=quality,
            effects=strengths,
            empty=empty,
            force=force,
            views=pose_file.views(view.pose, view.look_at),
            frame=placing.Placing(
                up=view.up,
                unit=view.unit,
                camera=view.camera,
                keyframe=view.keyframe,
                qpos=None if view.qpos is None else str(view.qpos),
            ),
            options={**options, **view.given()},
            track=track,
        )
    shell.say(result, json=common.json)


def match(
    captures: Positional[str],
    *,
    sensor: str,
    mode: ModeName = "",
    setting: str | None = None,
    device_preset: DevicePreset = None,
    edits: Edits = (),
    out: Path | None = None,
    force: bool = False,
    common: Shared = Common(),
) -> None:
    """Match captured infrared pairs; compare with the device's depth and the reference depth.

    Example: starling match out/mine --sensor d415 --setting fast

    Args:
        captures: Capture set, or one scene of it.
        sensor: Preset (see `starling sensors`) or sensor file (.toml) whose matcher is used.
        setting: Matcher setting that replaces the sensor's own: `fast` or `d4xx`.
        out: Folder to create for the computed depth. Without it no files are written.
        force: Replace a folder that starling wrote earlier.
    """
    from starling.sim.commands import match_captures
    from starling.sim.console import progress
    from starling.sim.sensor import resolve

    chosen = (f"matcher.setting={setting}",) if setting else ()
    camera = resolve.load(
        sensor,
        mode=mode,
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
            options={
                "sensor": sensor,
                "mode": mode,
                "setting": setting,
                "device_preset": device_preset,
                "set": edits,
            },
            track=track,
        )
    shell.say(result, json=common.json)


def atlas(
    names: Positional[tuple[str, ...]] = (),
    *,
    out: Path,
    sensor: str = "d435",
    mode: ModeName = "",
    force: bool = False,
    common: Shared = Common(),
) -> None:
    """Draw what each effect changes, one page per effect: infrared, disparity error, holes.

    Example: starling atlas lens_blur laser_speckle --out out/atlas

    Args:
        names: Effects to draw. By default all are drawn.
        out: Folder to create.
        sensor: Preset or sensor file (.toml) to draw with.
        force: Replace an atlas that starling wrote earlier.
    """
    from starling.sim.commands import atlas as drawing
    from starling.sim.console import progress
    from starling.sim.sensor import resolve

    camera = resolve.load(sensor, mode=mode, note=progress.note_on_stderr)
    with progress.on_stderr() as track:
        result = drawing.atlas(out, camera, names=names, force=force, track=track)
    shell.say(result, json=common.json)


def sweep(
    *,
    sensor: str = "d435",
    mode: ModeName = "",
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
    """Compare camera designs: depth noise, its theoretical law, and holes against distance.

    Example: starling sweep --sensor d435 --baseline-m 0.02 0.1 --out out/sweep

    Args:
        sensor: Base camera: stereo preset or sensor file (.toml).
            Each further camera differs from it in one axis.
        out: Folder to create for sweep.png, sweep.csv and sweep.json.
        baseline_m: Baselines [m]. If no axis is given, all axes are swept with default values.
        focal_px: Focal lengths [px] at the same image size.
        projector_x_m: Projector positions to the right of the left imager [m].
        dot_density: Dots per solid angle, relative to the base camera's pattern.
        distance_m: Distances of the scene [m]. By default eight from 0.4 to 6.
        full: Simulate all combinations of the values instead of one axis at a time.
        seed: Seed of the noise.
        force: Replace a folder that starling wrote earlier.
    """
    from starling.sim.commands.sweep import sweep as sweeping
    from starling.sim.console import progress
    from starling.sim.sensor import resolve

    camera = resolve.load(sensor, mode=mode, edits=edits, note=progress.note_on_stderr)
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
            options={"sensor": sensor, "mode": mode, "set": edits},
            track=track,
        )
    shell.say(result, json=common.json)


def bench(*, common: Shared = Common()) -> None:
    """Time the pipeline against its baseline: two bare renders and one bare matcher call.

    Example: starling bench --json
    """
    from starling.sim.commands import bench as benchmark
    from starling.sim.console import progress

    with progress.on_stderr() as track:
        result = benchmark.bench(track=track)
    shell.say(result, json=common.json)
