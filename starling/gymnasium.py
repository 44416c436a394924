"""Depth observations of Gymnasium environments as a camera returns them; needs `gymnasium`.

Examples:
    >>> env = starling.gymnasium.RealisticDepth(env, camera_matrix, "d435", key="depth")
    >>> observation, _ = env.reset(seed=0)
    >>> observation["depth"].dtype
    dtype('float32')
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, SupportsFloat

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.batch import handoff
from starling.sim.corrupt import Corruptor, HoleModel
from starling.sim.effects import Value
from starling.sim.sensor import edits, presets
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.post.temporal import History
from starling.sim.warp import depth_input

try:
    import gymnasium
    from gymnasium import spaces
except ImportError:
    raise errors.needs("starling.gymnasium", "gymnasium", "gymnasium") from None

_FINAL = "final_obs"  # Last observations of episodes, where a vector resets in the same step.
_SEEDS = 2**31  # Number of seeds from which an episode without one draws its own.


class _EpisodeSeeds:
    """Seeds of the noise: that of a reset, or one drawn after it.

    The random numbers of the environment itself are left alone.
    """

    def __init__(self, seed: int | None) -> None:
        """Start before the first episode; None starts differently each time."""
        self._draws = np.random.default_rng(seed)

    def following(self, seed: int | None) -> int:
        """Seed of the next episode, whose reset has this seed or none."""
        if seed is None:
            return int(self._draws.integers(_SEEDS))
        self._draws = np.random.default_rng(seed)
        return int(seed)


class _RealisticObservations:
    """Observations whose depth image is replaced, one after the other."""

    _key: str | None
    _rgb_key: str | None
    _frame: int

    def _corrupted(self, observation: Any) -> Any:
        clean = observation if self._key is None else observation[self._key]
        depth = self._depth(clean, None if self._rgb_key is None else observation[self._rgb_key])
        self._frame += 1
        return depth if self._key is None else {**observation, self._key: depth}

    @abstractmethod
    def _depth(self, clean: Any, rgb: Any) -> Any:
        """Depth as the camera returns it, of a clean image or batch and its colours."""


class RealisticDepth(_RealisticObservations, gymnasium.Wrapper):
    """Replaces a clean depth image in the observations of an environment.

    Images keep their size and camera. Each step has noise of its own, each episode another seed.
    A temporal filter of the sensor goes on from step to step.
    """

    def __init__(
        self,
        env: gymnasium.Env[Any, Any],
        camera_matrix: NDArray[np.floating],
        sensor: Sensor | Path | str = "d435",
        *,
        key: str | None = "depth",
        rgb_key: str | None = None,
        missing: float = 0.0,
        effects: Mapping[str, Value] | None = None,
        residual: HoleModel | None = None,
    ) -> None:
        """Wrap an environment.

        Args:
            env: environment whose depth is (h, w) or (h, w, 1), in metres along the optical axis.
            camera_matrix: (3, 3) intrinsics of the depth image [px].
            sensor: depth camera to imitate, or its name as for `starling.load_sensor`.
            key: entry of the observation that is the depth image; None if it is all of it.
            rgb_key: entry with the colour image (h, w, 3) uint8, as a hint of reflectance.
            missing: value of pixels without depth, a finite number.
            effects: strengths as for `starling.apply_effects`.
            residual: removes depth where a trained model does; from `starling.load_residual`.

        Raises:
            InputError: if the observation has no such image, or as `starling.Corruptor`.
        """
        super().__init__(env)
        space, self.observation_space = _spaces(env.observation_space, key, rgb_key, missing)
        self._key, self._rgb_key, self._missing = key, rgb_key, np.float32(missing)
        self._shape = tuple(space.shape)
        self.corruptor = _corruptor(sensor, camera_matrix, self._shape, effects, residual)
        self._seeds = _EpisodeSeeds(None)
        self._seed, self._frame = 0, 0
        self._history: History | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Reset the environment, and the noise by its seed."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._seed, self._frame, self._history = self._seeds.following(seed), 0, None
        return self._corrupted(observation), info

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Step the environment."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        return self._corrupted(observation), reward, terminated, truncated, info

    def _depth(self, clean: Any, rgb: Any) -> Any:
        image = np.asarray(clean).reshape(self._shape[:2])
        lit = self.corruptor.light(image, reflectance=rgb, empty=True)
        reading = self.corruptor.read(lit, seed=self._seed, frame=self._frame, past=self._history)
        self._history = reading.history
        depth = np.where(np.isfinite(reading.depth_m), reading.depth_m, self._missing)
        return depth.astype(np.float32).reshape(self._shape)


class RealisticDepthVector(_RealisticObservations, gymnasium.vector.VectorWrapper):
    """Replaces clean depth images in the observations of a vector of environments.

    Torch tensors stay on their device (`starling.Corruptor.batch`). NumPy arrays are computed by
    the same kernels on the processor. Where a vector resets in the same step, `final_obs` has
    realistic depth too.
    """

    def __init__(
        self,
        env: gymnasium.vector.VectorEnv[Any, Any, Any],
        camera_matrix: NDArray[np.floating],
        sensor: Sensor | Path | str = "d435",
        *,
        key: str | None = "depth",
        rgb_key: str | None = None,
        missing: float = 0.0,
        effects: Mapping[str, Value] | None = None,
        seed: int = 0,
    ) -> None:
        """Wrap a vector of environments.

        Args:
            env: environments whose depth is (n, h, w) or (n, h, w, 1), in metres.
            camera_matrix: as in `RealisticDepth`.
            sensor: as in `RealisticDepth`.
            key: as in `RealisticDepth`.
            rgb_key: as in `RealisticDepth`.
            missing: as in `RealisticDepth`.
            effects: as in `RealisticDepth`.
            seed: seed of the noise until a reset has one.

        Raises:
            InputError: as `RealisticDepth`, and as `starling.Corruptor.batch`.
        """
        super().__init__(env)
        space, single = _spaces(env.single_observation_space, key, rgb_key, missing)
        self._key, self._rgb_key, self._missing = key, rgb_key, float(missing)
        self.single_observation_space = single
        self.observation_space = gymnasium.vector.utils.batch_space(single, env.num_envs)
        self._size = tuple(space.shape)[:2]
        self.corruptor = _corruptor(sensor, camera_matrix, self._size, effects, None)
        self._seeds = _EpisodeSeeds(errors.whole_number("seed", seed, 0, 2**63 - 1))
        self._seed, self._frame = 0, 0

    def reset(
        self, *, seed: Any = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Reset the environments, and the noise by the first seed."""
        observation, info = self.env.reset(seed=seed, options=options)
        first = seed if seed is None or isinstance(seed, int) else seed[0]
        self._seed, self._frame = self._seeds.following(first), 0
        return self._corrupted(observation), info

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Step the environments."""
        observation, reward, terminated, truncated, info = self.env.step(actions)
        seen, final = self._corrupted(observation), info.get(_FINAL)
        if isinstance(final, np.ndarray) and final.dtype == object:
            info = {**info, _FINAL: self._corrupted_ends(final)}
        return seen, reward, terminated, truncated, info

    def _corrupted_ends(self, observations: NDArray[np.object_]) -> NDArray[np.object_]:
        """Observations of single environments, None where there is none, with realistic depth."""
        places = [place for place, seen in enumerate(observations) if seen is not None]
        if not places:
            return observations
        result, key, parts = observations.copy(), self._key, observations[places]
        rgb = None if self._rgb_key is None else np.stack([seen[self._rgb_key] for seen in parts])
        clean = np.stack([seen if key is None else seen[key] for seen in parts])
        depth = self._depth(clean, rgb)
        self._frame += 1
        for place, image in zip(places, depth, strict=True):
            result[place] = image if key is None else {**observations[place], key: image}
        return result

    def _depth(self, clean: Any, rgb: Any) -> Any:
        flat = clean.reshape(-1, *self._size)
        frame = {"seed": self._seed, "frame": self._frame}
        if isinstance(clean, np.ndarray):
            known = flat[np.isfinite(flat) & (flat > 0)]
            if known.size:
                depth_input.refuse_millimetres("depth", known)
            warp = handoff.import_warp()
            host = warp.array(np.ascontiguousarray(flat, np.float32), device="cpu")
            colours = None if rgb is None else warp.array(np.ascontiguousarray(rgb), device="cpu")
            seen = self.corruptor.batch(host, reflectance=colours, **frame).depth_m.numpy()
            return np.nan_to_num(seen, nan=self._missing).reshape(clean.shape)
        seen = self.corruptor.batch(flat.float(), reflectance=rgb, **frame).depth_m
        return seen.nan_to_num(nan=self._missing).reshape(clean.shape)


def _spaces(
    space: spaces.Space[Any], key: str | None, rgb_key: str | None, missing: float
) -> tuple[spaces.Box, spaces.Space[Any]]:
    """Space of the clean depth image, and of observations with the realistic one."""
    clean = _entry(space, key)
    if rgb_key is not None:
        _entry(space, rgb_key)
    if len(clean.shape) == 3 and clean.shape[2] != 1:
        raise errors.refuse("depth", "must be (h, w) or (h, w, 1)", clean.shape, "Give its key.")
    if clean.dtype is None or clean.dtype.kind != "f":
        rule = "must be floating-point numbers in metres"
        raise errors.refuse("depth", rule, clean.dtype, "Divide millimetres by 1000.")
    largest = float(np.finfo(np.float32).max)
    errors.in_interval("missing", missing, -largest, largest, "Give a finite number, such as 0.")
    depth = spaces.Box(min(missing, 0.0), np.inf, clean.shape, np.float32)
    if key is None:
        return clean, depth
    assert isinstance(space, spaces.Dict)  # Checked by `_entry`.
    return clean, spaces.Dict({**space.spaces, key: depth})


def _entry(space: spaces.Space[Any], key: str | None) -> spaces.Box:
    """The space of an image in an observation."""
    part: Any = space
    if key is not None:
        if not isinstance(space, spaces.Dict):
            advice = "Give key=None if the observation is the image."
            raise errors.refuse("observation", "must be a Dict space", type(space).__name__, advice)
        errors.one_of("key", key, space.spaces)
        part = space.spaces[key]
    if not isinstance(part, spaces.Box) or len(part.shape) not in (2, 3):
        rule = f"must be an image (h, w) or (h, w, channels) at {key or 'its top'}"
        raise errors.refuse("observation", rule, part, "Give its key.")
    return part


def _corruptor(
    sensor: Sensor | Path | str,
    camera_matrix: NDArray[np.floating],
    shape: tuple[int, ...],
    effects: Mapping[str, Value] | None,
    residual: HoleModel | None,
) -> Corruptor:
    """A corruptor whose images have the size and camera of the observation."""
    height, width = shape[:2]
    device = edits.with_camera(presets.resolved(sensor), camera_matrix, (width, height))
    return Corruptor(device, camera_matrix, effects=effects, residual=residual)
