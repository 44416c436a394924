"""Wrappers of Gymnasium environments: depth as a camera returns it, noise by seed and step."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest

from starling.patterns import InputError

gymnasium = pytest.importorskip("gymnasium", reason="the package gymnasium is not installed")

from gymnasium import spaces  # noqa: E402

from starling.gymnasium import RealisticDepth, RealisticDepthVector  # noqa: E402

SHAPE = (120, 160)
MATRIX = np.array([[140, 0, 79.5], [0, 140, 59.5], [0, 0, 1]], np.float64)
DEVICE = {"camera_matrix": MATRIX, "sensor": "d435"}


class Room(gymnasium.Env):
    """A wall that comes nearer, with a box before it."""

    def __init__(self, *, channel: bool = False, whole: bool = False) -> None:
        shape = (*SHAPE, 1) if channel else SHAPE
        self._whole, self._shape = whole, shape
        depth = spaces.Box(0.0, 10.0, shape, np.float32)
        rgb = spaces.Box(0, 255, (*SHAPE, 3), np.uint8)
        entries = {"depth": depth, "rgb": rgb, "speed": spaces.Box(-1, 1, (2,), np.float32)}
        self.observation_space = depth if whole else spaces.Dict(entries)
        self.action_space = spaces.Discrete(2)
        self._steps = 0

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self._steps = 0
        return self._observe(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self._steps += 1
        return self._observe(), 1.0, False, self._steps > 5, {"steps": self._steps}

    def _observe(self) -> Any:
        depth = np.full(SHAPE, 1.5 - 0.05 * self._steps, np.float32)
        depth[40:80, 60:100] -= 0.4
        depth = depth.reshape(self._shape)
        rgb = np.full((*SHAPE, 3), 200, np.uint8)
        return depth if self._whole else {"depth": depth, "rgb": rgb, "speed": np.zeros(2, "f4")}


@pytest.mark.parametrize("options", [{}, {"channel": True}, {"whole": True}])
def test_observations_have_holes_and_stay_in_their_space(options):
    key = None if options.get("whole") else "depth"
    env = RealisticDepth(Room(**options), **DEVICE, key=key, rgb_key=None if key is None else "rgb")
    seen, _ = env.reset(seed=1)
    assert env.observation_space.contains(seen)
    depth = seen if key is None else seen[key]
    assert 0 < (depth == 0).mean() < 0.5
    assert np.median(depth[depth > 0]) == pytest.approx(1.5, abs=0.05)
    seen, reward, _, _, info = env.step(0)
    assert env.observation_space.contains(seen) and reward == 1.0 and info == {"steps": 1}


def test_noise_is_that_of_seed_and_step():
    env = RealisticDepth(Room(), **DEVICE)
    first = env.reset(seed=1)[0]["depth"]
    following = env.reset()[0]["depth"]
    assert (env.reset(seed=2)[0]["depth"] != first).any()
    np.testing.assert_array_equal(env.reset(seed=1)[0]["depth"], first)
    np.testing.assert_array_equal(env.reset()[0]["depth"], following)
    assert (following != first).any()
    assert (env.reset()[0]["depth"] != following).any()


def test_the_environment_s_own_random_numbers_stay():
    plain, wrapped = Room(), RealisticDepth(Room(), **DEVICE)
    for env in (plain, wrapped):
        env.reset(seed=1)
        env.reset()
    assert plain.np_random.random() == wrapped.unwrapped.np_random.random()


@pytest.mark.parametrize("missing", [-1.0, 0.0, 7.0])
def test_missing_depth_is_in_the_space(missing):
    env = RealisticDepth(Room(), **DEVICE, missing=missing)
    seen, _ = env.reset(seed=1)
    assert (seen["depth"] == missing).any() and env.observation_space.contains(seen)


@pytest.mark.parametrize("missing", [np.nan, np.inf, "none"])
def test_missing_depth_is_a_number(missing):
    with pytest.raises(InputError, match="missing must be in"):
        RealisticDepth(Room(), **DEVICE, missing=missing)


def test_a_temporal_filter_goes_on_from_step_to_step():
    depths = []
    for effects in ({}, {"temporal_filter": 0.4}):
        env = RealisticDepth(Room(), **DEVICE, effects=effects)
        env.reset(seed=1)
        depths.append(env.step(0)[0]["depth"])
    assert (depths[0] != depths[1]).any()


def test_images_without_a_surface_have_no_depth():
    class Sky(Room):
        def _observe(self) -> Any:
            return {**super()._observe(), "depth": np.full(SHAPE, np.inf, np.float32)}

    assert (RealisticDepth(Sky(), **DEVICE).reset(seed=1)[0]["depth"] == 0).all()


def test_vectors_have_depth_of_their_own():
    pytest.importorskip("warp", reason="the package warp-lang is not installed")
    rooms = gymnasium.vector.SyncVectorEnv([Room, Room])
    env = RealisticDepthVector(rooms, **DEVICE, rgb_key="rgb")
    seen, _ = env.reset(seed=1)
    assert seen["depth"].shape == (2, *SHAPE) and seen["depth"].dtype == np.float32
    assert (seen["depth"][0] != seen["depth"][1]).any()
    assert 0 < (seen["depth"] == 0).mean() < 0.5
    again, *_ = env.step(np.zeros(2, int))
    assert (again["depth"] != seen["depth"]).any()
    np.testing.assert_array_equal(env.reset(seed=[1, 2])[0]["depth"], seen["depth"])
    assert (env.reset()[0]["depth"] != seen["depth"]).any()
    assert (env.reset(seed=[None, 2])[0]["depth"] != seen["depth"]).any()
    assert env.observation_space["depth"].shape == (2, *SHAPE)
    torch = pytest.importorskip("torch", reason="torch is not installed")
    tensors = {name: torch.as_tensor(seen[name]) for name in ("depth", "rgb")}
    tensors["depth"] = torch.full((2, *SHAPE), 1.5)
    env = RealisticDepthVector(rooms, **DEVICE)
    depth = env._corrupted(tensors)["depth"]
    assert isinstance(depth, torch.Tensor) and depth.shape == (2, *SHAPE)
    assert 0 < (depth == 0).float().mean() < 0.5


@pytest.mark.parametrize("options", [{}, {"whole": True}])
def test_last_observations_have_realistic_depth(options):
    pytest.importorskip("warp", reason="the package warp-lang is not installed")
    mode = gymnasium.vector.AutoresetMode.SAME_STEP
    rooms = [lambda: gymnasium.wrappers.TimeLimit(Room(**options), 2), lambda: Room(**options)]
    vector = gymnasium.vector.SyncVectorEnv(rooms, autoreset_mode=mode)
    key = None if options else "depth"
    env = RealisticDepthVector(vector, **DEVICE, key=key, rgb_key=None if key is None else "rgb")
    env.reset(seed=1)
    info = [env.step(np.zeros(2, int))[-1] for _ in range(2)][-1]
    last, running = info["final_obs"]
    depth = last if key is None else last["depth"]
    assert running is None and depth.shape == SHAPE
    assert 0 < (depth == 0).mean() < 0.5
    assert env._corrupted_ends(np.array([None, None])).tolist() == [None, None]


def test_millimetres_are_refused():
    class Coarse(Room):
        def _observe(self) -> Any:
            seen = super()._observe()
            return {**seen, "depth": 1000 * seen["depth"]}

    pytest.importorskip("warp", reason="the package warp-lang is not installed")
    env = RealisticDepthVector(gymnasium.vector.SyncVectorEnv([Coarse]), **DEVICE)
    with pytest.raises(InputError, match=r"depth must be in metres; got a median of 1500\."):
        env.reset(seed=1)
    room = Room()
    room.observation_space["depth"] = spaces.Box(0, 9999, SHAPE, np.uint16)
    with pytest.raises(InputError, match=r"depth must be floating-point numbers in metres; got ui"):
        RealisticDepth(room, **DEVICE)


def test_a_negative_seed_is_refused():
    rooms = gymnasium.vector.SyncVectorEnv([Room])
    with pytest.raises(InputError, match="seed must be an integer"):
        RealisticDepthVector(rooms, **DEVICE, seed=-1)


def test_observations_without_the_image_are_refused():
    for room, options, message in (
        (Room(), {"key": "dept"}, "key must be a known name; got 'dept'"),
        (Room(), {"key": "speed"}, "observation must be an image"),
        (Room(), {"key": None}, "observation must be an image"),
        (Room(), {"key": "rgb"}, r"depth must be \(h, w\) or \(h, w, 1\)"),
        (Room(), {"rgb_key": "colour"}, "key must be a known name; got 'colour'"),
        (Room(whole=True), {}, "observation must be a Dict space"),
    ):
        with pytest.raises(InputError, match=message):
            RealisticDepth(room, **DEVICE, **options)


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    monkeypatch.delitem(sys.modules, "starling.gymnasium")
    with pytest.raises(InputError, match=r"starling\.gymnasium needs gymnasium"):
        import starling.gymnasium  # noqa: F401
