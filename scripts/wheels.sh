#!/usr/bin/env bash
# Builds the sdist and a wheel for each platform into dist/, also in a fresh clone: its tools are those of
# .venv, or else an environment of its own in build/.
#   TARGETS="linux-x86_64" bash scripts/wheels.sh    builds that platform's alone (see hatch_build.py)
#   PYTHON=python bash scripts/wheels.sh             with the tools of that Python
#   OUT=folder bash scripts/wheels.sh                into another folder
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

in_environment() { echo "$1"/*/python | cut -d ' ' -f 1; } # bin, or Scripts on Windows
python=${PYTHON:-$(in_environment .venv)}
if ! "$python" -c "import hatchling, ziglang" 2> /dev/null; then
    [ -z "${PYTHON:-}" ] || { echo "$PYTHON has no hatchling and ziglang: scripts/release-requirements.txt" >&2; exit 1; }
    [ -d build/wheel-tools ] || "$(command -v python3 || command -v python)" -m venv build/wheel-tools
    python=$(in_environment build/wheel-tools)
    "$python" -m pip install --quiet --disable-pip-version-check --require-hashes -r scripts/release-requirements.txt
fi

"$python" -m hatchling build -t sdist -d "${OUT:-dist}"
for target in ${TARGETS:-linux-x86_64 linux-aarch64 windows-x86_64 macos-arm64 macos-x86_64}; do
    HAPTIX_TARGET=$target "$python" -m hatchling build -t wheel -d "${OUT:-dist}"
done
