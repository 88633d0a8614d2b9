#!/usr/bin/env bash
# Installs what the tests need besides .venv so that none is skipped, on Debian 12. For `make test`: the ARM
# compiler and its emulator. For `make test-devices`: QEMU with a kernel for its guest, JACK, libusb and
# PortAudio. A browser for the pages that haptix writes. Safe to run again; needs root, or sudo without a password.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
exec </dev/null # nothing here may wait for an answer

packages=(
    # the guest, its first process, and what unpacks its kernel and runs its udevd
    qemu-system-x86 busybox-static cpio kmod libacl1 libblkid1 libcap2 libselinux1
    # the links under test
    libusb-1.0-0 libportaudio2 jackd2
    # opens the calibration's report
    chromium
    # the firmware's own checks
    gcc libc6-dev make
    # the same core on a Cortex-M, and where an int has 16 bits
    gcc-arm-none-eabi qemu-system-arm gcc-avr avr-libc simavr
    # the proof of the firmware's limiter
    frama-c-base why3 z3
    # the firmware in the wheel for aarch64, and with the bytes in the other order
    qemu-user libc6-arm64-cross
    # the one in the wheel for Windows: 100 MB to load, 670 MB on disk
    wine wine64
    # a display for the examples with a window
    xvfb python3-tk
    # pages are tested in a real browser
    chromium
    # the client in C#
    mono-mcs mono-runtime libmono-system4.0-cil libmono-system-core4.0-cil libnewtonsoft-json5.0-cil
    python3
    # types of the session's messages in C++, Rust and Kotlin
    g++ nlohmann-json3-dev
    rustc cargo librust-serde-json-dev librust-serde-derive-dev
    kotlin
    # decimal commas: files do not depend on them
    locales
)

# The client for pages and Node, its types and its tests; Node comes with npm, or from Debian.
command -v npm >/dev/null || packages+=(nodejs npm)

fail() {
    printf 'setup-devices: %s\n' "$*" >&2
    exit 1
}
command -v apt-get >/dev/null || fail "this needs Debian's apt-get; the tests are skipped elsewhere."
as_root=()
if [ "$(id -u)" -ne 0 ]; then
    sudo -n true 2>/dev/null || fail "this needs root: sudo bash scripts/setup-devices.sh"
    as_root=(sudo -n)
fi

# Installs quietly; shows what apt-get said only if it failed.
apt() {
    local log
    log=$("${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -qq -o DPkg::Lock::Timeout=120 "$@" 2>&1) ||
        { tail -n 5 <<<"$log" >&2; return 1; }
}
printf 'setup-devices: installing %s\n' "${packages[*]}"
# Another program may be at the lists, such as scripts/setup.sh. A partly unreachable list may still hold
# what we need: let the installation decide.
apt update || { sleep 20 && apt update; } || true
# jackd2 asks whether it may have real-time priority: no, root has it anyway.
apt install -y --no-install-recommends "${packages[@]}" || fail "apt-get failed (its reason is above)."

# As the user who will run the tests: it lies in the user's cache.
printf 'setup-devices: the guest lies in %s\n' "$(python3 tests/devices/guest/debian.py)"

# The emulator of the RP2040, on which the firmware of the Pico runs, and what makes the clients.
for folder in tests/firmware_io/pico clients/typescript; do
    npm ci --silent --no-audit --no-fund --prefix "$folder" || fail "npm ci of $folder failed (its reason is above)."
done

# Then: make clients
node -e 'process.exit(parseInt(process.versions.node) < 20 ? 1 : 0)' || fail "the clients need Node 20 or newer, from nodejs.org."
