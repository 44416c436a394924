"""Trained models, and files of the validation, of the fuzz tests."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from starling.diagnosis.validation.camera import light, nominal
from starling.diagnosis.validation.protocol import case, limits, seal, verdict
from tests.system import mutations
from tests.system.fuzzed_parts import (
    PINHOLE,
    SHAPE,
    Format,
    as_json,
    plain_file,
)

_TOML, _JSON, _WORDS = mutations.toml_text, mutations.json_text, mutations.words
_NPZ = mutations.zip_archive


# Trained models.


def _network() -> Any:
    import torch

    return torch.nn.Linear(3, 4)


def _write_checkpoint(folder: Path) -> Path:
    from starling.learning.networks import checkpoint

    checkpoint.save_network(folder, "tiny", _network(), ("a", "b"), (24, 32))
    return checkpoint.network_path(folder, "tiny")


def _read_checkpoint(path: Path) -> object:
    from starling.learning.networks import checkpoint

    return checkpoint.load_network(path.parent, "tiny", _network(), ("a", "b"))


def _write_trees(folder: Path) -> Path:
    from starling.learning.features.features import names
    from starling.learning.methods import model_file

    arrays = {
        "feature": np.array([0, -1, -1], np.int32),
        "threshold": np.array([0.5, 0.0, 0.0]),
        **{"left": np.array([1, 0, 0], np.int32), "right": np.array([2, 0, 0], np.int32)},
        **{"value": np.array([0.0, -1.0, 1.0]), "root": np.array([0], np.int32)},
        **{"start": np.array(-1.0), "recalibration": np.array([1.0, 0.0])},
        "names": np.array(names(with_reflectance=False, with_physics=False)),
        "projector_x_m": np.array(0.02),
    }
    return model_file.write(folder, "trees", 1, arrays)


def _read_trees(path: Path) -> object:
    from starling.learning.methods.trees import Trees

    predictor: Any = Trees().load(path.parent)
    return predictor.forest.logit(np.zeros((4, 30), np.float32))


def _model(kind: str, arrays: dict[str, Any]) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        from starling.learning.methods import model_file

        return model_file.write(folder, kind, 1, {k: np.array(v) for k, v in arrays.items()})

    return write


def _read_simple(path: Path) -> object:
    from starling.learning.methods.baselines import Simple

    return Simple().load(path.parent)


def _read_recalibrated(path: Path) -> object:
    from starling.learning.methods.physics import Simulated

    predictor: Any = Simulated(recalibrated=True).load(path.parent)
    return predictor.recalibration(np.array([0.1, 0.9]))


def _write_physics(folder: Path) -> Path:
    from starling.learning.data import physics
    from starling.learning.data.example import Physics
    from starling.learning.methods import model_file

    kinds = {"one_draw_ndp": np.bool_, "reason": np.uint32}
    values: dict[str, Any] = {
        field.name: np.ones(SHAPE, kinds.get(field.name, np.float32))
        for field in dataclasses.fields(Physics)
    }
    physics.write_physics(folder, "k", Physics(**{**values, "draws": 8}))
    return model_file.path_of(folder, "k")


def _read_physics(path: Path) -> object:
    from starling.learning.data import physics

    return physics.read_physics(path.parent, "k")


def _read_model_record(path: Path) -> object:
    from starling.learning import registry
    from starling.learning.commands import train_captures

    return registry.method(train_captures.trained_method(path.parent))


# Files of the validation with withheld effects.

_VERDICT = {
    **{"verdict": "effects", "seconds": 12.5, "baselines": {"largest_drop": "readout"}},
    "effects": [
        {
            **{"name": "readout", "arm": "image", "gain": 3.5, "set": ["readout"]},
            **{"parameters": {"readout": 2.0}, "interval": [1.5, 2.5], "stand_in": False},
        }
    ],
    "left": {"image": {"beyond": 0.1, "below": 0.2}, "depth": {"beyond": 0.3, "below": 0.2}},
    "howfar": {"auc": {"closed_pct": 50.0}, "fill": {"closed_pct": None}},
    "baselines_by_arm": {"image": {"cosine": None}, "depth": {"cosine": "readout"}},
}


_CASES = (
    case.Case(number=0, kind="single", settings={"flicker": 0.1}, seed=1),
    case.Case(number=1, kind="null", seed=2),
)
_FAMILIES = {"flicker": {"family": "flicker"}, "ambient": {"family": "ambient"}}


def _read_cases(path: Path) -> object:
    return case.loads(path.read_text(encoding="utf-8", errors="replace"))


def _read_families(path: Path) -> object:
    return seal.parse_families(path.read_bytes())


def _write_seal(folder: Path) -> Path:
    public = {seal.FAMILIES: as_json(_FAMILIES)}
    seal.seal(_CASES, public, folder / "hidden", folder / "public")
    return folder / "public" / seal.SEAL


def _verify_seal(path: Path) -> object:
    families = (path.parent / seal.FAMILIES).read_bytes()
    return seal.verify({seal.FAMILIES: families}, path.parent.parent / "hidden", path.parent)


def _write_light(folder: Path) -> Path:
    arrays = {
        f"{side}_{field.name}": np.array([0.0, -1.0, 0.0])
        if field.name == "up"
        else np.ones(SHAPE, np.uint32 if field.name == "body" else np.float32)
        for side in light.SIDES
        for field in dataclasses.fields(light.LightView)
    }
    np.savez(folder / light.FILE, **arrays)
    return folder / light.FILE


def _read_light(path: Path) -> object:
    return light.read(path, SHAPE)


_NOMINAL = {
    **{field.name: 1 for field in dataclasses.fields(nominal.Nominal)},
    **PINHOLE,
    "has": ["gain"],
}


def _read_nominal(path: Path) -> object:
    return nominal.read(path), nominal.read_existing_effects(path)


FORMATS = {
    "checkpoint": Format(
        write=_write_checkpoint, read=_read_checkpoint, mutator=mutations.torch_archive, native=True
    ),
    "trees": Format(write=_write_trees, read=_read_trees, mutator=_NPZ, native=True),
    "simple": Format(
        write=_model("simple", {"angle_deg": [10.0, 80.0], "share": [0.1, 0.5]}),
        read=_read_simple,
        mutator=_NPZ,
    ),
    "recalibration": Format(
        write=_model("physics_recalibrated", {"slope": 1.0, "offset": 0.1}),
        read=_read_recalibrated,
        mutator=_NPZ,
    ),
    "physics": Format(write=_write_physics, read=_read_physics, mutator=_NPZ),
    "model's starling.json": Format(
        write=plain_file(
            "starling.json", as_json({"verb": "train", "arguments": {"method": "network"}})
        ),
        read=_read_model_record,
        mutator=_JSON,
    ),
    "verdict": Format(
        write=plain_file("000.json", as_json(_VERDICT)), read=verdict.read, mutator=_JSON
    ),
    "truth of the cases": Format(
        write=plain_file("truth.json", case.dumps(_CASES).encode()), read=_read_cases, mutator=_JSON
    ),
    "families": Format(
        write=plain_file("families.json", as_json(_FAMILIES)), read=_read_families, mutator=_JSON
    ),
    "seal": Format(write=_write_seal, read=_verify_seal, mutator=_WORDS),
    "detection limits": Format(
        write=plain_file("detection.json", limits.FILE.read_bytes()),
        read=limits.read,
        mutator=_JSON,
    ),
    "nominal.json": Format(
        write=plain_file("nominal.json", as_json(_NOMINAL)), read=_read_nominal, mutator=_JSON
    ),
    "light.npz": Format(write=_write_light, read=_read_light, mutator=_NPZ),
}
