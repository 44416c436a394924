"""Streams that the simulator makes, fused, against the surface that it knows.

Rationale: what stands for truth in a real stream is its own fused surface. Expected behaviour: of
exact depth it is the true surface up to half a step of the depth's code; of a simulated device's
depth it is no worse than the device's frames are.
"""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh

from starling import command_line
from starling.patterns.errors import InputError
from starling.sim import simulate
from starling.sim.captures import capture
from starling.sim.captures import info as capture_info
from starling.sim.captures import writer as capture_writer
from starling.sim.captures.exchange import labelfusion, tum
from starling.sim.captures.fusion import fuse, pairs, reference, trajectory
from starling.sim.captures.fusion.fused import fused as surface_of
from starling.sim.console.output import OutputFolder
from starling.sim.datasets.files import Files
from starling.sim.geometry import frames
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.render.mitsuba_scene import Stage
from starling.sim.scene import sources as scenes
from starling.sim.sensor import resolve as asked_sensor
from starling.sim.stereo.depth import DepthMap

SIZE = ("width=160", "height=120", "fx_px=130", "fy_px=130", "cx_px=79.5", "cy_px=59.5")
VOXEL_M = 0.01
MIDDLE_M = (0.0, 0.25, 1.05)


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Simulated:
    folder: Path  # Streams `exact` and `device`, in TUM's layout.
    poses: list[frames.Pose]
    truth_m: list[np.ndarray]
    device_m: list[np.ndarray]


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Simulated:
    """A D435 on an arc about a table."""
    sensor = asked_sensor.load("d435", edits=SIZE)
    stage = Stage(scenes.load("tabletop", sensor))
    folder = tmp_path_factory.mktemp("streams")
    poses, shots = [], []
    for number, turn in enumerate(np.linspace(-0.5, 0.5, 9)):
        away = (0.8 * np.sin(turn), -0.45, -0.8 * np.cos(turn))
        poses.append(frames.look_at(tuple(np.add(MIDDLE_M, away)), MIDDLE_M, (0.0, -1.0, 0.0)))
        at = dataclasses.replace(stage.scene, world_from_left=poses[-1])
        shots.append(simulate.simulate(stage.of(at), sensor, seed=number))
    told = capture_writer.info_of(sensor, source="", licence="", notes="")
    info = dataclasses.replace(told, depth_unit_m=pairs.UNIT_M)
    for kind in ("exact", "device"):
        with OutputFolder(folder / f"{kind} set") as written:
            written.write(capture_info.FILE, capture_info.dumps(info))
            for number, (pose, shot) in enumerate(zip(poses, shots, strict=True)):
                truth_m = shot.layers.truth.depth_m
                capture_writer.write_frame(
                    written,
                    f"{number:03d}",
                    0,
                    depth=shot.depth if kind == "device" else exact(truth_m, info),
                    depth_unit_m=info.depth_unit_m,
                    infrared=(shot.ir_left, None),
                    facts={"left_from_world": np.linalg.inv(pose).tolist()},
                )
        with OutputFolder(folder / kind) as stream:
            tum.export(capture.open_set(folder / f"{kind} set").scenes, stream)
    return Simulated(
        folder=folder,
        poses=poses,
        truth_m=[shot.layers.truth.depth_m for shot in shots],
        device_m=[shot.depth.depth_m for shot in shots],
    )


def exact(truth_m: np.ndarray, info: capture_info.CaptureInfo) -> DepthMap:
    return DepthMap(
        disparity_px=info.disparity_px(truth_m),
        depth_m=truth_m,
        valid=np.isfinite(truth_m),
        reason=np.zeros(truth_m.shape, np.uint32),
    )


@pytest.fixture(scope="module")
def fused(simulated: Simulated) -> tuple[Path, dict[str, Any]]:
    out = simulated.folder / "fused"
    streams = [simulated.folder / kind for kind in ("exact", "device")]
    fusion = fuse.Fusion(voxel_m=VOXEL_M, far_m=2.0)
    return out, fuse.fuse(streams, out, layout="tum", sensor="d435", fusion=fusion)


def errors(fused: Path, simulated: Simulated, kind: str) -> tuple[np.ndarray, float]:
    """Of reference against truth, where both are; share of the true surface that has one."""
    off, complete = [], []
    named = {scene.name: scene for scene in capture.open_set(fused).scenes}
    for number, truth_m in enumerate(simulated.truth_m):
        reference_m = named[f"{kind}-{number:06d}"].truth_m()
        assert reference_m is not None
        near = truth_m < 1.5  # All of it is seen by two cameras or more.
        off.append((reference_m - truth_m)[near & np.isfinite(reference_m)])
        complete.append(np.isfinite(reference_m)[near].mean())
    return np.concatenate(off), float(np.mean(complete))


def test_of_exact_depth_the_surface_is_the_true_one(
    fused: tuple[Path, dict[str, Any]], simulated: Simulated
):
    """Median: half a code. 95 of 100 pixels lie off outlines, so that a voxel is far too much."""
    off, complete = errors(fused[0], simulated, "exact")
    assert np.median(np.abs(off)) < pairs.UNIT_M / 2
    assert abs(np.median(off)) < pairs.UNIT_M / 4
    assert np.percentile(np.abs(off), 95) < VOXEL_M
    assert complete > 0.95
    assert fused[1]["streams"]["exact"]["residual_m"] < pairs.UNIT_M


def test_of_a_device_s_depth_it_is_no_worse_than_its_frames(
    fused: tuple[Path, dict[str, Any]], simulated: Simulated
):
    off, complete = errors(fused[0], simulated, "device")
    own = np.concatenate(
        [(d - t)[t < 1.5] for d, t in zip(simulated.device_m, simulated.truth_m, strict=True)]
    )
    own = np.abs(own[np.isfinite(own)])
    assert np.median(np.abs(off)) < np.median(own)
    assert np.percentile(np.abs(off), 95) < np.percentile(own, 95) + VOXEL_M
    assert complete > 0.85


def test_pairs_are_what_the_device_told(fused: tuple[Path, dict[str, Any]], simulated: Simulated):
    """Every scene has the frame's depth and holes, its pose, its picture and its stream as room."""
    out, told = fused
    captures = capture.open_set(out)
    assert told["frames"] == len(captures.scenes) == 18 and told["without_pose"] == 0
    assert {scene.room for scene in captures.scenes} == {"exact", "device"}
    assert captures.info.sensor == "d435" and captures.info.width == 160
    unit = pairs.UNIT_M
    counted = []
    for number, device_m in enumerate(simulated.device_m):
        (scene,) = [one for one in captures.scenes if one.name == f"device-{number:06d}"]
        frame, truth_m = scene.frame(0), scene.truth_m()
        assert frame.depth_m is not None and frame.ir_left is not None and truth_m is not None
        np.testing.assert_allclose(frame.depth_m, device_m, atol=0.51 * unit)
        np.testing.assert_allclose(
            np.linalg.inv(frame.record["left_from_world"]), simulated.poses[number], atol=1e-7
        )
        assert frame.record["timestamp"] == pytest.approx(number / 30, abs=1e-6)
        known = np.isfinite(truth_m)
        counted.append(np.isnan(frame.depth_m)[known].mean())
    assert told["streams"]["device"]["ndp"] == pytest.approx(np.mean(counted)) and max(counted) > 0
    mesh = trimesh.load_mesh(out / "device.ply")
    assert len(mesh.faces) == told["streams"]["device"]["triangles"]


def test_a_method_learns_from_the_pairs(fused: tuple[Path, dict[str, Any]], capsys: Any):
    model = fused[0].parent / "model"
    flags = ["train", "trees", str(fused[0]), "--out", str(model), "--rooms", "device", "--json"]
    assert command_line.main(flags) == 0
    told = json.loads(capsys.readouterr().out)
    assert len(told["scenes"]) == 9 and 0 < told["ndp_rate"] < 1


def hold_reference(fy_px: float) -> None:
    """A ramp seen by a camera that is turned and moved: z of each pixel's ray."""
    camera = Pinhole(width=40, height=36, fx_px=50.0, fy_px=fy_px, cx_px=17.2, cy_px=16.9)
    ramp = trimesh.Trimesh([[-3, -3, 1], [3, -3, 2], [3, 3, 3], [-3, 3, 2]], [[0, 2, 1], [0, 3, 2]])
    pose = frames.pose((0.1, -0.2, 0.3), (4.0, -8.0, 11.0))
    (found,) = reference.depths(ramp, camera, [pose])
    u, v = np.meshgrid(np.arange(40), np.arange(36))
    way = np.stack([(u - 17.2) / 50, (v - 16.9) / fy_px, np.ones(u.shape)], -1) @ pose[:3, :3].T
    normal = np.array([-1 / 6, -1 / 6, 1.0])
    expected = (2 - pose[:3, 3] @ normal) / (way @ normal)
    np.testing.assert_allclose(found, expected, rtol=2e-6)


@pytest.mark.parametrize("fy_px", [50.0, 54.0])
def test_reference_depth_is_that_of_pixels_centres(fy_px: float):
    hold_reference(fy_px)


def test_it_is_the_same_without_a_compiler():
    code = (
        "from starling.sim.render import backend; from tests.system import test_fuse as here\n"
        "here.hold_reference(50.0); assert not backend.is_jit()"
    )
    environment = {**os.environ, "STARLING_VARIANT": "scalar_rgb"}
    root = Path(__file__).parents[2]
    subprocess.run([sys.executable, "-c", code], check=True, cwd=root, env=environment)


def test_the_back_of_a_surface_is_no_reference():
    camera = Pinhole(width=32, height=32, fx_px=40.0, fy_px=40.0, cx_px=15.5, cy_px=15.5)
    card = trimesh.Trimesh([[-9, -9, 0], [9, -9, 0], [0, 9, 0]], [[0, 2, 1]])
    before, behind = frames.pose((0, 0, -1.0)), frames.pose((0, 0, 1.0), (0, 180.0, 0))
    front, back = reference.depths(card, camera, [before, behind])
    assert np.isfinite(front).all() and np.isnan(back).all()


def run(*words: object, capsys: Any) -> tuple[int, str, str]:
    code = command_line.main([str(word) for word in words])
    said = capsys.readouterr()
    return code, said.out, said.err


def test_the_command_fuses(simulated: Simulated, tmp_path: Path, capsys: Any):
    flags = ["fuse", simulated.folder / "exact", "--layout", "tum", "--out", tmp_path / "set"]
    flags += ["--voxel", 0.02, "--every", 3, "--far", 1.5, "--json"]
    code, out, _ = run(*flags, capsys=capsys)
    told = json.loads(out)
    assert code == 0 and told["frames"] == 3 and told["voxel_m"] == 0.02
    assert told["triangles"] > 1000 and told["points"] > 500 and told["seconds"] > 0
    assert json.loads((tmp_path / "set" / "starling.json").read_text())["verb"] == "fuse"
    assert run(*flags, capsys=capsys)[0] == 1  # Nothing is overwritten unasked.
    assert run(*flags, "--force", capsys=capsys)[0] == 0


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (("--camera", "1 2 3"), "camera must be fx fy cx cy width height; got '1 2 3'"),
        (("--camera", "a b c d e f"), "camera must be fx fy cx cy width height"),
        (("--camera", "130 130 79.5 59.5 320 240"), "depth must be 320x240 as the camera"),
        (("--voxel", "0"), "voxel must be in"),
        (("--far", "99"), "far must be in"),
        (("--least", "0"), "least must be in"),
        (("--sensor", "eye"), "sensor must be a known name"),
    ],
)
def test_what_cannot_be_is_refused(
    simulated: Simulated, tmp_path: Path, capsys: Any, flags: tuple[str, ...], said: str
):
    out = tmp_path / "set"
    words = ["fuse", simulated.folder / "exact", "--layout", "tum", "--out", out, *flags]
    code, _, err = run(*words, capsys=capsys)
    assert code == 1 and said in err and not out.exists()


def test_streams_that_cannot_be_one_set_are_refused(simulated: Simulated, tmp_path: Path):
    exact = simulated.folder / "exact"
    with pytest.raises(InputError, match="streams must have names of their own; got exact"):
        fuse.fuse([exact, exact], tmp_path / "set", layout="tum")
    other = tmp_path / "other"
    other.mkdir()
    for name in ("depth.txt", "groundtruth.txt"):
        (other / name).write_text((exact / name).read_text())
    (other / "camera.txt").write_text("100 100 79.5 59.5 160 120")
    with pytest.raises(InputError, match="streams must be of one camera; got 2 cameras"):
        fuse.fuse([exact, other], tmp_path / "set", layout="tum")
    with pytest.raises(InputError, match="out must lie apart"):
        fuse.fuse([exact], exact / "set", layout="tum")
    with pytest.raises(InputError, match="streams must be of one camera; got 0 cameras"):
        fuse.fuse([], tmp_path / "set", layout="tum")
    (other / "groundtruth.txt").write_text("")
    with pytest.raises(InputError, match="stream must have poses; got 9 frames"):
        fuse.fuse([other], tmp_path / "set", layout="tum")
    with pytest.raises(InputError, match=r"log must hold images/NUMBER_depth\.png"):
        fuse.fuse([exact], tmp_path / "set", layout="labelfusion")


def wall(folder: Path, frames_told: int = 3) -> Path:
    """A log in LabelFusion's layout: a wall 1 m off with a hole, and in a corner far more."""
    (folder / "images").mkdir(parents=True)
    code = np.full((40, 48), 1000, np.uint16)
    code[10:20, 10:20], code[:8, 40:] = 0, 20000
    for number in range(3):
        stem = folder / "images" / f"{number + 1:010d}"
        given = code if number == 0 else np.where(code == 0, 1000, code).astype(np.uint16)
        cv2.imwrite(f"{stem}_depth.png", given)
        cv2.imwrite(f"{stem}_rgb.png", np.full((20, 24, 3), (10, 20, 200), np.uint8))
        Path(f"{stem}_utime.txt").write_text(f"{number * 33333}")
    rows = [f"{number * 0.033333:.6f} 0 0 0 0 0 0 1\n" for number in range(frames_told)]
    (folder / "posegraph.posegraph").write_text("".join(rows))
    return folder


def info_of(camera: Pinhole) -> capture_info.CaptureInfo:
    return capture_info.CaptureInfo(
        **dataclasses.asdict(camera),
        **{"sensor": "xtion", "baseline_m": 0.075, "depth_unit_m": pairs.UNIT_M},
        **{"source": "", "licence": "", "notes": ""},
    )


def test_a_log_of_labelfusion_is_fused(tmp_path: Path):
    """Its pictures are colour ones; a frame without a pose is left out; far depth is no hole."""
    camera, out = "40 40 23.5 19.5 48 40", tmp_path / "set"
    log = wall(tmp_path / "log", frames_told=2)
    told = fuse.fuse([log], out, layout="labelfusion", camera=camera, fusion=fuse.Fusion(least=1))
    assert told["frames"] == 2 and told["without_pose"] == 1
    first, second = capture.open_set(out).scenes
    truth_m, depth_m = first.truth_m(), first.frame(0).depth_m
    assert truth_m is not None and depth_m is not None
    np.testing.assert_allclose(truth_m[12:18, 12:18], 1.0, atol=pairs.UNIT_M)
    assert np.isnan(depth_m[10:20, 10:20]).all() and np.isnan(truth_m[:5, 43:]).all()
    assert np.isfinite(depth_m[:8, 40:]).all() and first.frame(0).ir_left is None
    colour = cv2.imread(str(second.path / "0" / "rgb.png"))
    assert colour is not None and colour[0, 0].tolist() == [10, 20, 200]
    assert 0 < told["streams"]["log"]["ndp"] < 0.1


def test_a_grey_picture_of_another_size_is_refused(tmp_path: Path):
    log = wall(tmp_path / "log")
    stream = labelfusion.read(log, fuse.parsed("40 40 23.5 19.5 48 40"))
    grey = [
        dataclasses.replace(one, image=lambda: np.zeros((20, 24), np.uint8))
        for one in stream.moments
    ]
    chosen = trajectory.posed(dataclasses.replace(stream, moments=tuple(grey)))
    mesh = surface_of(chosen, stream.camera, fuse.Fusion())
    with pytest.raises(InputError, match="grey image must be 48x40 as the depth; got 24x20 at 0"):
        pairs.write("log", chosen, mesh, info_of(stream.camera), Files(tmp_path))


def test_a_surface_that_no_view_shows_has_no_figures(tmp_path: Path):
    log = wall(tmp_path / "log")
    stream = labelfusion.read(log, fuse.parsed("40 40 23.5 19.5 48 40"))
    chosen = trajectory.posed(stream)
    aside = trimesh.creation.box((0.1, 0.1, 0.1)).apply_translation((9.0, 0, 0))
    figures = pairs.write("log", chosen, aside, info_of(stream.camera), Files(tmp_path))
    assert figures == {"completeness": 0.0, "residual_m": None, "ndp": None}
