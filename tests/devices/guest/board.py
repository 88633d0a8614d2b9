"""The emulated board: the firmware core behind a real kernel's USB."""

import errno
import select
import struct
import traceback
from collections import defaultdict, deque

from firmware_io import MockDriver
from tests.devices.guest.descriptors import BULK_ENDPOINT, HID_ENDPOINT, HID_INTERFACE, descriptor
from tests.devices.guest.usbip import Cable
from tests.faulty_link import FaultInjection
from tests.steady_clock import SteadyClock

_TURN_S = 0.01  # between two looks at what a board in real time has to say
_CLASS, _VENDOR = 0x20, 0x40
_ENDPOINT_RECIPIENT = 0x02


class Board:
    """The board's own process; `PluggedBoard` is how tests talk to it.

    Everything that it plays is driven by `MockDriver`, and everything that arrives is kept.
    """

    def __init__(self, serial, port, echoes=False, **driver):
        # A guest that its host leaves waiting would otherwise find every board starved, or in the
        # middle of a frame that broke off, though nobody was slow in it.
        clock = SteadyClock(longest_s=2 * _TURN_S, speed=0.5)
        self.driver = MockDriver(serial=serial, **{"clock": clock, **driver})
        self._serial, self._port, self._echoes = serial, port, echoes
        self._cable = None
        self._reset()

    def _reset(self):
        self._injected = defaultdict(FaultInjection)
        self._stalls = {}
        self._halted = set()
        self._wanted = defaultdict(deque)  # transfers towards the host that wait for data
        self._said = defaultdict(deque)  # data that waits for a transfer towards the host
        self._answers_at = None
        self._arrived = {HID_ENDPOINT: [], BULK_ENDPOINT: []}

    # --- commands of the tests ----------------------------------------------------------------

    def plug(self):
        """Connect it to the host."""
        self._reset()
        self._cable = Cable(self._port)

    def unplug(self):
        """Pull the cable; the board sees that its host is gone."""
        if self._cable is not None:
            self._cable.pull()
            self._cable = None
            self.driver.release()

    def inject(self, endpoint, fault, after=0):
        """Let something happen to a later transfer; "halt" is a stall that lasts until cleared."""
        if fault == "halt":
            self._stalls[endpoint] = after
        else:
            self._injected[endpoint].add(fault, after)

    def arrived(self, endpoint):
        """Return every transfer that has arrived there since it was plugged in."""
        return self._arrived[endpoint]

    def output(self):
        """Return every output sample since power-up, and what each was."""
        return self.driver.output

    def played_codes(self):
        """Return the codes of streams and ramps since power-up."""
        return self.driver.played_codes

    def about(self):
        """Return where its core stands."""
        return self.driver.status, self.driver.fault

    def touch(self, *finger):
        """Put a finger on the panel."""
        told = self.driver.touch(*finger)
        self._speak()
        return told

    # --- the host's transfers -----------------------------------------------------------------

    def serve(self, commands):
        """Serve the host and the tests until the tests are gone."""
        while True:
            readers = [commands] if self._cable is None else [commands, self._cable]
            patience_s = _TURN_S if self.driver.pace == "real" else None
            ready = select.select(readers, [], [], patience_s)[0]
            if self._cable in ready:
                self._serve_host()
            self._speak()
            if commands in ready:
                try:
                    name, arguments = commands.recv()
                except EOFError:
                    return
                try:
                    commands.send((True, getattr(self, name)(*arguments)))
                except Exception:
                    commands.send((False, traceback.format_exc()))

    def _serve_host(self):
        cable = self._cable
        try:
            for transfer in cable.transfers():
                self._serve_transfer(cable, transfer)
                if self._cable is not cable:
                    return
        except (EOFError, ConnectionError):
            self.unplug()

    def _serve_transfer(self, cable, transfer):
        if transfer.endpoint == 0:
            answer = self._control(transfer)
            if answer is None:
                cable.answer(transfer, errno.EPIPE)
            else:
                cable.answer(transfer, data=answer if transfer.is_inward else b"")
        elif (transfer.endpoint, transfer.is_inward) in self._halted:
            cable.answer(transfer, errno.EPIPE)
        elif transfer.is_inward:
            self._wanted[transfer.endpoint].append(transfer)
        else:
            self._take(cable, transfer)
        self._speak()

    def _take(self, cable, transfer):
        endpoint = transfer.endpoint
        if endpoint in self._stalls:
            self._stalls[endpoint] -= 1
            if self._stalls[endpoint] < 0:
                del self._stalls[endpoint]
                self._halted.add((endpoint, False))
                cable.answer(transfer, errno.EPIPE)
                return
        taken = 0
        for event in self._injected[endpoint].outward(transfer.data):
            if isinstance(event, bytes):
                self._receive(endpoint, event)
                taken += len(event)
            elif isinstance(event, OSError):
                if event.errno == errno.ENODEV:
                    self._injected[endpoint] = FaultInjection()
                    self.unplug()
                elif event.errno == errno.EIO:
                    cable.answer(transfer, taken=taken)
                return  # of a time-out nothing is answered: the host gives it up
        cable.answer(transfer)

    def _receive(self, endpoint, data):
        self._arrived[endpoint].append(data)
        self._answers_at = endpoint
        if self._echoes:
            self._said[endpoint].append(data)
        elif endpoint == HID_ENDPOINT:
            self.driver.receive_report(data)
        else:
            self.driver.receive(data)

    def _speak(self):
        """Give the host what it waits for, as far as there is something to say."""
        cable, endpoint = self._cable, self._answers_at
        while cable is not None and endpoint is not None and self._wanted[endpoint]:
            transfer = self._wanted[endpoint][0]
            if not cable.is_waiting(transfer):
                self._wanted[endpoint].popleft()
                continue
            said = self._said[endpoint]
            if not said and not self._echoes:
                is_hid = endpoint == HID_ENDPOINT
                data = self._report() if is_hid else self._mishap(endpoint, self.driver.transmit())
                if data:
                    said.append(data)
            if not said:
                return
            data = said.popleft()
            if len(data) > transfer.length:
                said.appendleft(data[transfer.length :])
            self._wanted[endpoint].popleft()
            cable.answer(transfer, data=data[: transfer.length])

    def _report(self):
        report = self.driver.transmit_report()
        # FaultInjection concern the bytes that mean something, not those that fill the report.
        frame = self._mishap(HID_ENDPOINT, report[: 2 + (report[1] & 0x7F)] if report else b"")
        return frame and frame.ljust(len(report), b"\0")

    def _mishap(self, endpoint, data):
        return data and self._injected[endpoint].inward(data)

    def _control(self, transfer):
        """Return the answer to a request at endpoint 0; None for a stall."""
        kind, request, value, index, length = struct.unpack("<BBHHH", transfer.setup)
        if kind & 0x60 == _CLASS:
            # HID: SET_IDLE and SET_PROTOCOL have no effect, and a report may come here as well.
            if request == 9 and index & 0xFF == HID_INTERFACE:
                self._receive(HID_ENDPOINT, transfer.data)
            return b"" if request in (9, 10, 11) else None
        if kind & 0x60 == _VENDOR:
            return None
        if request == 6:
            found = descriptor(value >> 8, value & 0xFF, self._serial)
            return None if found is None else found[:length]
        if request == 1 and kind & 0x1F == _ENDPOINT_RECIPIENT:
            self._halted.discard((index & 0x0F, bool(index & 0x80)))
        if request == 9:
            self.driver.release()
        return {0: b"\0\0", 8: b"\1", 10: b"\0"}.get(request, b"")[:length]
