"""One run of a command in a Linux guest, which QEMU emulates in software."""

import os
import platform
import re
import shlex
import shutil
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

from tests.devices.guest.debian import NoDebianError, debian_dir

_TOOLS = {
    "qemu-system-x86_64": "qemu-system-x86",
    "busybox": "busybox-static",
    "cpio": "cpio",
    "dpkg": "dpkg",
    "apt-get": "apt",
}

_BOOTS = 2
_BOOT_S = 600.0  # 10 s on a quiet machine; only a boot that hangs may come to this
_UP = "guest: up"


class NoMachineError(Exception):
    """This computer cannot run the guest, and why."""


@dataclass(frozen=True)
class GuestRun:
    """What came out of a guest."""

    exit_code: int | None  # of the command; None if the guest did not get to its end
    results: list[str]  # lines that the command wrote to /dev/ttyS1
    console: str  # everything else


def run_in_guest(command, environment, folder, limit_s):
    """Run a command of the host's file system as root of a guest.

    Parameters
    ----------
    command : list of str
    environment : dict of str to str
        All that the command finds in its environment, besides UDEVD, where udevd is.
    folder : Path
        For the images, and what the guest says.
    limit_s : float
        How long the guest may take once it is up. A guest that does not come up is booted again.

    Raises
    ------
    NoMachineError
        If a tool or the kernel is missing.
    """
    missing = [package for tool, package in _TOOLS.items() if not _which(tool)]
    if platform.machine() != "x86_64":
        raise NoMachineError(f"the guest shares the host's x86-64 programs, not {os.uname()}")
    if missing:
        raise NoMachineError(f"apt install {' '.join(missing)}, or run scripts/setup-devices.sh")
    try:
        debian = debian_dir()
    except NoDebianError as error:
        raise NoMachineError(str(error)) from error
    folder.mkdir(parents=True, exist_ok=True)
    environment = {"UDEVD": str(debian / "systemd-udevd"), **environment}
    image = _initial_ramdisk(debian, command, environment, folder)
    console, results = folder / "console.log", folder / "results.jsonl"
    qemu = [_which("qemu-system-x86_64")]
    # One processor: with two, software emulation is 10 to 40 times slower. KVM hangs on many
    # machines that offer it.
    qemu += ["-M", "q35", "-accel", "tcg", "-cpu", "max", "-smp", "1", "-m", "1024"]
    # The guest's clock counts its instructions, 4 ns each, and only while it idles the time of its
    # host: a host that leaves it waiting makes nothing in it late. Its limits of time thus hold
    # whatever else this machine does, which the wall's clock would not grant.
    qemu += ["-icount", "shift=2,sleep=on", "-rtc", "clock=vm"]
    qemu += ["-nodefaults", "-no-user-config", "-display", "none", "-no-reboot"]
    qemu += ["-serial", f"file:{console}", "-serial", f"file:{results}"]
    # The third and fourth port are the two ends of a wire.
    wire = folder / "wire"
    wire.unlink(missing_ok=True)
    qemu += ["-chardev", f"socket,id=one,path={wire},server=on,wait=off", "-serial", "chardev:one"]
    qemu += ["-chardev", f"socket,id=other,path={wire}", "-serial", "chardev:other"]
    qemu += ["-fsdev", "local,id=root,path=/,security_model=none,readonly=on,multidevs=remap"]
    qemu += ["-device", "virtio-9p-pci,fsdev=root,mount_tag=hostroot"]
    qemu += ["-kernel", str(debian / "vmlinuz"), "-initrd", str(image)]
    # Without the tests of the kernel's ciphers, which take 3 s.
    settings = "console=ttyS0 quiet panic=-1 mitigations=off nokaslr cryptomgr.notests"
    qemu += ["-append", settings]
    for _ in range(_BOOTS):
        said = _run(qemu, console, limit_s)
        if _UP in said:
            break
    ended = re.findall(r"^GUEST-EXIT-CODE (\d+)", said, re.MULTILINE)
    lines = _text(results).split("\n")[:-1]  # a line without an end was cut short
    return GuestRun(int(ended[-1]) if ended else None, lines, said)


def _run(qemu, console, limit_s):
    """Run a guest to its end, or to that of its time; return what it said."""
    console.unlink(missing_ok=True)
    with subprocess.Popen(
        qemu, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as machine:
        try:
            end_s = time.monotonic() + _BOOT_S
            while machine.poll() is None and _UP not in _text(console):
                if time.monotonic() > end_s:
                    return f"{_text(console)}\nnot up after {_BOOT_S:g} s"
                time.sleep(0.2)
            try:
                said = machine.communicate(timeout=limit_s)[0]
            except subprocess.TimeoutExpired:
                said = f"ended after {limit_s:g} s"
        finally:
            machine.kill()
    return _text(console) + said


def _initial_ramdisk(debian, command, environment, folder):
    root = folder / "initrd"
    for name in ("bin", "proc", "sys", "dev", "host"):
        (root / name).mkdir(parents=True, exist_ok=True)
    shutil.copy(_which("busybox"), root / "bin" / "busybox")
    shutil.copytree(debian / "modules", root / "modules", dirs_exist_ok=True)
    shutil.copy(Path(__file__).with_name("init.sh"), root / "init")
    (root / "init").chmod(0o755)
    exports = [f"export {key}={shlex.quote(value)}" for key, value in environment.items()]
    exports.append(f"$B chroot /host {shlex.join(command)}")
    (root / "command.sh").write_text("\n".join(exports) + "\n")
    image = folder / "initrd.cpio"
    names = sorted(str(path.relative_to(root)) for path in root.rglob("*"))
    with image.open("wb") as file:
        subprocess.run(
            ["cpio", "--create", "--format=newc", "--quiet", "--owner=0:0"],
            cwd=root,
            input="\n".join(names).encode(),
            stdout=file,
            check=True,
        )
    return image


def _which(tool):
    return shutil.which(tool) or shutil.which(tool, path="/usr/sbin:/sbin")


def _text(path):
    return path.read_text(errors="replace").replace("\r", "") if path.exists() else ""
