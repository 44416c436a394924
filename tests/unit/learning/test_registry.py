"""Creation of methods by name, and their imports."""

from __future__ import annotations

import dataclasses
import subprocess
import sys

import pytest

from starling.learning import registry
from starling.patterns.errors import InputError
from tests.unit.learning.step_scenes import step_scene

NETWORKS = ("network", "network_reflectance", "hybrid", "hybrid_reflectance", "pix2pix", "cyclegan")


@pytest.mark.parametrize("name", registry.NAMES)
def test_every_method_has_the_name_it_is_created_by(name):
    method = registry.method(name)
    assert method.name == name
    assert callable(method.fit) and callable(method.load)


@pytest.mark.parametrize("name", registry.NAMES)
def test_steps_apply_to_networks_only(name):
    plain, short = registry.method(name), registry.method(name, steps=7)
    if name not in NETWORKS:
        assert short == plain
        return
    assert short.settings.steps == 7  # type: ignore[attr-defined]
    assert plain.settings.steps > 7  # type: ignore[attr-defined]
    settings = dataclasses.replace(short.settings, steps=plain.settings.steps)  # type: ignore[attr-defined]
    assert settings == plain.settings  # type: ignore[attr-defined]


@pytest.mark.parametrize("steps", [0, -3])
@pytest.mark.parametrize("name", registry.NAMES)
def test_training_without_a_step_is_refused(name, steps):
    with pytest.raises(InputError, match=rf"steps must be .*; got {steps}\.") as caught:
        registry.method(name, steps=steps)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", registry.NAMES)
def test_some_networks_start_from_weights(name, tmp_path):
    if name not in registry.STARTABLE:
        with pytest.raises(InputError, match=f"start must be for one of hybrid, .*; got {name}"):
            registry.method(name, start=tmp_path)
        return
    plain, going_on = registry.method(name), registry.method(name, start=tmp_path)
    assert going_on.settings.start == tmp_path  # type: ignore[attr-defined]
    assert going_on.settings.steps < plain.settings.steps  # type: ignore[attr-defined]
    with_steps = registry.method(name, start=tmp_path, steps=5)
    assert with_steps.settings.steps == 5  # type: ignore[attr-defined]


def test_an_unknown_name_is_refused_with_the_closest_name_first():
    with pytest.raises(InputError) as caught:
        registry.method("hybird")
    line = str(caught.value)
    assert line.startswith("method must be a known name; got 'hybird'. Known: hybrid, ")
    assert all(name in line for name in registry.NAMES)


@pytest.mark.parametrize("name", sorted(registry.ON_PHYSICS))
def test_methods_with_physics_refuse_scenes_without_physics(name, tmp_path):
    scene = dataclasses.replace(step_scene(0), physics=None)
    with pytest.raises(InputError, match="physics must be given for a method that uses it"):
        method = registry.method(name, steps=1)
        method.fit([scene], folder=tmp_path, seed=0).probability(scene)


@pytest.mark.parametrize("name, package", [("hybrid", "torch"), ("trees", "sklearn")])
def test_missing_packages_are_named(name, package):
    """In a separate process without these imports."""
    code = (
        f"import sys; sys.modules['{package}'] = None\n"
        "from starling.learning import registry; from starling.patterns.errors import InputError\n"
        f"try: registry.method('{name}')\n"
        "except InputError as error: print(error)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.startswith(f"{name} needs {package}") == (package == "torch")


def test_simple_methods_import_no_torch_and_no_renderer():
    code = (
        "import sys; from starling.learning import registry;"
        "[registry.method(name) for name in ('perfect', 'simple', 'trees', 'physics')];"
        "print([m for m in ('torch', 'mitsuba', 'sklearn', 'matplotlib') if m in sys.modules])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"
