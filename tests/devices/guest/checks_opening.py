"""Checks of finding and opening: addresses, two boards, permission, busy, another device."""

import time

from firmware_io import (
    DeviceBusyError,
    DeviceDisconnectedError,
    DeviceError,
    DeviceNotFoundError,
    DevicePermissionError,
    DeviceWatch,
    ProtocolError,
    list_devices,
    open_device,
    volts_to_codes,
)
from firmware_io.firmware.core import compiled
from tests.devices.guest.plugged import PluggedBoard, nodes_of, wait_for
from tests.devices.guest.ways import WAYS, Elsewhere, check, error_of, require, same, wave

_NOBODY = 65534
_VOLTS = wave(1000, 48_000.0)
_CODES = volts_to_codes(_VOLTS, 250.0)


def _plays(device, board):
    """Play something through a device, close it, and see that this board has played it."""
    before = board.played_codes().size
    with device:
        device.write(_VOLTS)
    device.close()
    same(board.played_codes()[before:], _CODES)


@check()
def a_board_is_listed_and_its_addresses_open_it():
    """What `list_devices` shows, `open_device` takes."""
    with PluggedBoard("LISTED01") as board:
        found = [d for d in list_devices() if d.kind in ("usb", "hid") and d.usable]
        require({d.kind for d in found} == {"usb", "hid"}, found)
        for device in found:
            require("LISTED01" in device.note, device)
            more = "" if device.kind == "usb" else ",mode=waveform,sample_rate_hz=48000"
            _plays(open_device(device.address + more), board)
            board.wait_until_there()
        board.pull_out()
        # libusb hears of it in a thread of its own.
        wait_for(lambda: not [d for d in list_devices() if d.kind in ("usb", "hid") and d.usable])
    return {"addresses": ", ".join(device.address for device in found)}


@check()
def two_boards_are_told_apart_by_serial():
    """Without a serial number neither is taken by chance."""
    with PluggedBoard("BOARD00A", 0) as one, PluggedBoard("BOARD00B", 1) as other:
        for way in WAYS:
            error = error_of(way.open)
            require(type(error) is DeviceError, repr(error))
            require("serial=" in str(error), error)
            for board in (one, other):
                _plays(way.open(serial=board.serial, mode="waveform", sample_rate_hz=48000), board)
                board.wait_until_there()
        missing = [error_of(lambda way=way: way.open(serial="BOARD00C")) for way in WAYS]
    require([type(e) for e in missing] == 3 * [DeviceNotFoundError], missing)
    return {}


@check(*WAYS)
def nothing_is_connected(way):
    """The error says so, and where to look."""
    # The kernel takes away what the check before has unplugged a moment later.
    wait_for(lambda: not any(d.usable and d.kind in ("usb", "hid") for d in list_devices()))
    error = error_of(way.open)
    require(type(error) is DeviceNotFoundError, repr(error))
    require("haptix devices" in str(error), error)
    return {"error": str(error)}


@check(*WAYS)
def another_device_with_the_same_numbers(way):
    """It sends back what comes; it is let go again."""
    with PluggedBoard(echoes=True):
        for _ in range(2):
            error = error_of(way.open)
            require(type(error) is ProtocolError, repr(error))
    return {"error": str(error)}


@check(*WAYS)
def in_use_by_another_process_or_object(way):
    """The second is disconnected, the first plays on, and it may be opened when that has closed."""
    with Elsewhere(lambda: error_of(way.open)) as elsewhere, PluggedBoard() as board:
        device = way.open(mode="waveform", sample_rate_hz=48000)
        there, here = elsewhere.run(), error_of(way.open)
        _plays(device, board)
        board.wait_until_there()
        again = way.open(mode="waveform", sample_rate_hz=48000)
        _plays(again, board)
    require(type(there) is DeviceBusyError, f"another process: {there!r}")
    require(type(here) is DeviceBusyError, f"another object: {here!r}")
    return {"error": str(there)}


def _load_all():
    """Load every library: in some homes nobody may read them."""
    list_devices()
    compiled()


@check(*WAYS)
def a_user_without_permission(way):
    """The error names the udev rule; with the access that the rule gives, it opens."""
    opens = Elsewhere(lambda: error_of(lambda: way.open().close()), _NOBODY, _load_all)
    with opens as nobody, PluggedBoard() as board:
        usb, hidraw = nodes_of(board.serial)
        denied = nobody.run()
        for node in usb + hidraw:
            node.chmod(0o666)
        allowed = nobody.run()
    require(type(denied) is DevicePermissionError, repr(denied))
    require("haptix doctor --install-udev" in str(denied), denied)
    require(allowed is None, repr(allowed))
    return {"error": str(denied)}


@check(*WAYS)
def a_path_that_is_gone(way):
    """An address from before an unplug finds nothing, rather than something else."""
    with PluggedBoard() as board:
        device = way.open()
        address = device.name
        device.close()
        board.wait_until_there()
        board.pull_out()
        errors = []

        def is_not_found():
            errors.append(error_of(lambda: open_device(address)))
            return type(errors[-1]) is DeviceNotFoundError

        wait_for(is_not_found)
    # Until libusb has heard of it, in a thread of its own, the device is there but gone.
    kinds = {type(error) for error in errors[:-1]}
    require(kinds <= {DeviceDisconnectedError}, errors)
    return {"error": str(errors[-1])}


@check()
def comings_and_goings_are_told():
    """A watch in its own thread tells of a plug and an unplug."""
    told = []
    with (
        DeviceWatch(lambda device, is_there: told.append((device.kind, is_there)), 0.05) as watch,
        PluggedBoard() as board,
    ):
        began_s = time.monotonic()
        wait_for(lambda: {("usb", True), ("hid", True)} <= set(told))
        took_s = time.monotonic() - began_s
        board.unplug()
        wait_for(lambda: {("usb", False), ("hid", False)} <= set(told))
    require(watch.error is None, watch.error)
    require(len(told) == 4, told)
    return {"told_after_s": took_s}
