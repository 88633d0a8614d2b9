#!/usr/bin/env bash
# Makes tests/firmware_io/pico/rp2350js.mjs again from its source, which no registry has: the emulator of the RP2350.
# Git keeps what it makes, so that no test needs GitHub. A clone may be named instead: scripts/rp2350js.sh FOLDER.
set -euo pipefail
to=$(realpath "$(dirname "${BASH_SOURCE[0]}")/../tests/firmware_io/pico/rp2350js.mjs")
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
git clone --quiet --no-checkout "${1:-https://github.com/c1570/rp2350js}" "$folder/source"
git -C "$folder/source" checkout --quiet 10f7ebf669790f39ae3108ea5960c660c95d9f56
cd "$folder/source"
npm install --silent --no-audit --no-fund --prefix "$folder" esbuild@0.28.2 uf2@2.0.0
NODE_PATH=$folder/node_modules "$folder/node_modules/.bin/esbuild" src/rp2350.ts --bundle --format=esm --platform=node --target=node20 --minify --log-level=error \
    --banner:js="// rp2350js 2.0.1 with the RP2350's boot ROM: rp2350js.LICENSE; made by scripts/rp2350js.sh" --outfile="$to"
