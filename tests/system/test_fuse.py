"""Fusion of simulated streams, compared with the true surface.

Rationale: in a real stream the fused surface serves as ground truth. Expected behaviour: fused from
exact depth, it is the true surface up to half a step of the depth code. Fused from a simulated
device's depth, it is no worse than the device's frames.
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
from starling.sim.captures import capture, writer
from starling.sim.captures import info as capture_info
from starling.sim.captures.exchange import labelfusion, tum
from starling.sim.captures.exchange.stream import parse_camera, posed_frames
from starling.sim.captures.fusion import fuse, pairs
from starling.sim.captures.fusion.volume import fuse_frames
from starling.sim.console.output import OutputFolder
from starling.sim.datasets.render_view import MemoryFolder
from starling.sim.geometry import frames
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene import sources
from starling.sim.sensor import resolve
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
    """A D435 on an arc around a table."""
    sensor = resolve.load("d435", edits=SIZE)
    stage = MitsubaScene(sources.load("tabletop", sensor))
    folder = tmp_path_factory.mktemp("streams")
    poses, shots = [], []
    for number, turn in enumerate(np.linspace(-0.5, 0.5, 9)):
        away = (0.8 * np.sin(turn), -0.45, -0.8 * np.cos(turn))
        poses.append(frames.look_at(tuple(np.add(MIDDLE_M, away)), MIDDLE_M, (0.0, -1.0, 0.0)))
        last_scene = dataclasses.replace(stage.scene, world_from_left=poses[-1])
        shots.append(simulate.simulate(stage.with_scene(last_scene), sensor, seed=number))
    info = writer.info_of(sensor, source="", licence="", notes="")
    info = dataclasses.replace(info, depth_unit_m=pairs.UNIT_M)
    for kind in ("exact", "device"):
        with OutputFolder(folder / f"{kind} set") as written:
            written.write(capture_info.FILE, capture_info.dumps(info))
            for number, (pose, shot) in enumerate(zip(poses, shots, strict=True)):
                truth_m = shot.layers.truth.depth_m
                writer.write_frame(
                    written,
                    f"{number:03d}",
                    0,
                    depth=shot.depth if kind == "device" else exact(truth_m, info),
                    depth_unit_m=info.depth_unit_m,
                    infrared=(shot.ir_left, None),
                    facts={"left_from_world": np.linalg.inv(pose).tolist()},
                )
        with (
            pytest.warns(UserWarning, match="poses of 9 rooms form one trajectory"),
            OutputFolder(folder / kind) as stream,
        ):
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
    """Return errors of the reference against ground truth, and its completeness."""
    off, complete = [], []
    named = {scene.name: scene for scene in capture.open_set(fused).scenes}
    for number, truth_m in enumerate(simulated.truth_m):
        reference_m = named[f"{kind}-{number:06d}"].truth_m()
        assert reference_m is not None
        near = truth_m < 1.5  # All of it is seen by two cameras or more.
        off.append((reference_m - truth_m)[near & np.isfinite(reference_m)])
        complete.append(np.isfinite(reference_m)[near].mean())
    return np.concatenate(off), float(np.mean(complete))


def test_surface_of_exact_depth_is_true(fused: tuple[Path, dict[str, Any]], simulated: Simulated):
    """Median error half a code. For the 95 % of pixels off outlines, a voxel would be too much."""
    off, complete = errors(fused[0], simulated, "exact")
    assert np.median(np.abs(off)) < pairs.UNIT_M / 2
    assert abs(np.median(off)) < pairs.UNIT_M / 4
    assert np.percentile(np.abs(off), 95) < VOXEL_M
    assert complete > 0.95
    assert fused[1]["streams"]["exact"]["residual_m"] < pairs.UNIT_M


def test_surface_of_noisy_depth_is_no_worse_than_its_frames(
    fused: tuple[Path, dict[str, Any]], simulated: Simulated
):
    off, complete = errors(fused[0], simulated, "device")
    expected = np.concatenate(
        [(d - t)[t < 1.5] for d, t in zip(simulated.device_m, simulated.truth_m, strict=True)]
    )
    expected = np.abs(expected[np.isfinite(expected)])
    assert np.median(np.abs(off)) < np.median(expected)
    assert np.percentile(np.abs(off), 95) < np.percentile(expected, 95) + VOXEL_M
    assert complete > 0.85


def test_pairs_hold_the_device_s_depth(fused: tuple[Path, dict[str, Any]], simulated: Simulated):
    """Every scene has the frame's depth, holes, pose and picture; its room is the stream."""
    out, report = fused
    captures = capture.open_set(out)
    assert report["frames"] == len(captures.scenes) == 18 and report["without_pose"] == 0
    assert {scene.room for scene in captures.scenes} == {"exact", "device"}
    assert captures.info.sensor == "d435" and captures.info.width == 160
    unit = pairs.UNIT_M
    counted = []
    for number, device_m in enumerate(simulated.device_m):
        (scene,) = [item for item in captures.scenes if item.name == f"device-{number:06d}"]
        frame, truth_m = scene.frame(0), scene.truth_m()
        assert frame.depth_m is not None and frame.ir_left is not None and truth_m is not None
        np.testing.assert_allclose(frame.depth_m, device_m, atol=0.51 * unit)
        np.testing.assert_allclose(
            np.linalg.inv(frame.record["left_from_world"]), simulated.poses[number], atol=1e-7
        )
        assert frame.record["timestamp"] == pytest.approx(number / 30, abs=1e-6)
        known = np.isfinite(truth_m)
        counted.append(np.isnan(frame.depth_m)[known].mean())
    assert (
        report["streams"]["device"]["ndp"] == pytest.approx(np.mean(counted)) and max(counted) > 0
    )
    mesh = trimesh.load_mesh(out / "device.ply")
    assert len(mesh.faces) == report["streams"]["device"]["triangles"]


def test_a_method_learns_from_the_pairs(fused: tuple[Path, dict[str, Any]], capsys: Any):
    model = fused[0].parent / "model"
    flags = ["train", "trees", str(fused[0]), "--out", str(model), "--rooms", "device", "--json"]
    assert command_line.main(flags) == 0
    report = json.loads(capsys.readouterr().out)
    assert len(report["scenes"]) == 9 and 0 < report["ndp_rate"] < 1


def hold_reference(fy_px: float) -> None:
    """A rotated and shifted camera sees a ramp; z is exact for each pixel's ray."""
    camera = Pinhole(width=40, height=36, fx_px=50.0, fy_px=fy_px, cx_px=17.2, cy_px=16.9)
    ramp = trimesh.Trimesh([[-3, -3, 1], [3, -3, 2], [3, 3, 3], [-3, 3, 2]], [[0, 2, 1], [0, 3, 2]])
    pose = frames.pose((0.1, -0.2, 0.3), (4.0, -8.0, 11.0))
    (result,) = pairs.reference_depths(ramp, camera, [pose])
    u, v = np.meshgrid(np.arange(40), np.arange(36))
    way = np.stack([(u - 17.2) / 50, (v - 16.9) / fy_px, np.ones(u.shape)], -1) @ pose[:3, :3].T
    normal = np.array([-1 / 6, -1 / 6, 1.0])
    expected = (2 - pose[:3, 3] @ normal) / (way @ normal)
    np.testing.assert_allclose(result, expected, rtol=2e-6)


@pytest.mark.parametrize("fy_px", [50.0, 54.0])
def test_reference_depth_is_at_pixel_centres(fy_px: float):
    hold_reference(fy_px)


def test_scalar_variant_gives_the_same_depth():
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
    front, back = pairs.reference_depths(card, camera, [before, behind])
    assert np.isfinite(front).all() and np.isnan(back).all()


def run(*words: object, capsys: Any) -> tuple[int, str, str]:
    code = command_line.main([str(word) for word in words])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def test_the_command_fuses(simulated: Simulated, tmp_path: Path, capsys: Any):
    flags = ["fuse", simulated.folder / "exact", "--layout", "tum", "--out", tmp_path / "set"]
    flags += ["--voxel", 0.02, "--every", 3, "--far", 1.5, "--json"]
    code, out, _ = run(*flags, capsys=capsys)
    report = json.loads(out)
    assert code == 0 and report["frames"] == 3 and report["voxel_m"] == 0.02
    assert report["triangles"] > 1000 and report["points"] > 500 and report["seconds"] > 0
    assert json.loads((tmp_path / "set" / "starling.json").read_text())["verb"] == "fuse"
    assert run(*flags, capsys=capsys)[0] == 1  # Nothing is overwritten unasked.
    assert run(*flags, "--force", capsys=capsys)[0] == 0


@pytest.mark.parametrize(
    ("flags", "message"),
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
def test_invalid_arguments_are_refused(
    simulated: Simulated, tmp_path: Path, capsys: Any, flags: tuple[str, ...], message: str
):
    out = tmp_path / "set"
    words = ["fuse", simulated.folder / "exact", "--layout", "tum", "--out", out, *flags]
    code, _, err = run(*words, capsys=capsys)
    assert code == 1 and message in err and not out.exists()


def test_incompatible_streams_are_refused(simulated: Simulated, tmp_path: Path):
    exact = simulated.folder / "exact"
    with pytest.raises(InputError, match="streams must have names of their own; got exact"):
        fuse.fuse([exact, exact], tmp_path / "set", layout="tum")
    second = tmp_path / "other"
    second.mkdir()
    for name in ("depth.txt", "groundtruth.txt"):
        (second / name).write_text((exact / name).read_text())
    (second / "camera.txt").write_text("100 100 79.5 59.5 160 120")
    with pytest.raises(InputError, match="streams must be of one camera; got 2 cameras"):
        fuse.fuse([exact, second], tmp_path / "set", layout="tum")
    with pytest.raises(InputError, match="out must lie outside"):
        fuse.fuse([exact], exact / "set", layout="tum")
    with pytest.raises(InputError, match="mode must have the captures' image size 160x120"):
        fuse.fuse([exact], tmp_path / "set", layout="tum", sensor="d435", mode="640x480")
    with pytest.raises(InputError, match="streams must be given; got nothing"):
        fuse.fuse([], tmp_path / "set", layout="tum")
    (second / "groundtruth.txt").write_text("")
    with pytest.raises(InputError, match="stream must have poses; got 9 frames"):
        fuse.fuse([second], tmp_path / "set", layout="tum")
    with pytest.raises(InputError, match=r"log must hold images/NUMBER_depth\.png"):
        fuse.fuse([exact], tmp_path / "set", layout="labelfusion")


def wall(folder: Path, frames_told: int = 3) -> Path:
    """A LabelFusion log of a wall at 1 m with a hole, and with a distant corner."""
    (folder / "images").mkdir(parents=True)
    code = np.full((40, 48), 1000, np.uint16)
    code[10:20, 10:20], code[:8, 40:] = 0, 20000
    for number in range(3):
        stem = folder / "images" / f"{number + 1:010d}"
        inputs = code if number == 0 else np.where(code == 0, 1000, code).astype(np.uint16)
        cv2.imwrite(f"{stem}_depth.png", inputs)
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
    """Pictures are in colour; a frame without pose is left out; far depth is not a hole."""
    camera, out = "40 40 23.5 19.5 48 40", tmp_path / "set"
    log = wall(tmp_path / "log", frames_told=2)
    report = fuse.fuse([log], out, layout="labelfusion", camera=camera, fusion=fuse.Fusion(least=1))
    assert report["frames"] == 2 and report["without_pose"] == 1
    first, second = capture.open_set(out).scenes
    truth_m, depth_m = first.truth_m(), first.frame(0).depth_m
    assert truth_m is not None and depth_m is not None
    np.testing.assert_allclose(truth_m[12:18, 12:18], 1.0, atol=pairs.UNIT_M)
    assert np.isnan(depth_m[10:20, 10:20]).all() and np.isnan(truth_m[:5, 43:]).all()
    assert np.isfinite(depth_m[:8, 40:]).all() and first.frame(0).ir_left is None
    colour = cv2.imread(str(second.path / "0" / "rgb.png"))
    assert colour is not None and colour[0, 0].tolist() == [10, 20, 200]
    assert 0 < report["streams"]["log"]["ndp"] < 0.1


def test_a_grey_picture_of_another_size_is_refused(tmp_path: Path):
    log = wall(tmp_path / "log")
    stream = labelfusion.read(log, parse_camera("40 40 23.5 19.5 48 40"))
    grey = [
        dataclasses.replace(moment, image=lambda: np.zeros((20, 24), np.uint8))
        for moment in stream.moments
    ]
    chosen = posed_frames(dataclasses.replace(stream, moments=tuple(grey)))
    mesh = fuse_frames(chosen, stream.camera, fuse.Fusion())
    with pytest.raises(InputError, match="grey image must be 48x40 as the depth; got 24x20 at 0"):
        pairs.write("log", chosen, mesh, info_of(stream.camera), MemoryFolder(tmp_path))


def test_invisible_surface_has_no_figures(tmp_path: Path):
    log = wall(tmp_path / "log")
    stream = labelfusion.read(log, parse_camera("40 40 23.5 19.5 48 40"))
    chosen = posed_frames(stream)
    aside = trimesh.creation.box((0.1, 0.1, 0.1)).apply_translation((9.0, 0, 0))
    figures = pairs.write("log", chosen, aside, info_of(stream.camera), MemoryFolder(tmp_path))
    assert figures == {"completeness": 0.0, "residual_m": None, "ndp": None}
