"""The USB numbers of a driver, and the udev rule that lets users open it."""

from __future__ import annotations

from pathlib import Path

#: pid.codes' numbers for testing; a board that is sold needs its own.
VENDOR_ID = 0x1209
PRODUCT_ID = 0x0001

#: Sorts before 73-seat-late.rules, which acts on the tag.
RULE_FILE = Path("etc/udev/rules.d/70-haptix.rules")

_RULE = """\
# haptix: the user who sits at this computer may open the touchscreen's driver.
SUBSYSTEM=="usb", ATTR{{idVendor}}=="{vid:04x}", ATTR{{idProduct}}=="{pid:04x}", TAG+="uaccess"
SUBSYSTEM=="hidraw", ATTRS{{idVendor}}=="{vid:04x}", ATTRS{{idProduct}}=="{pid:04x}", TAG+="uaccess"
"""


def udev_rule(vendor_id: int = VENDOR_ID, product_id: int = PRODUCT_ID) -> str:
    """Return the text of the rule for these USB numbers."""
    return _RULE.format(vid=vendor_id, pid=product_id)


def udev_rule_is_installed(root: Path = Path("/")) -> bool:
    """Return whether the rule file below `root` exists and has the right text."""
    try:
        path = root / RULE_FILE
        return path.is_file() and path.read_text() == udev_rule()
    except OSError:
        return False


def permission_remedy() -> str:
    """Return what to do if the operating system does not let this user open a device."""
    return (
        f"install the udev rule /{RULE_FILE} with `sudo haptix doctor --install-udev`, "
        "then replug the device"
    )
