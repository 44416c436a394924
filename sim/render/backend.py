"""The one place that chooses Mitsuba's variant and finds the LLVM library it needs."""

from __future__ import annotations

import glob
import os
import platform
import re
import warnings
from functools import cache
from typing import Any

from starling.patterns import errors
from starling.sim.console import record

VARIANTS = ("cuda_ad_mono", "llvm_ad_mono", "scalar_rgb")
_OLDEST_LLVM = 16  # 15 aborts the whole process on AVX-512 machines, 14 is refused by Dr.Jit.
_PLACES = (
    "/usr/lib/*/libLLVM*.so*",
    "/usr/lib/llvm-*/lib/libLLVM*.so*",
    "/usr/lib64/libLLVM*.so*",
    "/usr/local/lib/libLLVM*.so*",
    "/opt/homebrew/opt/llvm*/lib/libLLVM*.dylib",
)


class BackendError(RuntimeError):
    """No usable Mitsuba variant, or one that cannot do what is asked."""


class ScalarFallbackWarning(UserWarning):
    """No libLLVM was found: rendering goes on, slowly, without just-in-time compilation."""


def llvm_libraries() -> dict[str, int]:
    """Find the machine's LLVM libraries: path to major version, newest first."""
    found: dict[str, int] = {}
    for place in _PLACES:
        for path in glob.glob(place):
            version = re.search(r"libLLVM[-.](?:so\.|dylib\.)?(\d+)", os.path.basename(path))
            if version and os.path.realpath(path) not in map(os.path.realpath, found):
                found[path] = int(version[1])
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def llvm_library() -> str | None:
    """Return the library Dr.Jit shall load: the user's choice, else the newest that works."""
    chosen = os.environ.get("DRJIT_LIBLLVM_PATH")
    if chosen:
        return chosen
    return next((path for path, major in llvm_libraries().items() if major >= _OLDEST_LLVM), None)


@cache
def mitsuba() -> Any:
    """Import Mitsuba with the variant set, once a process.

    `STARLING_VARIANT` forces one of `VARIANTS`; else a GPU where there is one, else LLVM, else
    the scalar variant with a `ScalarFallbackWarning`.

    Raises:
        InputError: if `STARLING_VARIANT` names no known variant.
        BackendError: if the forced variant cannot run here.
    """
    library = llvm_library()
    if library:  # Must stand before the first import of Dr.Jit.
        os.environ["DRJIT_LIBLLVM_PATH"] = library
    import drjit as dr
    import mitsuba as mi

    forced = os.environ.get("STARLING_VARIANT")
    if forced:
        errors.one_of("STARLING_VARIANT", forced, VARIANTS)
    usable = {
        "cuda_ad_mono": lambda: bool(dr.has_backend(dr.JitBackend.CUDA)),
        "llvm_ad_mono": lambda: bool(library) and bool(dr.has_backend(dr.JitBackend.LLVM)),
        "scalar_rgb": lambda: True,
    }
    if forced and not usable[forced]():
        raise BackendError(
            f"STARLING_VARIANT must name a variant that runs here; got {forced}. "
            "Unset it, or install libllvm19 (LLVM) or an NVIDIA driver (CUDA)."
        )
    variant = forced or next(name for name in VARIANTS if usable[name]())
    if variant == "scalar_rgb" and not forced:
        warnings.warn(
            "no libLLVM >= 16 was found; rendering goes on in scalar_rgb, many times slower. "
            "Install libllvm19 or set DRJIT_LIBLLVM_PATH.",
            ScalarFallbackWarning,
            stacklevel=2,
        )
    mi.set_variant(variant)
    # Its warnings go to standard output, which belongs to results.
    mi.set_log_level(mi.LogLevel.Error)
    return mi


def drjit() -> Any:
    """Dr.Jit, imported only after its LLVM library has been named."""
    mitsuba()
    import drjit as dr

    return dr


def is_jit() -> bool:
    """Tell whether the chosen variant compiles kernels (and can differentiate)."""
    return "_ad_" in str(mitsuba().variant())


def report() -> dict[str, Any]:
    """Say what this machine can do: variant, LLVM, GPU and the versions that matter."""
    mi, dr = mitsuba(), drjit()
    return {
        "variant": str(mi.variant()),
        "llvm": llvm_library(),
        "llvm_found": llvm_libraries(),
        "gpu": bool(dr.has_backend(dr.JitBackend.CUDA)),
        "cores": os.cpu_count(),
        "machine": platform.machine(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "versions": record.versions(),
    }


def renderer() -> dict[str, Any]:
    """Tell what renders: Mitsuba's variant and the major version of LLVM, None where not used."""
    variant = str(mitsuba().variant())
    if not variant.startswith("llvm"):
        return {"variant": variant, "llvm": None}
    used = os.path.realpath(llvm_library() or "")
    majors = {os.path.realpath(path): major for path, major in llvm_libraries().items()}
    return {"variant": variant, "llvm": majors.get(used)}  # None: one the machine does not list.
