#!/usr/bin/env bash
# Sets up .venv with haptix and its development tools. Safe to run again at any time; needs no terminal.
#   PYTHON=/path/to/python  picks the interpreter (3.11 or newer); pip's own PIP_* variables are honoured.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
exec </dev/null # nothing here may wait for an answer

say() { printf 'setup: %s\n' "$*"; }
fail() {
    printf 'setup: %s\n' "$*" >&2
    exit 1
}

# --- system packages ------------------------------------------------------------------------------

may_install() {
    command -v apt-get >/dev/null && { [ "$(id -u)" -eq 0 ] || sudo -n true 2>/dev/null; }
}

apt() {
    local as_root=()
    [ "$(id -u)" -eq 0 ] || as_root=(sudo -n)
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -qq -o DPkg::Lock::Timeout=120 "$@" 2>&1
}

# Installs packages quietly; on failure shows the end of what apt-get said and returns 1.
apt_updated=
apt_install() {
    local log
    if [ -z "$apt_updated" ]; then
        # A stale or partly unreachable list may still hold what we need: let the install decide.
        log=$(apt update) || say "apt-get update had trouble: $(tail -n 1 <<<"$log")"
        apt_updated=yes
    fi
    log=$(apt install -y --no-install-recommends "$@") && return
    tail -n 5 <<<"$log" >&2
    return 1
}

# --- the interpreter ------------------------------------------------------------------------------

new_enough() { "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; }
version_of() { "$1" -c 'import sys; print("%d.%d" % sys.version_info[:2])'; }

python=
if [ -n "${PYTHON:-}" ]; then
    new_enough "$PYTHON" || fail "PYTHON=$PYTHON is not a working Python 3.11 or newer."
    python=$PYTHON
else
    for candidate in python3.11 python3.12 python3.13 python3; do
        if new_enough "$candidate"; then # a name on PATH may be a launcher with nothing behind it
            python=$candidate
            break
        fi
    done
    [ -n "$python" ] ||
        fail "haptix needs Python 3.11 or newer and none was found: install one, or name it with PYTHON=/path/to/python."
fi
version=$(version_of "$python")

# --- the virtual environment ----------------------------------------------------------------------

rm -f .venv/.ready

# Debian and Ubuntu keep the part of Python that makes environments in a package of its own.
can_make_venv() { "$python" -c 'import ensurepip, venv' 2>/dev/null; }
ensure_venv_module() {
    can_make_venv && return
    if may_install; then
        say "installing python$version-venv"
        apt_install "python$version-venv" || apt_install python3-venv || true
        can_make_venv && return
    fi
    fail "$python cannot make a virtual environment; run: sudo apt-get install python$version-venv   and then this again."
}

# Keep an environment that works, unless PYTHON asks for another version than it has.
usable() {
    new_enough .venv/bin/python && .venv/bin/python -m pip --version >/dev/null 2>&1 &&
        { [ -z "${PYTHON:-}" ] || [ "$(version_of .venv/bin/python)" = "$version" ]; }
}
if ! usable; then
    ensure_venv_module
    say "making .venv with $python ($version)"
    "$python" -m venv --clear .venv
fi

# --- PortAudio for audio links, libusb for USB links, a C compiler for the example in C --------------

# Only audio and USB links and the example need them, so nothing that goes wrong here stops the set-up.
ldconfig=$(command -v ldconfig || echo /sbin/ldconfig)
missing_packages() {
    local known
    known=$("$ldconfig" -p 2>/dev/null || true)
    [[ $known == *libportaudio.so.2* ]] || echo libportaudio2
    [[ $known == *libusb-1.0.so.0* ]] || echo libusb-1.0-0
    command -v cc >/dev/null || printf '%s\n' gcc libc6-dev
}
mapfile -t missing < <(missing_packages)
if [ "${#missing[@]}" -gt 0 ] && may_install; then
    say "installing ${missing[*]}"
    apt_install "${missing[@]}" || say "apt-get failed (its reason is above)"
    mapfile -t missing < <(missing_packages)
fi
if [ "${#missing[@]}" -gt 0 ]; then
    say "missing: ${missing[*]}; only audio links (libportaudio2), USB links (libusb-1.0-0), examples/read_surface.c (gcc libc6-dev) and their tests need them and are skipped."
    say "to add them: sudo apt-get install ${missing[*]}"
fi

# --- Python packages ------------------------------------------------------------------------------

# Without --no-compile, half a minute would go to 16,000 modules of which most are never loaded.
pip_install() {
    .venv/bin/python -m pip install -q --no-compile --disable-pip-version-check --no-input \
        -c constraints.txt "$@"
}
say "installing torch (the first time takes minutes)"
pip_install torch # first and pinned, see constraints.txt
say "installing haptix and the development tools"
pip_install -e '.[dev]'

touch .venv/.ready
say "ready: .venv (Python $(version_of .venv/bin/python))"
