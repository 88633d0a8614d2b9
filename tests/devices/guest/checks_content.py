"""Checks that what is sent is what is played, sample by sample."""

import time

import numpy as np

from firmware_io import volts_to_codes
from firmware_io.protocol import FrameParser, StreamSamples, from_report
from tests.devices.guest.descriptors import BULK_ENDPOINT, HID_ENDPOINT, PRODUCT_ID, VENDOR_ID
from tests.devices.guest.plugged import PluggedBoard, wait_for
from tests.devices.guest.ways import HID, HIDRAW, USB, WAYS, check, envelope, require, same, wave

_FULL_SCALE_V = 250.0
_SECONDS = 4.0
_CARRIER_HZ = 4000.0


@check()
def bulk_transfers_come_back_as_they_were():
    """The harness itself, by pyusb alone: sizes around those of packets, pages and requests."""
    import usb.core
    import usb.util

    rng = np.random.default_rng(3)
    with PluggedBoard(echoes=True):
        device = usb.core.find(idVendor=VENDOR_ID, idProduct=PRODUCT_ID)
        usb.util.claim_interface(device, 1)
        for size in (1, 511, 512, 513, 4096, 16384, 16385, 65536):
            sent = rng.bytes(size)
            require(device.write(BULK_ENDPOINT, sent) == size, size)
            came = b""
            while len(came) < size:
                came += bytes(device.read(0x80 | BULK_ENDPOINT, 1 << 17, 5000))
            require(came == sent, f"{size} bytes came back changed")
        began_s = time.monotonic()
        blocks = 200
        for _ in range(blocks):
            device.write(BULK_ENDPOINT, sent[:512])
            device.read(0x80 | BULK_ENDPOINT, 512, 5000)
        trip_s = (time.monotonic() - began_s) / blocks
        usb.util.dispose_resources(device)
    return {"round_trip_ms": 1e3 * trip_s}


@check(HIDRAW, HID)
def reports_come_back_as_they_were(way):
    """The harness itself, by hidapi alone."""
    module = __import__("hidraw" if way is HIDRAW else "hid")
    rng = np.random.default_rng(4)
    with PluggedBoard(echoes=True):
        handle = module.device()
        handle.open_path(module.enumerate(VENDOR_ID, PRODUCT_ID)[0]["path"])
        began_s = time.monotonic()
        reports = 200
        for _ in range(reports):
            sent = b"\1" + rng.bytes(63)
            require(handle.write(sent) == 64, "short")
            require(bytes(handle.read(64, 5000)) == sent, "a report came back changed")
        trip_s = (time.monotonic() - began_s) / reports
        handle.close()
    return {"round_trip_ms": 1e3 * trip_s}


@check(USB)
def seconds_of_waveform(way):
    """192 000 samples; the board plays them as they are."""
    with PluggedBoard() as board:
        with way.open() as device:
            require(device.mode == "waveform", device.mode)
            rate_hz = device.capabilities.sample_rate_hz
            volts = wave(round(_SECONDS * rate_hz), rate_hz)
            began_s = time.monotonic()
            device.write(volts)
            took_s = time.monotonic() - began_s
        device.close()
        codes = volts_to_codes(volts, _FULL_SCALE_V)
        same(_sent_to(board, BULK_ENDPOINT), codes)
        same(board.played_codes(), codes)
        status, fault = board.about()
    require(fault is None and status.faults == 0 and status.underruns == 0, status)
    return {"samples": codes.size, "samples_per_s": codes.size / took_s}


@check(HIDRAW, HID)
def seconds_of_envelope(way):
    """64 000 amplitudes in reports; the board makes the carrier."""
    with PluggedBoard() as board:
        with way.open(sample_rate_hz=16000, carrier_hz=_CARRIER_HZ) as device:
            require(device.mode == "envelope", device.mode)
            rate_hz = device.capabilities.sample_rate_hz
            volts = envelope(round(_SECONDS * rate_hz), rate_hz)
            began_s = time.monotonic()
            device.write(volts)
            took_s = time.monotonic() - began_s
        device.close()
        codes = volts_to_codes(volts, _FULL_SCALE_V)
        same(_sent_to(board, HID_ENDPOINT), codes)
        played = board.played_codes().astype(float)
        reports = len(board.arrived(HID_ENDPOINT))
        status, fault = board.about()
    require(fault is None and status.faults == 0 and status.underruns == 0, status)
    # PROTOCOL.md: lines from 0 to the first amplitude and on to each next, times a sine.
    output_hz = 48_000.0
    require(played.size == codes.size * round(output_hz / rate_hz), played.size)
    at = np.arange(played.size)
    knots = np.arange(-1, codes.size)
    lines = np.interp((at + 1) * rate_hz / output_hz - 1, knots, np.r_[0, codes])
    carrier = np.sin(2 * np.pi * _CARRIER_HZ / output_hz * at)
    off = np.abs(played - lines * carrier)
    # A code each for the line, the sine and their product in whole numbers; and the carrier's step
    # of phase is a whole number of 2^-32 turns, so it is off by half of one at each sample at most.
    allowed = 3.0 + lines * np.pi * at / 2**32
    require(np.all(off <= allowed), f"the output is up to {off.max():.3g} codes from the formula")
    return {
        "samples": codes.size,
        "reports": reports,
        "samples_per_s": codes.size / took_s,
        "codes_off_formula": off.max(),
    }


@check(*WAYS)
def touches_arrive(way):
    """What the panel reports reaches the host, in order, with its place and force."""
    fingers = [(10.0 + 0.5 * n, 20.0 - 0.25 * n, 0.1 * n, n % 3) for n in range(40)]
    heard = []
    with PluggedBoard() as board, way.open() as device:
        for finger in fingers:
            wait_for(lambda finger=finger: board.touch(*finger))
            device.progress()
            heard += device.touches()

        def all_are_there():
            device.progress()
            heard.extend(device.touches())
            return len(heard) >= len(fingers)

        wait_for(all_are_there)
        device.stop()
        device.close()
    got = [(t.x_um / 1e3, t.y_um / 1e3, t.normal_force_mn / 1e3, t.contact) for t in heard]
    np.testing.assert_allclose(got, fingers, atol=5.1e-4)  # half a micrometre, half a millinewton
    return {"touches": len(got)}


@check(USB)
def a_shared_driver_obeys_both_interfaces(way):
    """One session by HID after one by bulk on the same board, and answers go to who asks."""
    volts = wave(2000, 16_000.0)
    codes = volts_to_codes(volts, _FULL_SCALE_V)
    with PluggedBoard(sample_rate_hz=16_000.0) as board:
        for where in (way, HIDRAW, HID, way):
            with where.open(mode="waveform", sample_rate_hz=16000) as device:
                device.write(volts)
            device.close()
            # libusb's side of hidapi gives the interface back to the kernel when it closes.
            board.wait_until_there()
        same(board.played_codes(), np.tile(codes, 4))
    return {}


def _sent_to(board, endpoint):
    """The samples in what has arrived, read by the host's parser; in order, without a gap."""
    pieces = board.arrived(endpoint)
    if endpoint == HID_ENDPOINT:
        pieces = [from_report(report)[0] for report in pieces]
    codes, sequences = [], []
    for item in FrameParser().feed(b"".join(pieces)):
        if isinstance(item, Exception):
            raise item
        sequences.append(item.sequence)
        if isinstance(item.message, StreamSamples):
            require(item.message.sample_index == sum(map(len, codes)), item.message.sample_index)
            codes.append(item.message.codes)
    same(np.diff(np.asarray(sequences, np.int64)) % 65536, np.ones(len(sequences) - 1))
    return np.concatenate(codes)
