#!/usr/bin/env bash
# Installs the field's own tools, which read what haptix writes, for `make test-peers`; on Debian 12, into build/peers.
# 2 GB and some minutes: PsychoPy, Octave and others. Safe to run again; needs root, or sudo without a password.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
exec </dev/null # nothing here may wait for an answer

root() { if [ "$(id -u)" = 0 ]; then "$@"; else sudo -n "$@"; fi; }
root apt-get update -qq
root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq \
    octave-netcdf netcdf-bin nco xvfb libgl1-mesa-dri libglu1-mesa

mkdir -p build/peers
[ -x build/peers/venv/bin/python ] || .venv/bin/python -m venv build/peers/venv
build/peers/venv/bin/pip install -q -r tests/peers/requirements.txt
build/peers/venv/bin/pip install -q --no-deps --no-build-isolation clients/psychopy
# haptix itself is that of .venv, behind the tools' own packages
.venv/bin/python -c 'import sysconfig, pathlib; print(sysconfig.get_paths()["purelib"]); print(pathlib.Path.cwd())' \
    > "$(build/peers/venv/bin/python -c 'import sysconfig; print(sysconfig.get_paths()["purelib"])')/haptix.pth"
npm install --silent --no-audit --no-fund --prefix build/peers \
    @asyncapi/parser@3.6.3 @asyncapi/modelina@5.10.1 quicktype@23.3.25
touch build/peers/.ready
