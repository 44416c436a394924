"""Selection of Mitsuba's variant and of the LLVM library."""

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from starling.sim.render import backend

ROOT = Path(__file__).parents[3]


def answer(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run code in a new process, since the variant is chosen once per process."""
    return subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )


def library(folder: Path, name: str) -> str:
    (folder / name).write_bytes(b"")
    return str(folder / name)


def test_the_newest_supported_llvm_is_selected(tmp_path, monkeypatch):
    for name in ("libLLVM-15.so.1", "libLLVM-17.so.1", "libLLVM.so.19.1", "libLLVM-14.so"):
        library(tmp_path, name)
    monkeypatch.setattr(backend, "_PATTERNS", (str(tmp_path / "libLLVM*.so*"),))
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    assert list(backend.llvm_libraries().values()) == [19, 17, 15, 14]
    assert backend.llvm_library() == str(tmp_path / "libLLVM.so.19.1")


def test_old_llvm_is_skipped_unless_chosen_by_the_user(tmp_path, monkeypatch):
    library(tmp_path, "libLLVM-15.so.1")
    monkeypatch.setattr(backend, "_PATTERNS", (str(tmp_path / "libLLVM*.so*"),))
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    assert backend.llvm_library() is None
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", "/own/libLLVM.so")
    assert backend.llvm_library() == "/own/libLLVM.so"


def test_without_llvm_a_warning_precedes_scalar_rendering():
    process = answer(
        "from starling.sim.render import backend; backend._PATTERNS = ();"
        "print(backend.mitsuba().variant())",
        DRJIT_LIBLLVM_PATH="",
    )
    assert process.returncode == 0
    if "cuda" not in process.stdout:
        assert process.stdout.strip() == "scalar_rgb"
        assert "no libLLVM >= 16 was found" in process.stderr


def test_an_unknown_variant_is_refused():
    process = answer(
        "from starling.sim.render import backend; backend.mitsuba()", STARLING_VARIANT="llvm_rgb"
    )
    assert "STARLING_VARIANT must be a known name; got 'llvm_rgb'" in process.stderr


def test_a_variant_that_cannot_run_is_refused():
    code = "from starling.sim.render import backend; backend._PATTERNS = (); backend.mitsuba()"
    process = answer(code, STARLING_VARIANT="llvm_ad_mono", DRJIT_LIBLLVM_PATH="")
    assert "BackendError: STARLING_VARIANT must name a variant that runs here" in process.stderr


def test_the_refusal_of_a_variant_reaches_the_user_as_one_line():
    command = [sys.executable, "-m", "starling", "doctor"]
    environment = {**os.environ, "STARLING_VARIANT": "nonsense"}
    process = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    assert process.returncode == 1
    assert len(process.stderr.strip().splitlines()) == 1


def test_report_contains_the_relevant_facts():
    report = backend.report()
    assert report["variant"] in backend.VARIANTS
    assert {"llvm", "gpu", "cores", "python", "versions"} <= report.keys()
    assert report["versions"]["mitsuba"]


def test_only_jit_variants_compile(monkeypatch):
    class Scalar:
        @staticmethod
        def variant() -> str:
            return "scalar_rgb"

    monkeypatch.setattr(backend, "mitsuba", lambda: Scalar)
    assert not backend.is_jit()


def test_renderer_reports_the_llvm_version_without_path(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "libLLVM-19.so").write_bytes(b"")
    (tmp_path / "libLLVM.so").symlink_to("libLLVM-19.so")
    stand_in = SimpleNamespace(variant=lambda: "llvm_ad_mono")
    monkeypatch.setattr(backend, "mitsuba", lambda: stand_in)
    monkeypatch.setattr(backend, "llvm_library", lambda: str(tmp_path / "libLLVM.so"))
    monkeypatch.setattr(backend, "llvm_libraries", lambda: {str(tmp_path / "libLLVM-19.so"): 19})
    assert backend.renderer() == {"variant": "llvm_ad_mono", "llvm": 19}
    monkeypatch.setattr(backend, "llvm_library", lambda: "/own/libLLVM.so")
    assert backend.renderer() == {"variant": "llvm_ad_mono", "llvm": None}
    stand_in.variant = lambda: "scalar_rgb"
    assert backend.renderer() == {"variant": "scalar_rgb", "llvm": None}
