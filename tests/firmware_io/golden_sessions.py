"""The golden sessions, calculated from PROTOCOL.md alone: no line of the package is used.

``python -m tests.firmware_io.golden_sessions`` writes them; a test compares the files. Frames are
packed field by field, with check sums bit by bit; answers are written down as the page says them;
what is played comes from the page's formulas, tick by tick in whole numbers.
"""

import itertools
import json
import math
import struct
from pathlib import Path

from tests.firmware_io import golden_sensing

FOLDER = Path(__file__).parents[2] / "firmware_io/golden"
OUTPUT_HZ, RAMP, LEAD, HOLD = 8000, 40, 8, 40
BOARD = {
    "oldest_version": 4,
    "newest_version": 4,
    "report_bytes": 64,
    "output_rate_hz": OUTPUT_HZ,
    "full_scale_mv": 250_000,
    "ceiling_mv": 200_000,
    "max_slew_v_per_s": 4_666_666,
    "queue_samples": 400,
    "max_frame_samples": 200,
    "max_watchdog_ms": 160,
    "name": "golden board",
    "serial": "G-0001",
    "calibration_id": "",
    "reports_touch": False,
    "rates": [[8000, [0, 1]], [2000, [0, 1]]],
    "guard_ticks": 16,
}
HELLO, SETUP, ARM, STREAM, STOP, PING, REVISE, MARK = range(1, 9)
CAPABILITIES, STATUS, FAULT, MARKED, SENSE = 0x81, 0x82, 0x83, 0x85, 0x86
NEVER = 2**64 - 1


def crc16(data):
    crc = 0xFFFF
    for bit in (byte >> place & 1 for byte in data for place in range(7, -1, -1)):
        crc = (crc << 1 & 0xFFFF) ^ (0x1021 if (crc >> 15) ^ bit else 0)
    return crc


def crc32(data):
    crc = 0xFFFFFFFF
    for bit in (byte >> place & 1 for byte in data for place in range(8)):
        crc = crc >> 1 ^ (0xEDB88320 if (crc & 1) ^ bit else 0)
    return crc ^ 0xFFFFFFFF


def frame(kind, sequence, payload=b"", mode=0, version=4):
    head = struct.pack("<2sBBHHH", b"HX", version, kind, sequence, len(payload), mode)
    body = head + struct.pack("<H", crc16(head)) + payload
    return body + struct.pack("<I", crc32(body))


def quotient(a, b):
    """Rounded toward 0."""
    return -(-a // b) if a < 0 else a // b


def sine(phase):
    def table(i):
        return round(32767 * math.sin(2 * math.pi * i / 1024))

    a, b = table(phase >> 22), table((phase >> 22) + 1)
    return a + quotient((b - a) * (phase >> 6 & 65535), 65536)


class Session:
    """The steps of a session, with the numbers of both sides."""

    def __init__(self, in_reports=False, **board):
        self.board = BOARD | board
        self.sensor = {}
        self.steps = []
        self.in_reports = in_reports
        self.sent = self.answered = 0

    def receive(self, kind, payload=b"", mode=0, sequence=None, damage=None):
        sequence = self.sent if sequence is None else sequence
        # A host that speaks version 3 as well begins in it.
        data = bytearray(frame(kind, sequence, payload, mode, 3 if kind == HELLO else 4))
        if damage is not None:
            data[damage] ^= 1
        self.sent = sequence + 1
        self.receive_bytes(bytes(data))
        return bytes(data)

    def receive_bytes(self, data):
        if not self.in_reports:
            self.steps.append({"receive": data.hex(" ")})
            return
        for start in range(0, len(data), 62):
            piece = data[start : start + 62]
            report = bytes([1, len(piece) | 0x80 * (start == 0)]) + piece.ljust(62, b"\0")
            self.steps.append({"report": report.hex(" ")})

    def hello(self, oldest=3, newest=4):
        self.receive(HELLO, bytes([oldest, newest]))

    def setup(
        self,
        mode=0,
        watchdog_ms=100,
        rate_hz=8000,
        carrier_mhz=0,
        ceiling_mv=200_000,
        status_ms=5,
        slew_v_per_s=4_666_666,
        lead_us=1000,
    ):
        fields = (mode, watchdog_ms, rate_hz, 250_000, ceiling_mv, slew_v_per_s)
        self.receive(SETUP, struct.pack("<HHIIIIIIH", *fields, carrier_mhz, lead_us, status_ms))

    def stream(self, index, codes, mode=0, **how):
        return self.receive(STREAM, struct.pack(f"<I{len(codes)}h", index, *codes), mode, **how)

    def revise(self, index, revision, codes):
        self.receive(REVISE, struct.pack(f"<IH{len(codes)}h", index, revision, *codes))

    def mark(self, index, code, **how):
        self.receive(MARK, struct.pack("<IH", index, code), **how)

    def transmit(self, *answers):
        data = b""
        for kind, payload in answers:
            data += frame(kind, self.answered, payload)
            self.answered += 1
        self.steps.append({"transmit": data.hex(" ")})

    def capabilities(self):
        about = [*list(BOARD.values())[:10]]
        texts = [str(BOARD[name]).encode() for name in ("name", "serial", "calibration_id")]
        senses = self.board.get("sense_rate_hz", 0) // 125
        flags = self.board["reports_touch"] | 2 * self.board.get("takes_marks", False)
        flags |= max(0, senses.bit_length() - 1) << 5
        payload = struct.pack("<BBHIIIIIHH16s16s16sHH", *about, *texts, flags, 2)
        self.transmit((CAPABILITIES, payload + struct.pack("<5I", 8000, 3, 2000, 3, 16)))

    def play(self, codes):
        self.steps.append({"play": list(codes)})

    def sense(self, codes):
        """The current of what was played last."""
        self.steps.append({"sense": list(codes)})

    def text(self, about):
        steps = ",\n".join("  " + json.dumps(step) for step in self.steps)
        head = f' "about": {json.dumps(about)},\n "board": {json.dumps(self.board)},\n'
        head += f' "sensor": {json.dumps(self.sensor)},\n' if self.sensor else ""
        return f'{{\n{head} "steps": [\n{steps}\n ]\n}}\n'


def status(state, fault, following, token, queued, played, underruns, faults, clock, *revised):
    free = BOARD["queue_samples"] - queued
    fields = (state, fault, following, token, queued, free, played, underruns, faults, clock)
    return STATUS, struct.pack("<BBHIIIIIIQHHi", *fields, *(revised or (0, 0, 0)))


def fault(code, sequence, expected, got, clock, field=0):
    return FAULT, struct.pack("<BBHIIQ", code, field, sequence, expected, got, clock)


def ramp(level):
    return [quotient(level * (RAMP - k), RAMP) for k in range(1, RAMP + 1)]


def lines(codes, each):
    """Straight lines from 0 over all samples, `each` ticks long."""
    points = [0, *codes]
    return [
        a + quotient((b - a) * k, each)
        for a, b in itertools.pairwise(points)
        for k in range(1, each + 1)
    ]


def carried(levels, carrier_mhz):
    """An envelope from the first tick of its first line, whose phase is 0."""
    step = carrier_mhz * 2**32 // (1000 * OUTPUT_HZ)
    return [quotient(a * sine(k * step % 2**32), 32767) for k, a in enumerate(levels)]


def first_part(session, mode, codes, each, out):
    """Set up, armed, five frames of 16 samples, an underrun of four ticks, STOP."""
    session.hello()
    session.capabilities()
    session.setup(
        mode, 100, OUTPUT_HZ // each, 1_700_000 if mode else 0, 180_000 if mode else 200_000
    )
    session.transmit(status(0, 0, 2, 0, 0, 0, 0, 0, 0))
    session.receive(ARM)
    session.transmit(status(1, 0, 3, 0, 0, 0, 0, 0, 0))
    ticks = 16 * each
    for n in range(5):
        session.stream(16 * n, codes[16 * n : 16 * n + 16], mode)
        session.play(out[n * ticks : (n + 1) * ticks])
    session.receive(PING, struct.pack("<I", 1))
    left = LEAD // each
    session.transmit(status(2, 0, 9, 1, left, 80 - left, 0, 0, 5 * ticks))
    session.play(out[5 * ticks : 5 * ticks + 12])
    clock = 5 * ticks + 12
    session.receive(STOP)
    session.transmit(status(3, 0, 10, 1, 0, 80, 1, 0, clock))
    session.play(out[clock : clock + 50])
    session.transmit(status(0, 0, 10, 1, 0, 80, 1, 0, clock + 50))
    session.receive(ARM)
    return clock + 50


def waveform():
    """A tone, an underrun that ends in a ramp, STOP, then a damaged frame."""
    session = Session()
    codes = [round(26_000 * math.sin(2 * math.pi * n / 20)) for n in range(80)]
    out = [0] * LEAD + codes + [codes[-1]] * 4
    out += ramp(out[-1]) + [0] * 10
    clock = first_part(session, 0, codes, 1, out)
    session.stream(0, [5000, 20_000])
    session.play([0] * LEAD + [5000, 20_000] + [20_000] * 10)
    clock += 20
    broken = session.stream(2, [257], damage=16)
    due, carries = crc32(broken[:-4]), int.from_bytes(broken[-4:], "little")
    session.transmit(fault(1, 12, due, carries, clock), status(3, 1, 12, 1, 0, 2, 2, 1, clock))
    session.play(ramp(20_000) + [0] * 10)
    session.transmit(status(0, 1, 12, 1, 0, 2, 2, 1, clock + 50))
    return session.text(
        "What a board of this description plays and answers: a waveform over bulk, an underrun, "
        "STOP, a damaged frame. Made by tests/firmware_io/golden_sessions.py."
    )


def host():
    """A host that sends all and only what it must: a tone, STOP, armed again, a damaged frame."""
    session = Session()
    tone = [round(26_000 * math.sin(2 * math.pi * n / 20)) for n in range(480)]
    lead = 120  # 15 ms
    session.hello()
    session.capabilities()
    session.setup(lead_us=15_000)
    session.transmit(status(0, 0, 2, 0, 0, 0, 0, 0, 0))
    session.receive(ARM)
    session.transmit(status(1, 0, 3, 0, 0, 0, 0, 0, 0))
    session.stream(0, tone[:200])
    session.stream(200, tone[200:400])
    session.play([0] * lead + tone[:80])
    session.transmit(status(2, 0, 5, 0, 320, 80, 0, 0, 200))
    session.stream(400, tone[400:])  # as many as the queue has room for
    session.play(tone[80:180])
    session.transmit(status(2, 0, 6, 0, 300, 180, 0, 0, 300))
    session.receive(STOP)
    session.transmit(status(3, 0, 7, 0, 0, 180, 0, 0, 300))
    session.play(ramp(tone[179]) + [0] * 10)
    session.transmit(status(0, 0, 7, 0, 0, 180, 0, 0, 350))
    session.setup(lead_us=15_000)
    session.transmit(status(0, 0, 8, 0, 0, 180, 0, 0, 350))
    session.receive(ARM)
    session.transmit(status(1, 0, 9, 0, 0, 0, 0, 0, 350))
    session.stream(0, tone[:200])
    session.play([0] * lead + tone[:5])
    session.transmit(status(2, 0, 10, 0, 195, 5, 0, 0, 475))
    broken = session.stream(200, tone[200:400], damage=16)
    due, carries = crc32(broken[:-4]), int.from_bytes(broken[-4:], "little")
    session.transmit(fault(1, 10, due, carries, 475))  # no STATUS is due so soon
    session.play(ramp(tone[4]) + [0] * 10)
    session.transmit(status(0, 1, 10, 0, 0, 5, 0, 1, 525))
    return session.text(
        "What a host sends, byte for byte, that lowers no limit and waits 15 ms: a tone as far as "
        "the queue has room, STOP, armed again, a frame that is damaged on its way; and what a "
        "board of this description plays and answers. Made by tests/firmware_io/golden_sessions.py."
    )


def envelope():
    """The same in reports, with a carrier of 1.7 kHz and samples of 2 kHz."""
    session = Session(in_reports=True)
    codes = [round(20_000 * math.sin(math.pi * n / 80)) for n in range(80)]
    levels = lines(codes, 4) + [codes[-1]] * 4
    out = [0] * LEAD + carried(levels + ramp(codes[-1]), 1_700_000) + [0] * 10
    clock = first_part(session, 1, codes, 4, out)
    session.stream(0, [5000, 20_000], 1)
    levels = lines([5000, 20_000], 4) + [20_000] * 4
    out = [0] * LEAD + carried(levels + ramp(20_000), 1_700_000) + [0] * 10
    session.play(out[:20])
    clock += 20
    broken = session.stream(2, [257], 1, damage=16)
    due, carries = crc32(broken[:-4]), int.from_bytes(broken[-4:], "little")
    session.transmit(fault(1, 12, due, carries, clock), status(3, 1, 12, 1, 0, 2, 2, 1, clock))
    session.play(out[20:])
    session.transmit(status(0, 1, 12, 1, 0, 2, 2, 1, clock + 50))
    return session.text(
        "What a board of this description plays and answers: an envelope in HID reports, an "
        "underrun, STOP, a damaged frame. Made by tests/firmware_io/golden_sessions.py."
    )


def edges():
    """What a reader of the page asked: faults repeated, silence, half frames, the mean."""
    session = Session()
    # HELLO of a host that speaks version 3 only, then a frame of version 5: both faults, although
    # nothing is armed, and the second FAULT repeats the first cause.
    session.hello(3, 3)
    session.transmit(fault(2, 0, 4, 3, 0))
    session.receive_bytes(frame(HELLO, 1, bytes([3, 5]), version=5))
    session.transmit(fault(2, 0, 4, 3, 0))
    session.hello()
    session.capabilities()
    # The header of a PING of 500 bytes: above the longest payload, 6 + 2 * 200, of any kind.
    session.receive_bytes(frame(PING, 9, bytes(500))[:12])
    session.transmit(fault(4, 9, 406, 500, 0))

    # Silence: the line begins behind the lead; the ramp begins RAMP ticks before the 160 of 20 ms.
    session.setup(watchdog_ms=20, status_ms=0)
    session.transmit(status(0, 0, 3, 0, 0, 0, 0, 2, 0))
    session.receive(ARM)
    session.transmit(status(1, 0, 4, 0, 0, 0, 0, 2, 0))
    session.stream(0, [4000] * 200)
    out = [0] * LEAD + [4000] * (160 - RAMP - LEAD) + ramp(4000)
    session.play(out)
    played = 160 - RAMP - LEAD
    session.transmit(fault(15, 0, 20, 0, 160 - RAMP), status(0, 15, 5, 0, 0, played, 0, 3, 160))
    session.stream(200, [0])  # refused: the first cause again, with its own clock
    session.transmit(fault(15, 0, 20, 0, 160 - RAMP))

    # STOP while the output is at 0 V already: one STATUS, and no second one.
    session.receive(ARM, sequence=5)
    session.transmit(status(1, 0, 6, 0, 0, 0, 0, 3, 160))
    session.stream(0, [5, 5])
    session.receive(STOP)
    session.transmit(status(0, 0, 8, 0, 0, 0, 0, 3, 160))
    session.play([0] * 10)
    session.transmit()

    # Half a header, and 100 ms of silence: of a frame whose length is not known 16 bytes are due.
    session.setup(watchdog_ms=150, status_ms=0)
    session.receive(ARM)
    session.transmit(status(1, 0, 10, 0, 0, 0, 0, 3, 170))
    session.stream(0, [4000, 2000])
    session.play([0] * LEAD + [4000, 2000])
    session.receive_bytes(frame(PING, 11, bytes(4))[:8])
    dry = [2000] * HOLD + ramp(2000)
    out += [4000, 2000, *dry]
    session.play(dry + [0] * (800 - len(dry)))
    clock = 170 + LEAD + 2 + 800
    session.transmit(fault(16, 0, 16, 8, clock))
    # The rest of that frame is no frame, the next one is.
    session.receive_bytes(frame(PING, 11, bytes(4))[8:])
    session.receive(PING, struct.pack("<I", 7), sequence=12)
    session.transmit(status(0, 16, 13, 7, 0, 2, 1, 4, clock))

    # 200 V that stay: as many ticks as keep a twentieth of a second at 200 V, together with all
    # that was positive before and a ramp behind them.
    session.receive(ARM)
    session.transmit(status(1, 0, 14, 7, 0, 0, 1, 4, clock))
    top = 200_000 * 32_767 // 250_000
    most = top * OUTPUT_HZ // 20
    ticks = 0
    while sum(out) + (ticks + 1) * top + top * (RAMP - 1) // 2 <= most:
        ticks += 1
    for n in range(2):
        session.stream(200 * n, [top] * 200)
    session.play([0] * LEAD + [top] * ticks + ramp(top) + [0] * 5)
    clock += LEAD + ticks
    session.transmit(
        fault(18, 0, 10_000, 0, clock), status(0, 18, 16, 7, 0, ticks + 1, 1, 5, clock + RAMP + 5)
    )
    return session.text(
        "What a board of this description plays and answers where a reader of the page may doubt: "
        "faults repeated, silence, STOP at 0 V, half a header, a voltage that stays. Made by "
        "tests/firmware_io/golden_sessions.py."
    )


def revise():
    """Samples replaced while they wait, at the guard, up to the end, and what is refused."""
    session = Session()
    session.hello()
    session.capabilities()
    session.setup(watchdog_ms=20, status_ms=0, slew_v_per_s=400_000)  # 6553 codes a sample
    session.transmit(status(0, 0, 2, 0, 0, 0, 0, 0, 0))
    session.receive(ARM)
    session.transmit(status(1, 0, 3, 0, 0, 0, 0, 0, 0))
    session.stream(0, [1000] * 200)
    session.play([0] * LEAD + [1000] * 10)
    bump = [1100, 1200, 1300, 1200]
    session.revise(26, 0, bump)  # 16 samples ahead of the output: the guard
    session.receive(PING, struct.pack("<I", 9))
    session.transmit(status(2, 0, 6, 9, 190, 10, 0, 0, 18, 1, 0, 16))
    session.revise(25, 1, [0])  # late
    session.transmit(status(2, 0, 7, 9, 190, 10, 0, 0, 18, 1, 1, 15))
    session.revise(30, 2, [0])  # made for a queue that the one before had changed
    session.transmit(status(2, 0, 8, 9, 190, 10, 0, 0, 18, 1, 2, 20))
    # Up to the end: what is appended goes on from there, in a step that 1000 would not allow.
    session.revise(140, 1, [2000] * 60)
    session.stream(200, [8000] * 100)
    session.play([1000] * 16 + bump + [1000] * 80)
    session.revise(126, 2, [900] * 4)  # feeds the watchdog, which would end it after 20 ticks more
    session.play([1000] * 16 + [900] * 4 + [1000] * 10 + [2000] * 60 + [8000] * 10)
    # The seam behind the last sample is too steep.
    session.revise(230, 3, [1500, 1000])
    session.play([*ramp(8000), 0])
    session.transmit(
        fault(13, 11, 400_000, 2, 218), status(0, 13, 11, 9, 0, 210, 0, 1, 218 + RAMP + 1, 3, 2, 20)
    )
    # Beyond the end, though late as well: the host has lost count.
    session.receive(ARM)
    session.transmit(status(1, 0, 13, 9, 0, 0, 0, 1, 259))
    session.stream(0, [5] * 20)
    session.revise(10, 0, [5] * 11)
    session.transmit(fault(6, 14, 20, 21, 259))
    return session.text(
        "What a board of this description plays and answers when queued samples are revised: at "
        "the guard, late, out of turn, up to the end, over a seam, beyond the end. Made by "
        "tests/firmware_io/golden_sessions.py."
    )


def dry():
    """Samples that run out, and come back so steep that the gain must wait for them."""
    session = Session()
    session.hello()
    session.capabilities()
    # 26213 codes in 40 steps are 656 codes a step: 40040.3 V/s.
    session.setup(status_ms=0, slew_v_per_s=40_040)
    session.transmit(fault(10, 1, 40_041, 40_040, 0, 16))
    session.setup(status_ms=0, slew_v_per_s=50_000)
    session.transmit(status(0, 0, 3, 0, 0, 0, 0, 1, 0))
    session.receive(ARM)
    session.transmit(status(1, 0, 4, 0, 0, 0, 0, 1, 0))
    most = 50_000 * 32_767_000 // 250_000 // OUTPUT_HZ  # 819 codes in an output sample
    codes = [most * (n if n <= 25 else 50 - n) for n in range(1, 31)]
    session.stream(0, codes)
    gain = RAMP // 2
    session.play([0] * LEAD + codes + codes[-1:] * HOLD + ramp(codes[-1])[:gain])
    back = [codes[-1] + most * (n if n <= 10 else 20 - n) for n in range(1, 61)]
    session.stream(30, back)
    before, out = ramp(codes[-1])[gain - 1], []
    for code in back:
        if gain < RAMP and abs(quotient(code * (gain + 1), RAMP) - before) <= most:
            gain += 1
        before = quotient(code * gain, RAMP)
        out.append(before)
    session.play(out)
    clock = LEAD + 30 + HOLD + RAMP // 2 + 60
    session.receive(STOP)
    session.transmit(status(3, 0, 7, 0, 0, 90, 1, 1, clock))
    session.play([*ramp(before), 0])
    session.transmit(status(0, 0, 7, 0, 0, 90, 1, 1, clock + RAMP + 1))
    return session.text(
        "What a board of this description plays and answers when a steep waveform runs dry and "
        "comes back: no output sample is further from the one before than the slew admits. Made by "
        "tests/firmware_io/golden_sessions.py."
    )


def marked(clock, index, code):
    return MARKED, struct.pack("<QIH", clock, index, code)


def marks():
    """Samples marked before they come, too late, and not played; too many marks."""
    session = Session(takes_marks=True)
    session.hello()
    session.capabilities()
    session.setup(rate_hz=2000, status_ms=0)
    session.transmit(status(0, 0, 2, 0, 0, 0, 0, 0, 0))
    session.receive(ARM)
    session.transmit(status(1, 0, 3, 0, 0, 0, 0, 0, 0))
    codes = [200 * n for n in range(20)]
    session.mark(3, 0x1234)
    session.mark(0, 1)
    session.stream(0, codes)
    session.mark(3, 2)  # of a sample that is marked already
    session.play([0] * LEAD + lines(codes[:10], 4)[:-1])
    # The line to a sample begins 4 output samples before it stands.
    clock = LEAD + 40 - 1
    session.transmit(marked(LEAD + 12, 3, 0x1234), marked(LEAD, 0, 1), marked(LEAD + 12, 3, 2))
    session.mark(9, 7)  # its line has begun
    session.mark(15, 8)
    session.transmit(marked(NEVER, 9, 7))
    session.receive(STOP)  # before sample 15
    session.transmit(status(3, 0, 10, 0, 0, 10, 0, 0, clock))
    level = lines(codes[:10], 4)[-2]
    session.play([*ramp(level), 0])
    clock += RAMP + 1
    session.transmit(status(0, 0, 10, 0, 0, 10, 0, 0, clock))
    session.mark(0, 1)
    session.transmit(fault(7, 10, 0, 0, clock))
    # Eight wait, and no more; sequences while disarmed are free.
    session.receive(ARM, sequence=10)
    session.transmit(status(1, 0, 11, 0, 0, 0, 0, 1, clock))
    for n in range(9):
        session.mark(100 + n, n)
    session.transmit(fault(14, 19, 0, 1, clock))
    return session.text(
        "What a board of this description plays and answers when samples are marked: before they "
        "come, too late, thrown away, too many. Made by tests/firmware_io/golden_sessions.py."
    )


def sense():
    """A panel that is learned, a person's current that is too high, a broken electrode, silence."""
    carrier_mhz = 1_100_000
    session = Session(reports_touch=True, sense_rate_hz=golden_sensing.RATE_HZ)
    session.sensor = {
        "full_scale_na": golden_sensing.FULL_SCALE_NA,
        "panel_pf": golden_sensing.PANEL_PF,
    }
    meter = golden_sensing.Meter(carrier_mhz, sine)
    clock = faults = played = 0

    def now(state, cause, queued):
        fields = (state, cause, session.sent, 0, queued, played, 0, faults, clock)
        session.transmit(status(*fields))

    def told(*first):
        """What the device says: readings last, up to eight in a frame."""
        waiting, meter.readings = meter.readings, []
        parts = [b"".join(waiting[at : at + 8]) for at in range(0, len(waiting), 8)]
        session.transmit(*first, *((SENSE, part) for part in parts))

    def playback(points, changes):
        """Play all that is streamed in pieces of 3 ms, or up to a fault; change the load at a time.

        A load is a capacitance in pF, or None for a converter that says nothing.
        """
        nonlocal clock, faults, played
        session.receive(ARM)
        played = 0
        now(1, 0, 0)
        session.stream(0, points, 1)
        session.play([0] * LEAD)
        clock += LEAD
        meter.begin(clock)
        levels = lines(points, 4)
        phases = [k * meter.step % 2**32 for k in range(len(levels))]
        out = carried(levels, carrier_mhz)
        load, at = 1980, 0
        while at < len(levels):
            load = changes.get(at, load)
            n = 48 if load is None else 24  # 6 ms are too late
            piece = slice(at, min(at + n, len(levels)))
            session.play(out[piece])
            at, clock = piece.stop, clock + piece.stop - piece.start
            played = (at + 3) // 4
            if load is None:
                meter.skip(n)
                told()
                continue
            codes = golden_sensing.current(levels[piece], phases[piece], sine, load, carrier_mhz)
            session.sense(codes)
            cause = meter.take(out[piece], codes)
            if cause is not None:
                faults += 1
                told(fault(cause[0], 0, cause[1], cause[2], clock))
                # Half a ramp, and its end, in two output samples.
                level = quotient(levels[at - 1] * 20, RAMP)
                session.play([quotient(level * sine(phases[at]), 32_767), 0, 0])
                clock += 3
                now(0, cause[0], 0)
                return
            told()
        session.receive(STOP)  # at 0 V
        now(0, 0, 0)

    session.hello()
    session.capabilities()
    session.setup(1, 160, 2000, carrier_mhz, 180_000, 0)
    now(0, 0, 0)
    steady = [2000 * n for n in range(1, 11)] + [20_000] * 190
    playback(steady, {696: 1980 + 800})  # 0.84 mA beside the panel, when it has been measured
    playback(steady, {240: 5})
    # Half a ms beyond 5 ms is told, and all that follows is not believed; then 0 V for 10 ms.
    down = [20_000 - 2000 * n for n in range(1, 11)]
    playback(steady[:60] + down + [0] * 20, {96: None, 144: 1980})
    return session.text(
        "What a board of this description plays, measures and answers: a panel that is learned, a "
        "current beside it that is too high, a broken electrode, a converter that is silent, 0 V. "
        "The codes of a step called sense are those of the output samples played last. Made by "
        "tests/firmware_io/golden_sessions.py."
    )


def samples(kind, sequence, index, codes, mode=0, revision=None):
    head = struct.pack("<I", index) + (b"" if revision is None else struct.pack("<H", revision))
    fields = {"sample_index": index, "mode": mode, "codes": codes}
    fields |= {} if revision is None else {"revision": revision}
    return kind, sequence, fields, head + struct.pack(f"<{len(codes)}h", *codes), mode


def row(kind, sequence, layout, fields):
    packed = [v.encode() if isinstance(v, str) else v for v in fields.values()]
    return kind, sequence, fields, struct.pack(layout, *packed), 0


def frames():
    """One frame of each kind, field by field and as bytes."""
    about = dict(
        zip(
            (*list(BOARD)[:10], "name", "serial", "calibration_id", "reports_touch"),
            (
                *(4, 4, 64, 48_000, 250_000, 200_000, 26_389_378, 4096, 1024, 160),
                *("golden board", "G-0001", "abcdefghijklmnop", True),
            ),
            strict=True,
        )
    )
    kind, number, fields, head, _ = row(CAPABILITIES, 0, "<BBHIIIIIHH16s16s16sH", about)
    fields |= {"rates": [[48_000, [0, 1]], [16_000, [1]]], "guard_ticks": 48}
    told = head + struct.pack("<HIIIII", 2, 48_000, 3, 16_000, 2, 48)
    setup = (
        *("mode", "watchdog_ms", "sample_rate_hz", "full_scale_mv", "ceiling_mv"),
        *("max_slew_v_per_s", "carrier_mhz", "lead_us", "status_ms"),
    )
    state = (
        *("state", "fault", "next_sequence", "token", "queued_samples", "free_samples"),
        *("samples_played", "underruns", "faults", "clock_ticks", "revisions", "refused"),
    )
    cause = ("code", "field_offset", "sequence", "expected", "got", "clock_ticks")
    touch = ("clock_ticks", "x_um", "y_um", "normal_force_mn", "contact", "phase")

    def named(names, *values):
        return dict(zip(names, values, strict=True))

    played = (2, 0, 11, 3735928559, 1200, 2896, 480, 3, 1, 1099511627781, 65535, 2, -5)
    rows = [
        row(HELLO, 0, "<BB", named(("oldest_version", "newest_version"), 3, 4)),
        row(
            SETUP,
            1,
            "<HHIIIIIIH",
            named(setup, 1, 160, 16_000, 250_000, 180_000, 20_000_000, 4_000_000, 25_000, 5),
        ),
        row(ARM, 65535, "<", {}),
        samples(STREAM, 7, 480, [0, 1, -1, 32767, -32767]),
        samples(STREAM, 8, 4294967295, [256], 1),
        row(STOP, 9, "<", {}),
        row(PING, 10, "<I", {"token": 3735928559}),
        samples(REVISE, 11, 4294967290, [-2, 258], 1, 65534),
        row(MARK, 12, "<IH", {"sample_index": 4294967290, "code": 65534}),
        (kind, number, fields, told, 0),
        row(STATUS, 1, "<BBHIIIIIIQHHi", named((*state, "margin_samples"), *played)),
        row(FAULT, 2, "<BBHIIQ", named(cause, 12, 0, 7, 180_000, 180_007, 123_456_789)),
        row(MARKED, 4, "<QIH", {"clock_ticks": 1099511627781, "sample_index": 480, "code": 258}),
        (
            0x86,
            5,
            {"readings": [[1099511627781, -12, 5_026_548, 13107, 0], [1099511627973, 0, 0, 0, 6]]},
            struct.pack("<QiihH", 1099511627781, -12, 5_026_548, 13107, 0)
            + struct.pack("<QiihH", 1099511627973, 0, 0, 0, 6),
            0,
        ),
        row(0x84, 3, "<QIIHBB", named(touch, 48_000, 60_000, 20_000, 500, 1, 2)),
    ]
    names = dict(
        enumerate(("HELLO", "SETUP", "ARM", "STREAM", "STOP", "PING", "REVISE", "MARK"), 1)
    )
    names |= dict(enumerate(("CAPABILITIES", "STATUS", "FAULT", "TOUCH", "MARKED", "SENSE"), 0x81))
    lines = [
        json.dumps(
            {
                "kind": names[kind],
                "sequence": number,
                "fields": fields,
                "bytes": frame(kind, number, payload, mode).hex(" "),
            }
        )
        for kind, number, fields, payload, mode in rows
    ]
    return "[\n  " + ",\n  ".join(lines) + "\n]\n"


SESSIONS = {
    "frames": frames,
    "session-dry": dry,
    "session-edges": edges,
    "session-envelope": envelope,
    "session-host": host,
    "session-marks": marks,
    "session-revise": revise,
    "session-sense": sense,
    "session-waveform": waveform,
}

if __name__ == "__main__":
    for name, make in SESSIONS.items():
        (FOLDER / f"{name}.json").write_text(make())
