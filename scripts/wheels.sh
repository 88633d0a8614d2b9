#!/usr/bin/env bash
# Builds the sdist and a wheel for each platform into dist/; needs the extra release.
#   TARGETS="linux-x86_64" bash scripts/wheels.sh    builds that platform's alone (see hatch_build.py)
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
python=${PYTHON:-.venv/bin/python}

"$python" -m hatchling build -t sdist -d dist
for target in ${TARGETS:-linux-x86_64 linux-aarch64 windows-x86_64 macos-arm64 macos-x86_64}; do
    HAPTIX_TARGET=$target "$python" -m hatchling build -t wheel -d dist
done
