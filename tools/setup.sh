#!/bin/sh
# Set up what a command of the Makefile needs: tools/setup.sh [run|test|docs]
#   run   .venv with the program itself (no torch), and an LLVM library for the fast variants
#   test  the same with the extras `learning` (torch first, so that pip keeps the build the
#         machine offers), `completion`, `data`, `ros`, `ray`, `batch`, `mujoco`, `gymnasium`,
#         `realsense`, `rerun`, `lerobot` and `dev`
#   docs  .venv with the program and what builds the documentation
# A second call finds everything done and returns at once. PYTHON chooses the interpreter.
set -eu
cd "$(dirname "$0")/.."
kind=${1:-run}

say() { echo "setup: $*" >&2; }

# Run a command as root: as we are, or by sudo where it asks for no password.
as_root() {
    if [ "$(id -u)" -eq 0 ]; then
        "$@"
    elif command -v sudo >/dev/null 2>&1 && sudo -n true 2>/dev/null; then
        sudo -n "$@"
    else
        return 1
    fi
}

# Install Debian packages, or return non-zero (not root, no apt-get, no such package).
debian_install() {
    command -v apt-get >/dev/null 2>&1 || return 1
    as_root true || return 1
    say "installing $* with apt-get"
    as_root env DEBIAN_FRONTEND=noninteractive sh -c \
        'apt-get update -qq && apt-get install -y -qq --no-install-recommends "$@"' sh "$@" \
        >"${TMPDIR:-/tmp}/starling-apt.$$" 2>&1 || {
        tail -n 3 "${TMPDIR:-/tmp}/starling-apt.$$" >&2
        rm -f "${TMPDIR:-/tmp}/starling-apt.$$"
        return 1
    }
    rm -f "${TMPDIR:-/tmp}/starling-apt.$$"
}

# Print the first interpreter of the supported versions.
find_python() {
    for candidate in ${PYTHON:-python3.11 python3 python3.12 python3.13}; do
        if "$candidate" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' \
            >/dev/null 2>&1; then
            echo "$candidate"
            return
        fi
    done
    return 1
}

make_venv() {
    python=$(find_python) || {
        debian_install python3 python3-venv && python=$(find_python) || {
            say "no Python 3.11 to 3.13 found. Install one (Debian 12: apt-get install" \
                "python3 python3-venv) or name it: make PYTHON=/path/to/python3.11 ..."
            exit 1
        }
    }
    if ! "$python" -c 'import ensurepip, venv' >/dev/null 2>&1; then
        version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
        debian_install "python$version-venv" || {
            say "$python cannot make virtual environments. Install them" \
                "(apt-get install python$version-venv) and run this again."
            exit 1
        }
    fi
    say "making .venv with $("$python" --version)"
    "$python" -m venv .venv
}

# Dr.Jit needs libatomic, which a minimal Debian lacks. Where it may not be installed it is
# unpacked beside Dr.Jit's own libraries, where the loader looks first.
get_libatomic() {
    .venv/bin/python -c 'import drjit' 2>/dev/null && return
    debian_install libatomic1 && .venv/bin/python -c 'import drjit' 2>/dev/null && return
    unpack_libatomic && .venv/bin/python -c 'import drjit' 2>/dev/null && return
    say "Dr.Jit cannot be loaded: $(.venv/bin/python -c 'import drjit' 2>&1 | grep -m 1 Error)." \
        "If it is libatomic: apt-get install libatomic1, then run this again."
    exit 1
}

unpack_libatomic() {
    rm -rf .venv/.libatomic && mkdir .venv/.libatomic || return 1
    (
        cd .venv/.libatomic && apt-get download -qq libatomic1 && dpkg-deb -x ./*.deb .
    ) >/dev/null 2>&1 || return 1
    say "libatomic1 may not be installed here: unpacked beside Dr.Jit instead"
    cp "$(find .venv/.libatomic -name 'libatomic.so.1' | head -n 1)" \
        "$(echo .venv/lib/python3.*/site-packages/drjit)/libatomic.so.1"
}

# LLVM: the program itself says which library it would take (it looks for 16 or newer).
llvm_found() {
    .venv/bin/python -c \
        'import sys; from starling.sim.render import backend; sys.exit(backend.llvm_library() is None)'
}

get_llvm() {
    llvm_found && return
    if [ ! -e .venv/.llvm-refused ]; then
        debian_install libllvm19 && llvm_found && return
        : >.venv/.llvm-refused # Asked once: not again at every call.
    fi
    say "no libLLVM >= 16 and none could be installed: going on in a slower, scalar variant." \
        "To mend it: apt-get install libllvm19, or set DRJIT_LIBLLVM_PATH."
}

# MuJoCo draws by EGL where there is no display. Tests that need it skip without.
get_egl() {
    [ "$kind" = test ] && [ ! -e .venv/.egl-refused ] || return 0
    .venv/bin/python -c 'import ctypes; ctypes.CDLL("libEGL.so.1")' 2>/dev/null && return
    debian_install libegl1 libgl1-mesa-dri || : >.venv/.egl-refused
}

# pyrealsense2 is linked against libusb. Tests that need it skip without.
get_libusb() {
    [ "$kind" = test ] && [ ! -e .venv/.libusb-refused ] || return 0
    .venv/bin/python -c 'import ctypes; ctypes.CDLL("libusb-1.0.so.0")' 2>/dev/null && return
    debian_install libusb-1.0-0 || : >.venv/.libusb-refused
}

pip_install() {
    say "installing $* (minutes the first time)"
    # Modules are compiled when they are first imported: compiling all takes longer than a minute.
    .venv/bin/python -m pip install --quiet --disable-pip-version-check --no-compile "$@"
}

# A stamp holds what the installation was made from: it is stale when that changes or moves.
stamp=.venv/.ready-$kind
wanted="$(pwd) $(cksum <pyproject.toml) $(echo ./*/__init__.py starling/*)"

if [ ! -x .venv/bin/python ] || ! .venv/bin/python -c '' 2>/dev/null; then
    make_venv
fi
if [ "$(cat "$stamp" 2>/dev/null || true)" != "$wanted" ]; then
    case $kind in
    run) pip_install -e . ;;
    test)
        pip_install "torch==2.13.0"
        pip_install -e '.[learning,completion,data,lerobot,ros,ray,batch,mujoco,gymnasium,scenes,dev]'
        pip_install -e '.[rerun]' || say "no rerun-sdk for this machine: its tests are skipped"
        pip_install -e '.[realsense]' || say "no pyrealsense2 for this machine: its tests are skipped"
        echo "$wanted" >.venv/.ready-run # It includes what `run` has.
        ;;
    docs) pip_install -e '.[docs]' ;;
    *)
        say "unknown set-up '$kind': run, test or docs"
        exit 2
        ;;
    esac
    [ "$kind" = docs ] || get_libatomic
    echo "$wanted" >"$stamp"
fi
[ "$kind" = docs ] || get_llvm
get_egl
get_libusb
