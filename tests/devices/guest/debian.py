"""Debian's stock kernel and udevd for the guest: unpacked, not installed, in the user's cache.

``python3 debian.py`` fetches them. Standard library only, since the set-up runs this too.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import zlib
from pathlib import Path

#: What the guest loads, with whatever these depend on.
MODULES = (
    *("virtio_pci", "9p", "9pnet_virtio", "vhci_hcd", "usbhid", "hid_generic"),
    *("uinput", "evdev", "uhid", "hid_multitouch"),
)
_META_PACKAGE = "linux-image-amd64"


class NoDebianError(Exception):
    """There is nothing to boot, and why."""


def cache_dir():
    """The folder of everything fetched for this user's guests."""
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "haptix" / "guests"


def debian_dir():
    """A folder with ``vmlinuz``, ``systemd-udevd`` and, in the order of loading, ``modules/*.ko``.

    Of the newest versions that apt knows; of the last that were fetched where apt cannot say.
    """
    try:
        packages = [_newest(_kernel_package()), _newest("udev")]
        wanted = zlib.crc32(repr((packages, MODULES)).encode())
        folder = cache_dir() / f"{packages[0].replace('=', '_')}_{wanted:08x}"
        if not folder.exists():
            _fetch(packages, folder)
        return folder
    except (OSError, subprocess.SubprocessError, NoDebianError) as error:
        kept = sorted(cache_dir().glob("linux-image-*"), key=lambda path: path.stat().st_mtime)
        if kept:
            return kept[-1]
        raise NoDebianError(
            f"Debian's kernel and udev could not be fetched: {error}; run scripts/setup-devices.sh"
        ) from error


def _kernel_package():
    depends = _run("apt-cache", "depends", _META_PACKAGE)
    packages = [line.split()[-1] for line in depends.splitlines() if "Depends:" in line]
    if not packages:
        raise NoDebianError(f"apt knows no {_META_PACKAGE}")
    return packages[0]


def _newest(package):
    """A package with its version, as apt-get takes it."""
    shown = _run("apt-cache", "show", "--no-all-versions", package).splitlines()
    version = next((line.split()[1] for line in shown if line.startswith("Version:")), None)
    if version is None:
        raise NoDebianError(f"apt knows no {package}")
    return f"{package}={version}"


def _fetch(packages, folder):
    folder.parent.mkdir(parents=True, exist_ok=True)
    # Beside its final place, to be renamed whole: half of it is never found there.
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix="fetching-") as name:
        work = Path(name)
        _run("apt-get", "download", "-q", *packages, cwd=work)
        unpacked = work / "unpacked"
        for archive in work.glob("*.deb"):
            _run("dpkg", "-x", archive, unpacked)
        (tree,) = (unpacked / "lib" / "modules").iterdir()
        _run("depmod", "-b", unpacked, tree.name)
        kept = work / "kept"
        (kept / "modules").mkdir(parents=True)
        (image,) = (unpacked / "boot").glob("vmlinuz-*")
        shutil.copy(image, kept / "vmlinuz")
        # A link to udevadm, which does what its name says.
        shutil.copy(unpacked / "bin" / "udevadm", kept / "systemd-udevd")
        for number, module in enumerate(_in_order(tree)):
            shutil.copy(module, kept / "modules" / f"{number:02}-{module.name}")
        kept.rename(folder)


def _in_order(tree):
    """Paths of the modules to load, each after those that it needs."""
    needs = {}
    for line in (tree / "modules.dep").read_text().splitlines():
        path, _, others = line.partition(":")
        needs[path] = others.split()
    by_name = {Path(path).name.split(".")[0].replace("-", "_"): path for path in needs}
    builtin = {
        Path(line).name.split(".")[0].replace("-", "_")
        for line in (tree / "modules.builtin").read_text().splitlines()
    }
    order = []

    def add(path):
        for other in needs[path]:
            add(other)
        if path not in order:
            order.append(path)

    for name in MODULES:
        if name in by_name:
            add(by_name[name])
        elif name not in builtin:
            raise NoDebianError(f"{tree.name} has no module {name}")
    return [tree / path for path in order]


def _run(*command, cwd=None):
    done = subprocess.run(
        [str(word) for word in command],
        cwd=cwd,
        env={**os.environ, "LC_ALL": "C", "PATH": os.environ.get("PATH", "") + ":/usr/sbin:/sbin"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=300,
    )
    if done.returncode != 0:
        raise NoDebianError(f"{command[0]} failed: {done.stderr.strip() or done.stdout.strip()}")
    return done.stdout


if __name__ == "__main__":
    try:
        sys.stdout.write(f"{debian_dir()}\n")
    except NoDebianError as error:
        sys.exit(str(error))
