#!/usr/bin/env bash
# Builds the bundle of this system by PyInstaller: build/bundle/haptix (haptix.app on macOS) with Python, PyTorch for
# the processor and haptix, and its archive in dist/. Works in a fresh clone; takes minutes, and 3 GB in build/.
#   TORCH_INDEX=https://download.pytorch.org/whl/cpu bash scripts/bundle.sh    where pip would take CUDA's
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

case $(uname) in
    Darwin) system=macos ;;
    Linux) system=linux ;;
    *) system=windows ;;
esac
machine=$(uname -m)
rm -rf build/bundle build/bundle-wheel
env -u PYTHON TARGETS=$system-$machine OUT=build/bundle-wheel bash scripts/wheels.sh
wheel=$(echo build/bundle-wheel/*.whl)

tools=build/bundle-tools
[ -d "$tools" ] || "$(command -v python3 || command -v python)" -m venv "$tools"
python=$(echo "$tools"/*/python | cut -d ' ' -f 1)
install() { "$python" -m pip install --quiet --disable-pip-version-check -c constraints.txt "$@"; }
install ${TORCH_INDEX:+--index-url "$TORCH_INDEX"} torch
"$python" -c "import torch; assert torch.version.cuda is None, 'PyTorch for the processor is expected: set TORCH_INDEX'"
install --force-reinstall --no-deps "$wheel"
install "${wheel}[serve,calibration,serial]" pyinstaller==6.16.0 pyinstaller-hooks-contrib==2026.9
# From bundle/: here the checkout's packages would take the place of the wheel's.
(cd bundle && "../$python" -m PyInstaller --noconfirm --log-level WARN --distpath ../build/bundle --workpath ../build/bundle-work haptix.spec)

name=haptix-$("$python" -c "from haptix import __version__; print(__version__)")-$system-$machine
mkdir -p dist
case $system in
    linux)
        for library in torch/lib/libtorch_cpu.so torch/lib/libtorch_python.so "libpython3.*.so.1.0"; do
            strip --strip-unneeded build/bundle/haptix/_internal/$library # the names in them: 115 MB
        done
        cp bundle/install.sh build/bundle/haptix/
        du -sm build/bundle/haptix
        tar -C build/bundle -czf "dist/$name.tar.gz" haptix
        ;;
    macos) ditto -c -k --keepParent build/bundle/haptix.app "dist/$name.zip" ;;
    windows) /c/Windows/System32/tar.exe -a -c -f "dist/$name.zip" -C build/bundle haptix ;;
esac
