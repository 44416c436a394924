"""Physically based active-stereo depth cameras, simulated from the light up.

Everything that a first program needs is on this page. The packages behind it (`starling.patterns`,
`starling.sim`, `starling.calibration`, `starling.learning`, `starling.diagnosis`) load on use.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

from starling.calibration import MOST_SCENES as _MOST_SCENES

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import ArrayLike, NDArray

    from starling.calibration.fit_sensor import Calibration as Calibration
    from starling.diagnosis.diagnosis import Diagnosis as Diagnosis
    from starling.learning.completion.method import Completed as Completed
    from starling.learning.residual import LearnedHoles
    from starling.patterns.errors import InputError as InputError
    from starling.patterns.pattern import Pattern as Pattern
    from starling.sim.batch.batch_reading import BatchReading as BatchReading
    from starling.sim.captures.capture import CapturedScene as CapturedScene
    from starling.sim.captures.capture import CaptureSet as CaptureSet
    from starling.sim.corrupt import Corruptor as Corruptor
    from starling.sim.effects.effect import Value
    from starling.sim.reading import Reading as Reading
    from starling.sim.reason import Reason as Reason
    from starling.sim.scene.scene import Scene as Scene
    from starling.sim.sensor.sensor import Sensor as Sensor
    from starling.sim.simulate import Quality
    from starling.sim.simulate import Shot as Shot
    from starling.sim.stereo.depth import DepthMap as DepthMap
    from starling.sim.stereo.post.temporal import History

__version__ = "0.2.0"

_CLASSES = {  # Name to the module that defines it; loaded on first use.
    "BatchReading": "starling.sim.batch.batch_reading",
    "Calibration": "starling.calibration.fit_sensor",
    "CaptureSet": "starling.sim.captures.capture",
    "CapturedScene": "starling.sim.captures.capture",
    "Completed": "starling.learning.completion.method",
    "Corruptor": "starling.sim.corrupt",
    "DepthMap": "starling.sim.stereo.depth",
    "Diagnosis": "starling.diagnosis.diagnosis",
    "InputError": "starling.patterns.errors",
    "Pattern": "starling.patterns.pattern",
    "Reading": "starling.sim.reading",
    "Reason": "starling.sim.reason",
    "Scene": "starling.sim.scene.scene",
    "Sensor": "starling.sim.sensor.sensor",
    "Shot": "starling.sim.simulate",
}
_PACKAGES = ("calibration", "diagnosis", "learning", "patterns", "sim")
__all__ = [
    "BatchReading",
    "Calibration",
    "CaptureSet",
    "CapturedScene",
    "Completed",
    "Corruptor",
    "DepthMap",
    "Diagnosis",
    "InputError",
    "Pattern",
    "Reading",
    "Reason",
    "Scene",
    "Sensor",
    "Shot",
    "apply_effects",
    "calibrate",
    "compare",
    "complete",
    "corrupt",
    "depth_from_range",
    "depth_from_zbuffer",
    "diagnose",
    "draw",
    "from_opengl",
    "from_ros",
    "generate",
    "import_recording",
    "list_effects",
    "list_sensors",
    "load_residual",
    "load_scene",
    "load_sensor",
    "match",
    "open_captures",
    "simulate",
    "simulate_captures",
    "verify",
]


def list_sensors() -> list[str]:
    """Return the names of the sensor presets.

    Examples:
        >>> starling.list_sensors()
        ['astra', 'carmine-1.08', ..., 'xtion', 'zed-2i', 'zed-mini']
    """
    from starling.sim.sensor import presets

    return presets.names()


def load_sensor(
    name: Path | str,
    *,
    edits: Iterable[str] = (),
    mode: str = "",
    camera_matrix: NDArray[Any] | Path | str | None = None,
    size: tuple[int, int] = (640, 480),
) -> Sensor:
    """Load a sensor preset by name, or a sensor file by path, and edit fields of it.

    Args:
        name: preset (see `list_sensors`) or path of a `.toml` file.
        edits: `PATH=VALUE` each, e.g. `projector.power_w=0.2`; `imager.` means both imagers.
        mode: mode of the camera, `640x480` or `640x480@60`, as `starling sensors show` lists them.
        camera_matrix: (3, 3) intrinsics in place of the device's [px]; its lens stays, so that
            pixels grow or shrink. Or a file of a device's calibration: output of
            rs-enumerate-devices -c, a ROS camera_info, a board or calibration file
            of depthai.
        size: (width, height) of its images [px]; used with a (3, 3) `camera_matrix`.

    Raises:
        InputError: unknown preset, unreadable file, unknown mode or field, or refused value.

    Examples:
        >>> sensor = starling.load_sensor("d435", edits=["projector.power_w=0.2"])
        >>> sensor.baseline_m, sensor.projector.power_w
        (0.05015, 0.2)
        >>> starling.load_sensor("d435", mode="1280x720").width
        1280
    """
    from os import PathLike

    from starling import arguments
    from starling.patterns import errors
    from starling.sim.sensor import presets
    from starling.sim.sensor.edits import apply, with_camera

    name = arguments.text("name", name, "Give a preset or a sensor file.")
    changes = errors.texts("edits", edits, "Give a list: ['projector.power_w=0.2'].")
    mode = errors.instance("mode", mode, str, "Example: 640x480@60.")
    if isinstance(camera_matrix, (str, PathLike)):
        file = arguments.path("camera_matrix", camera_matrix)
        sensor = presets.load_file(name, mode=mode, camera_matrix=file).sensor
        return apply(sensor, changes)
    sensor = presets.load(name, mode=mode)
    if camera_matrix is not None:
        sensor = with_camera(sensor, camera_matrix, size)
    return apply(sensor, changes)


def load_scene(
    specifier: Path | str,
    sensor: Sensor,
    *,
    pose: NDArray[Any] | Path | str | None = None,
    look_at: Sequence[float] | None = None,
    up: str | None = None,
    unit: str | None = None,
    camera: str | None = None,
    keyframe: str | None = None,
) -> Scene:
    """Load a scene.

    Args:
        specifier: builtin scene, file, or one scene of a capture set. Files: mesh (GLB, OBJ, PLY,
            STL, DAE, USD), Mitsuba XML, model of MuJoCo, URDF, TOML of a scene. Builtin: `wall`,
            `staircase`, `tabletop`, `clutter`, `room`; a number may follow a colon (`room:3`).
        sensor: sensor that will see the scene; it sets the viewpoint.
        pose: (4, 4) `world_from_camera` of the left imager in the frame of the scene's file, in
            OpenCV's axes [m], or a file with one pose.
        look_at: position of the camera and the point in its centre, six numbers [m].
        up: axis of a mesh file that points up: `x`, `y` or `z`; by default as the file says.
        unit: unit of a mesh file: `m`, `cm`, `mm` or `in`; by default as the file says.
        camera: camera of a MuJoCo model that becomes the left imager.
        keyframe: keyframe of a MuJoCo model; by default its reference state.

    Raises:
        InputError: unknown or unreadable scene, a pose that is not rigid, unknown axis or unit.

    Examples:
        >>> scene = starling.load_scene("wall:2", starling.load_sensor("d435"))
        >>> len(scene.bodies)
        1
        >>> above = starling.load_scene("room", starling.load_sensor("d435"), pose=np.eye(4))
        >>> above.world_from_left[:3, 3].tolist()
        [0.0, 0.0, 0.0]
    """
    from starling import arguments
    from starling.sim.scene import sources
    from starling.sim.scene.placing import Placing
    from starling.sim.sensor import presets

    name = arguments.text("specifier", specifier, "Give a name or a file.")
    view = arguments.viewpoint(pose, look_at)
    frame = Placing(up=up, unit=unit, camera=camera, keyframe=keyframe)
    return sources.load(name, presets.loaded(sensor), frame, view)


def list_effects() -> list[str]:
    """Return the names of all effects: departures of a real camera from an ideal one.

    Examples:
        >>> "lens_blur" in starling.list_effects()
        True
    """
    from starling.sim.effects import table

    return [effect.name for effect in table()]


def apply_effects(
    sensor: Sensor, scene: Scene, effects: Mapping[str, Value]
) -> tuple[Sensor, Scene]:
    """Return sensor and scene with effects set to given strengths.

    Args:
        sensor: sensor to change.
        scene: scene to change.
        effects: strength by `NAME` or `NAME.PARAMETER`; `starling effects` lists them.

    Raises:
        InputError: unknown effect, or a strength out of range.

    Examples:
        >>> sensor = starling.load_sensor("d435")
        >>> scene = starling.load_scene("wall", sensor)
        >>> blurred, scene = starling.apply_effects(sensor, scene, {"lens_blur": 0.8})
        >>> blurred.left.lens.blur_px
        0.8
    """
    from starling.patterns.errors import instance
    from starling.sim.effects import setting
    from starling.sim.scene.scene import Scene
    from starling.sim.sensor import presets

    stage = instance("scene", scene, Scene, "Load it: starling.load_scene(NAME, SENSOR).")
    return setting.apply(presets.loaded(sensor), stage, effects)


def simulate(
    scene: Scene | Path | str,
    sensor: Sensor | Path | str,
    *,
    seed: int = 0,
    frame: int = 0,
    samples: int = 16,
    quality: Quality = "full",
) -> Shot:
    """Simulate one reading of a depth camera: infrared pair, depth, and why depth is missing.

    Args:
        scene: scene, or its specifier as for `load_scene`.
        sensor: sensor, or its name as for `load_sensor`.
        seed: seed of all noise; equal seeds give equal bits on one machine.
        frame: number of the frame; each frame has noise of its own.
        samples: paths a coarse pixel of indirect light, where the scene has interreflection.
        quality: `draft` renders one position a pixel in place of four.

    Raises:
        InputError: unknown scene or sensor, or a sensor that one frame cannot serve.

    Examples:
        >>> shot = starling.simulate("wall", "d435", seed=1)
        >>> shot.depth.depth_m.shape
        (480, 848)
        >>> bool((shot.depth.valid == (shot.depth.reason == starling.Reason.VALID)).all())
        True
    """
    from starling import arguments
    from starling.sim.sensor import presets
    from starling.sim.simulate import simulate

    camera = presets.resolved(sensor)
    stage = arguments.scene(scene, camera)
    return simulate(stage, camera, seed=seed, frame=frame, samples=samples, quality=quality)


def corrupt(
    depth_m: NDArray[Any],
    camera_matrix: NDArray[Any],
    sensor: Sensor | Path | str = "d435",
    *,
    reflectance: float | NDArray[Any] | None = None,
    ambient_lux: float | None = None,
    up: ArrayLike | None = None,
    right_depth_m: NDArray[Any] | None = None,
    projector_depth_m: NDArray[Any] | None = None,
    seed: int = 0,
    frame: int = 0,
    past: History | None = None,
    effects: Mapping[str, Value] | None = None,
    residual: Path | str | None = None,
) -> Reading:
    """Turn a clean depth image of any simulator into a reading of a depth camera.

    The sensor stands where the depth image was rendered. In a loop make a `Corruptor` once.

    Args:
        depth_m: (h, w) depth along the optical axis [m]; 0, NaN or infinity without a surface.
        camera_matrix: (3, 3) intrinsics of the depth image [px].
        sensor: depth camera to imitate, or its name as for `load_sensor`.
        reflectance: of the surfaces in the sensor's band, a number or image (h, w) from 0 to 1.
            RGB bytes (h, w, 3) are a hint: 0.25 + 0.6 max(R, G, B), or the luminance if the sensor
            sees visible light. 0.5 if None.
        ambient_lux: daylight on the surfaces [lux]; an indoor level if None.
        up: (3,) direction of the zenith in the camera's axes (x right, y down, z forward), from
            which more ambient light comes. None: equal from all directions.
        right_depth_m: (h, w) depth seen from `Corruptor.left_from_right`, with the matrix of
            `depth_m`; warped if None.
        projector_depth_m: same, seen from `Corruptor.left_from_projector`.
        seed: seed of all noise; equal seeds give equal bits on one machine.
        frame: number of the frame; each frame has noise of its own.
        past: `history` of the frame before, for a temporal filter; None at first.
        effects: strengths as for `apply_effects`; none if None.
        residual: model as for `load_residual`; none if None.

    Returns:
        Images in the sensor's own camera; load it with `camera_matrix` for that of the input.

    Raises:
        InputError: depth that is not in metres, no camera matrix, images of different size, or an
            effect that needs hidden surfaces.

    Examples:
        >>> camera_matrix = np.array([[600.0, 0, 319.5], [0, 600.0, 239.5], [0, 0, 1]])
        >>> sensor = starling.load_sensor("d435", camera_matrix=camera_matrix, size=(640, 480))
        >>> depth_m = np.full((480, 640), 1.2, np.float32)
        >>> reading = starling.corrupt(depth_m, camera_matrix, sensor)
        >>> reading.depth_m.shape, reading.depth_u16.dtype
        ((480, 640), dtype('uint16'))
    """
    from starling import arguments
    from starling.sim.corrupt import Corruptor

    advice = "Give its name or its folder."
    name = None if residual is None else arguments.text("residual", residual, advice)
    model = None if name is None else load_residual(name)
    return Corruptor(sensor, camera_matrix, effects=effects, residual=model)(
        depth_m,
        reflectance=reflectance,
        ambient_lux=ambient_lux,
        up=up,
        right_depth_m=right_depth_m,
        projector_depth_m=projector_depth_m,
        seed=seed,
        frame=frame,
        past=past,
    )


def load_residual(model: Path | str = "hybrid") -> LearnedHoles:
    """Load a model of pixels without depth that the physics misses, for a `Corruptor`.

    Args:
        model: `hybrid`, the shipped model for 640x360, or a folder of `starling train`.

    Raises:
        InputError: if there is no such model.

    Examples:
        >>> camera_matrix = np.array([[600.0, 0, 319.5], [0, 600.0, 179.5], [0, 0, 1]])
        >>> sensor = starling.load_sensor("d435", camera_matrix=camera_matrix, size=(640, 360))
        >>> residual = starling.load_residual("hybrid")
        >>> camera = starling.Corruptor(sensor, camera_matrix, residual=residual)
        >>> reading = camera(np.full((360, 640), 1.2, np.float32))
    """
    from starling import arguments
    from starling.learning import residual

    return residual.load(arguments.text("model", model, "Give its name or its folder."))


def depth_from_zbuffer(zbuffer: NDArray[Any], near_m: float, far_m: float) -> NDArray[Any]:
    """Depth [m] (h, w) from an OpenGL depth buffer; NaN at the far plane.

    Args:
        zbuffer: (h, w) window depth, 0 at the near and 1 at the far plane. Of a reversed buffer
            give `1 - zbuffer`.
        near_m: distance of the near plane [m].
        far_m: distance of the far plane [m].

    Raises:
        InputError: values outside [0, 1], or planes in the wrong order.

    Examples:
        >>> starling.depth_from_zbuffer(np.array([[0.0, 0.5, 1.0]]), 0.5, 1.5).tolist()
        [[0.5, 0.75, nan]]
    """
    from starling.sim.warp import conversions

    return conversions.depth_from_zbuffer(zbuffer, near_m, far_m)


def depth_from_range(range_m: NDArray[Any], camera_matrix: NDArray[Any]) -> NDArray[Any]:
    """Depth along the optical axis [m] (h, w) from distances along each pixel's ray.

    Args:
        range_m: (h, w) distance from the camera's centre [m].
        camera_matrix: (3, 3) intrinsics [px].

    Raises:
        InputError: an image of another shape, or no camera matrix.

    Examples:
        >>> camera_matrix = np.array([[4, 0, 0], [0, 4, 0], [0, 0, 1]])
        >>> depth_m = starling.depth_from_range(np.array([[1.0, 1.0, 1.0, 1.0]]), camera_matrix)
        >>> [round(float(value), 2) for value in depth_m[0]]
        [1.0, 0.97, 0.89, 0.8]
    """
    from starling.sim.warp import conversions

    return conversions.depth_from_range(range_m, camera_matrix)


def from_opengl(pose: NDArray[Any]) -> NDArray[Any]:
    """Pose of a camera in OpenCV's axes from OpenGL's (MuJoCo, PyBullet, Blender); its own inverse.

    Args:
        pose: (4, 4) camera-to-world matrix with x right, y up, z backward [m].

    Returns:
        (4, 4) with x right, y down, z forward, such as `Scene.world_from_left`.

    Raises:
        InputError: if it is no rigid transform.

    Examples:
        >>> starling.from_opengl(np.eye(4))[:3, 2].tolist()
        [0.0, 0.0, -1.0]
    """
    from starling.sim.geometry import frames

    return frames.from_opengl(pose)


def from_ros(pose: NDArray[Any]) -> NDArray[Any]:
    """Pose of a camera in OpenCV's axes, those of its optical frame, from a body's pose in ROS.

    Args:
        pose: (4, 4) body-to-world matrix with x forward, y left, z up, as of `camera_link` [m].

    Returns:
        (4, 4) with x right, y down, z forward, such as `Scene.world_from_left`.

    Raises:
        InputError: if it is no rigid transform.

    Examples:
        >>> starling.from_ros(np.eye(4))[:3, 2].tolist()
        [1.0, 0.0, 0.0]
    """
    from starling.sim.geometry import frames

    return frames.from_ros(pose)


def simulate_captures(
    scene: Path | str,
    sensor: Sensor,
    out: Path | str,
    *,
    frames: int = 1,
    seed: int = 0,
    effects: Mapping[str, Value] | None = None,
    pose: NDArray[Any] | Path | str | None = None,
    look_at: Sequence[float] | None = None,
    up: str | None = None,
    unit: str | None = None,
    camera: str | None = None,
    keyframe: str | None = None,
    force: bool = False,
) -> dict[str, Any]:
    """Simulate a scene and write it as a capture set, as `starling simulate` does.

    Args:
        scene: specifier as for `load_scene`, or a capture set: then all its scenes.
        sensor: sensor that captures.
        out: folder to make.
        frames: frames of each scene.
        seed: seed of all noise.
        effects: strengths as for `apply_effects`.
        pose: as for `load_scene`. Each of several poses, (n, 4, 4) or a trajectory in TUM format,
            becomes a scene of the set.
        look_at: as for `load_scene`.
        up: as for `load_scene`.
        unit: as for `load_scene`.
        camera: as for `load_scene`.
        keyframe: as for `load_scene`.
        force: replace a folder that Starling wrote before.

    Returns:
        What was written: `out`, `files`, figures.

    Raises:
        InputError: unknown scene, existing folder, refused effect, or as `load_scene`.

    Examples:
        >>> written = starling.simulate_captures("wall", starling.load_sensor("d435"), "out/wall")
        >>> starling.open_captures("out/wall").scenes[0].frame(0).ir_left.shape
        (480, 848)
    """
    from starling import arguments
    from starling.sim.commands import simulate_captures
    from starling.sim.scene.placing import Placing
    from starling.sim.sensor import presets

    return simulate_captures.simulate_captures(
        arguments.text("scene", scene, "Give its name or its file."),
        presets.loaded(sensor),
        arguments.path("out", out),
        frames=frames,
        seed=seed,
        effects=effects,
        views=arguments.viewpoints(pose, look_at),
        frame=Placing(up=up, unit=unit, camera=camera, keyframe=keyframe),
        force=arguments.switch("force", force),
    )


def match(ir_left: NDArray[Any], ir_right: NDArray[Any] | None, sensor: Sensor) -> DepthMap:
    """Match a rectified infrared pair as a sensor does, and triangulate.

    Images of another size than the sensor's give a warning.

    Args:
        ir_left: (h, w) uint8, or uint16 of as many bits as the sensor matches.
        ir_right: (h, w) of the same type; None for structured light.
        sensor: gives the matcher, geometry and post-processing.

    Returns:
        Disparity [px] and depth [m], NaN where missing, with a reason for every missing pixel.

    Raises:
        InputError: images of different shape or type, or smaller than 16 x 16.

    Examples:
        >>> sensor = starling.load_sensor("d435")
        >>> shot = starling.simulate("wall", sensor)
        >>> depth = starling.match(shot.ir_left, shot.ir_right, sensor)
        >>> bool(depth.valid.mean() > 0.8)
        True
    """
    from starling import arguments
    from starling.sim import arrays
    from starling.sim.sensor import presets
    from starling.sim.stereo.measurement import measure

    left = arrays.numbers("ir_left", ir_left)
    right = None if ir_right is None else arrays.numbers("ir_right", ir_right)
    device = presets.loaded(sensor)
    depth = measure(left, right, device, causes={})
    arguments.warn_of_size(left.shape, device)
    return depth


def open_captures(path: Path | str) -> CaptureSet:
    """Open a capture set, or one scene folder in it. Images are read on use.

    Raises:
        InputError: no such folder, or no capture set.

    Examples:
        >>> _ = starling.simulate_captures("wall", starling.load_sensor("d435"), "out/captures")
        >>> [scene.name for scene in starling.open_captures("out/captures").scenes]
        ['wall']
    """
    from starling import arguments
    from starling.sim.captures import capture

    return capture.open_set(arguments.path("path", path))


def import_recording(
    source: Path | str,
    out: Path | str,
    *,
    left: str = "",
    right: str = "",
    depth: str = "",
    truth: str = "",
    colour: str = "",
    left_off: str = "",
    right_off: str = "",
    calibration: Path | str | Sequence[Path | str] = (),
    camera: str = "",
    baseline: float | None = None,
    depth_unit: str = "",
    emitter: Literal["on", "off"] | None = None,
    sensor: str = "",
    black_level: float | None = None,
    rectify: bool = False,
    moving: bool = False,
    every: int = 1,
    most_frames: int = 0,
    scene: str = "",
    licence: str = "not stated",
    force: bool = False,
) -> dict[str, Any]:
    """Import a recording of a depth camera as a capture set, as `starling import` does.

    Args:
        source: RealSense Viewer `.bag`, ROS 1 or 2 bag, MCAP file, TUM sequence, or folder of
            images.
        out: folder to make, which `open_captures` opens.
        left: left infrared images: pattern of files in a folder, or topic of a bag. Empty looks
            for usual names, here and below.
        right: right infrared images.
        depth: depth images of the device, in the left view.
        truth: reference depth in the left view: one image, or one for each frame.
        colour: colour images.
        left_off: left infrared images with the projector off.
        right_off: right infrared images with the projector off.
        calibration: file where the source has none: librealsense text, ROS camera_info, depthai
            JSON. Two camera_info files are those of left and right.
        camera: intrinsics of a TUM sequence, `fx fy cx cy width height` [px].
        baseline: distance of the imagers [m].
        depth_unit: unit of depth values: `m`, `mm`, or their step [m].
        emitter: whether the projector was `on` or `off`.
        sensor: name of the camera: a preset or any name.
        black_level: pedestal of the infrared images [codes].
        rectify: rectify the pair by the calibration's distortion.
        moving: each frame becomes a scene; otherwise all are repeats of one static scene.
        every: use one frame out of this many.
        most_frames: largest number of frames; 0 takes all.
        scene: name of the scene and of its room; empty takes that of the source.
        licence: licence of the recording, for `capture.toml`.
        force: replace a folder that Starling wrote before.

    Returns:
        What was written and seen: `out`, `frames`, `scenes`, `streams`, `seen`, `clock` and more.

    Raises:
        InputError: recording that cannot be read, contradicts itself or lacks a fact; the message
            names the option. Also existing folder.

    Examples:
        >>> sensor = starling.load_sensor("d435", edits=SMALL)
        >>> _ = starling.simulate_captures("tabletop", sensor, "out/recorded")
        >>> facts = {"depth_unit": "mm", "emitter": "on", "sensor": "d435", "baseline": 0.05015}
        >>> imported = starling.import_recording(
        ...     "out/recorded/tabletop/0", "out/imported", calibration=CAMERA_INFO, **facts
        ... )
        >>> imported["streams"], imported["seen"]["dots"]
        ('left, right, depth, colour', 'yes')
        >>> starling.open_captures(imported["out"]).scenes[0].frame(0).depth_m.shape
        (240, 424)
    """
    from starling import arguments
    from starling.sim.captures.recordings import import_recording as importing

    streams = {
        **{"left": left, "right": right, "depth": depth, "truth": truth, "colour": colour},
        **{"left_off": left_off, "right_off": right_off},
    }
    flags = arguments.facts(
        calibration=calibration,
        baseline=baseline,
        depth_unit=depth_unit,
        emitter=emitter,
        sensor=sensor,
        black_level=black_level,
        rectify=rectify,
    )
    choice = arguments.frame_choice(
        moving=moving, every=every, most_frames=most_frames, scene=scene, licence=licence
    )
    return importing.import_recording(
        arguments.path("source", source),
        arguments.path("out", out),
        streams=arguments.streams(streams),
        flags=flags,
        camera=arguments.plain_text("camera", camera),
        choice=choice,
        force=arguments.switch("force", force),
    )


def compare(real: CaptureSet | Path | str, simulated: CaptureSet | Path | str) -> dict[str, Any]:
    """Compare simulated captures with real captures of the same scenes.

    Args:
        real: captures of a device, or their folder.
        simulated: simulated captures of the same scenes, or their folder.

    Returns:
        `{"metrics": {NAME: {"real", "sim", "gap"}}, "scenes": {...}}`.

    Raises:
        InputError: no common scene, or images of different size.

    Examples:
        >>> sensor = starling.load_sensor("d435")
        >>> for seed in (1, 2):
        ...     _ = starling.simulate_captures("wall", sensor, f"out/{seed}", seed=seed)
        >>> sorted(starling.compare("out/1", "out/2")["metrics"])
        ['dot_contrast', 'mean_dn', 'ndp_iou', 'ndp_rate', 'nmad_px']
    """
    from starling import arguments
    from starling.sim.commands import compare

    return compare.compare(
        arguments.captures("real", real), arguments.captures("simulated", simulated)
    )


def calibrate(
    captures: CaptureSet | Path | str,
    sensor: Sensor,
    *,
    free: Sequence[str],
    folder: Path | str,
    heldout: Sequence[str] | None = None,
    most_scenes: int = _MOST_SCENES,
) -> Calibration:
    """Fit a sensor to captures of known surfaces, and score it on held-out rooms.

    Args:
        captures: captures with reference depth or known geometry, or their folder.
        sensor: sensor to start from, with the captures' intrinsics.
        free: groups of parameters to fit, e.g. `("baseline", "focal", "projector")`.
        folder: where the images of a recovered dot pattern go.
        heldout: rooms left out of the fit; every fourth room where None.
        most_scenes: largest number of scenes to fit, and of held-out scenes to score.

    Returns:
        Fitted sensor, estimates with standard deviations, held-out scores.

    Raises:
        InputError: captures that cannot be calibrated, unknown groups or rooms.

    Examples:
        >>> sensor = starling.load_sensor("d435", edits=SMALL)
        >>> _ = starling.simulate_captures("tabletop", sensor, "out/table")
        >>> fit = starling.calibrate("out/table", sensor, free=["baseline"], folder="out")
        >>> bool(abs(fit.sensor.baseline_m - sensor.baseline_m) < 1e-3)
        True
    """
    from starling import arguments
    from starling.calibration.fit_sensor import fit
    from starling.patterns import errors
    from starling.sim.sensor import presets

    rooms = None if heldout is None else errors.texts("heldout", heldout, "Give a list.")
    return fit(
        arguments.captures("captures", captures).scenes,
        presets.loaded(sensor),
        free=errors.texts("free", free, "Give a list: ['baseline']."),
        folder=arguments.path("folder", folder),
        heldout=rooms,
        most_scenes=most_scenes,
    )


def diagnose(
    captures: CaptureSet | Path | str,
    sensor: Sensor,
    *,
    against: CaptureSet | Path | str | None = None,
    families: Sequence[str] | None = None,
    cache: Path | str | None = None,
    residual: bool = False,
) -> Diagnosis:
    """Find out where a simulation differs from captures, which effect explains it, how far.

    It simulates in worker processes: call it below `if __name__ == "__main__"` in a script.

    Args:
        captures: captures with reference depth or known geometry, or their folder.
        sensor: sensor that the captures' camera should be.
        against: captures of the same scenes to compare with in place of a simulation.
        families: families of effects to try; all where None.
        cache: folder that keeps simulated features for other runs on the same scenes.
        residual: train a network on what physics misses, as a bound.

    Returns:
        Location of the gap, candidate effects with strengths, gap reduction on held-out scenes.

    Raises:
        InputError: damaged captures, unknown families, or a sensor that is no stereo camera.

    Examples:
        >>> camera = starling.load_sensor("d435", edits=SMALL)
        >>> _ = starling.simulate_captures("clutter:1", camera, "out/dim", effects={"gain": 0.5})
        >>> diagnosis = starling.diagnose("out/dim", camera, families=["signal_gain"])
        >>> diagnosis.scenes
        ('clutter-1',)
    """
    from starling import arguments
    from starling.diagnosis.diagnosis import diagnose
    from starling.patterns import errors
    from starling.sim.sensor import presets

    names = None if families is None else errors.texts("families", families, "Give a list.")
    return diagnose(
        arguments.captures("captures", captures),
        presets.loaded(sensor),
        against=None if against is None else arguments.captures("against", against),
        families=names,
        cache=None if cache is None else arguments.path("cache", cache),
        residual=arguments.switch("residual", residual),
    )


def complete(
    image: NDArray[Any] | None, depth_m: NDArray[Any], *, method: str = "small"
) -> Completed:
    """Fill missing depth of one frame.

    Args:
        image: (h, w, 3) or grey (h, w), registered to depth; None where there is none.
        depth_m: (h, w) depth [m], NaN where missing.
        method: `nearest`, `morphological`, `bilateral`, `wls`, `poisson`, `small`, or
            `NAME=FOLDER` for one with trained weights.

    Returns:
        Depth everywhere, and its expected standard deviation where the method estimates it.

    Raises:
        InputError: unknown method, images of different size, or missing PyTorch.

    Examples:
        >>> shot = starling.simulate("wall", "d435")
        >>> filled = starling.complete(shot.ir_left, shot.depth.depth_m, method="nearest")
        >>> bool(np.isfinite(filled.depth_m).all())
        True
    """
    import numpy as np

    from starling.learning.completion import method as completion
    from starling.learning.completion import methods
    from starling.sim import arrays

    depth = arrays.numbers("depth_m", depth_m)
    picture = None if image is None else arrays.numbers("image", image)
    return completion.complete(methods.create(method), picture, depth, np.isfinite(depth))


def generate(plan: Path | str, out: Path | str, *, workers: int = 1) -> dict[str, Any]:
    """Make a data set from a plan; a run that was interrupted continues.

    Args:
        plan: TOML file with scenes, sensors, poses and seed.
        out: folder of the data set.
        workers: processes.

    Raises:
        InputError: refused plan, or a folder with another plan's data.

    Examples:
        >>> generated = starling.generate(PLAN, "out/set")
        >>> generated["frames"]
        2
    """
    from starling import arguments
    from starling.sim.datasets.generate import generate

    return generate(arguments.path("plan", plan), arguments.path("out", out), workers=workers)


def verify(out: Path | str, *, sample: int = 0) -> dict[str, Any]:
    """Check a data set: checksums of all files, and a sample of frames made again.

    Args:
        out: folder of the data set.
        sample: frames to make again and compare.

    Raises:
        InputError: no data set in the folder.

    Examples:
        >>> _ = starling.generate(PLAN, "out/verified")
        >>> starling.verify("out/verified", sample=1)["differing"]
        0
    """
    from starling import arguments
    from starling.sim.datasets.verify import verify

    return verify(arguments.path("out", out), sample=sample)


def draw(captures: Path | str, out: Path | str, *, frame: int = 0) -> dict[str, Any]:
    """Draw captures: infrared, depth, reasons of missing depth, error against ground truth.

    Args:
        captures: capture set, or one scene in it.
        out: `NAME.png` for one scene, a folder for several.
        frame: number of the frame.

    Raises:
        InputError: no captures, or an existing picture.

    Examples:
        >>> _ = starling.simulate_captures("wall", starling.load_sensor("d435"), "out/drawn")
        >>> _ = starling.draw("out/drawn/wall", "out/wall.png")
    """
    from starling import arguments
    from starling.sim.commands import show_captures

    source = arguments.text("captures", captures, "Give the folder of captures.")
    return show_captures.show_captures(source, arguments.path("out", out), frame=frame)


def __getattr__(name: str) -> Any:
    """Load a class or a package on first use."""
    from importlib import import_module

    if name in _CLASSES:
        return getattr(import_module(_CLASSES[name]), name)
    if name in _PACKAGES:
        return import_module(f"starling.{name}")
    from difflib import get_close_matches

    (nearest,) = get_close_matches(name, [*__all__, *_PACKAGES], n=1, cutoff=0.0)
    raise AttributeError(f"module 'starling' has no attribute {name!r}. Nearest: {nearest}.")


def __dir__() -> list[str]:
    return [*__all__, *_PACKAGES, "__version__"]
