#!/bin/sh
# Make the environment in which Cycles renders light for the check on withheld effects, apart from
# Starling's own: Blender's module wants Python 3.11 exactly and numpy 1, and its licence is the GPL.
#
# Usage: tools/blender.sh [FOLDER]      (default: .blender beside this folder; about 1 GB)
#
# Then: python -m starling.diagnosis.validation.adapters cycles_light LIGHT OUT --blender FOLDER/bin/python
# A second call finds everything done and returns at once. PYTHON chooses the interpreter.
set -eu
folder=${1:-$(cd "$(dirname "$0")/.." && pwd)/.blender}
python=${PYTHON:-python3.11}

refuse() {
    echo "blender: $*" >&2
    exit 1
}

loads() { "$folder/bin/python" -I -c 'import bpy' 2>&1; }

[ ! -x "$folder/bin/python" ] || ! loads >/dev/null || exit 0
"$python" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' 2>/dev/null ||
    refuse "PYTHON must be Python 3.11; got $python. Install it or name it: PYTHON=/path/to/python3.11 $0"
"$python" -m venv "$folder" >/dev/null 2>&1 ||
    refuse "$python must make virtual environments; it cannot in $folder. Install python3.11-venv."
log=$folder/install.log
echo "blender: installing bpy (300 MB, minutes the first time)" >&2
"$folder/bin/python" -m pip install --disable-pip-version-check 'bpy==4.5.*' 'numpy<2' >"$log" 2>&1 ||
    refuse "bpy 4.5 must be among the packages for this machine; got: $(grep -i error "$log" | tail -n 1). See $log."
said=$(loads) || refuse "bpy must load; got: $(echo "$said" | tail -n 1). Install the library it names."
