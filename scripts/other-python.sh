#!/usr/bin/env bash
# The README and the examples of the docstrings with another Python: bash scripts/other-python.sh 3.13
# Outside platforms.yml, on a Linux machine whose registry has no build of torch for the processor alone: of the
# build for CUDA, some 0.5 GB, it leaves out the 3 GB of NVIDIA's libraries. Empty ones stand in for them, whose
# functions all return 100, "no device"; what torch computes on the processor is as it comes.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

version=$1
python=
for candidate in "python$version" "${PYENV_ROOT:-$HOME/.pyenv}/versions/$version".*/bin/python; do
    if "$candidate" -c '' 2>/dev/null; then # pyenv puts names on PATH that start nothing
        python=$candidate
        break
    fi
done
if [ -z "$python" ]; then
    echo "other-python: no Python $version on this machine, nothing was tried"
    exit
fi

home=build/python-$version
rm -rf "$home"
trap 'rm -rf "$home"' EXIT
"$python" -m venv "$home"
install() { "$home/bin/python" -m pip install -q --no-compile --disable-pip-version-check --no-input -c constraints.txt "$@"; }
install --no-deps torch
packages=$("$home/bin/python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
sed -i '/^Requires-Dist: \(nvidia\|cuda\|triton\)/d' "$packages"/torch-*.dist-info/METADATA
.venv/bin/python scripts/without_cuda.py "$packages/torch/lib"
install -e '.[figures,calibration,stimuli,serve,netcdf]' pytest pytest-timeout pytest-xdist hypothesis
# An example makes a board's image; there is no compiler in the new environment, but what was built is found.
.venv/bin/python -c 'from firmware_io.c_library import pico_program; pico_program("pico")'
"$home/bin/python" -m pytest -q -p no:cacheprovider -m "slow or not slow" \
    tests/packaging/test_documentation.py -k "docstrings_run and not planning or README"
