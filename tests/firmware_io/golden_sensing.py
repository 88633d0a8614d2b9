"""What a device with a converter measures, calculated from PROTOCOL.md alone, sample by sample."""

import math
import struct

OUTPUT_HZ, FULL_SCALE_MV = 8000, 250_000
RATE_HZ, FULL_SCALE_NA, PANEL_PF = 1000, 10_000_000, 2000
LIES, LATE = 2, 3
PEAK_CURRENT, NO_CURRENT = 19, 21


def quotient(a, b):
    """Rounded toward 0."""
    return -(-a // b) if a < 0 else a // b


class Meter:
    """A converter that stays believed while nothing but its load fails.

    Parameters
    ----------
    carrier_mhz : int
        The carrier.
    sine : callable
        The sine of a phase.
    """

    def __init__(self, carrier_mhz, sine):
        self.step = carrier_mhz * 2**32 // (1000 * OUTPUT_HZ)
        self.s, self.c = sine(self.step), sine((self.step + 2**30) % 2**32)
        rad_per_s = -(-carrier_mhz * 411_775 // 65_536_000)
        ratio = rad_per_s * FULL_SCALE_MV // 1000 * PANEL_PF // 1000 * 65_536 // FULL_SCALE_NA
        self.p = min(ratio, 131_072)
        self.x, self.y = 0, self.p
        self.least = (10_000 * 32_767 // FULL_SCALE_MV) ** 2 // 2
        self.readings = []  # bytes of each
        self.measured = self.offset = 0
        self.problem = 0
        self.begin(0)

    def begin(self, clock):
        """Begin with a playback, whose first output sample has this clock."""
        self.clock = clock
        self.before = self.missing = self.lies = 0
        self.start_over()

    def start_over(self):
        self.half, self.reading = [], []
        self.last_energy = self.last_ahead = 0
        self.has_risen = False

    def skip(self, ticks):
        """Play without a word of the converter, of which 5 ms are too many."""
        self.clock += ticks
        self.start_over()
        if ticks > OUTPUT_HZ * 5 // 1000:
            self.problem = LATE
            self.keep(self.clock, 0, 0, 0)

    def take(self, drives, codes):
        """Take output samples; return the fault that ends them, as code, expected and got."""
        fault = None
        untouched = self.clock + len(drives) >= OUTPUT_HZ * 50 // 1000
        for drive, code in zip(drives, codes, strict=True):
            if (drive < 0) != (self.before < 0):
                broken = self.end_half(is_rising=drive >= 0, untouched=untouched)
                fault = fault or broken
            self.half.append((drive, self.before, code))
            self.before = drive
            self.clock += 1
            ticks = len(self.half) + sum(row[0] for row in self.reading)
            is_due = ticks * RATE_HZ >= OUTPUT_HZ and len(self.half) * self.step >= 2**32
            if is_due and fault is None:
                self.keep(self.clock, 0, 0, 0)
                self.start_over()
        return fault

    def end_half(self, *, is_rising, untouched):
        half, self.half = self.half, []
        energy, last = sum(row[0] ** 2 for row in half), self.last_energy
        self.last_energy = energy
        fault = None
        if energy and last:
            is_steady = energy < last + last // 8 and last < energy + energy // 8
            if is_steady and energy > len(half) * self.least:
                fault = self.judge(half, energy, last)
            if self.has_risen:
                self.reading.append(self.sums(half))
        self.last_ahead = self.ahead(*self.sums(half)[2:4])
        if is_rising:
            if self.has_risen and sum(row[0] for row in self.reading) >= OUTPUT_HZ // RATE_HZ:
                self.end_reading(untouched)
                self.reading = []
            self.has_risen = True
        return fault

    def rests(self, half):
        b = quotient(self.y * 32_767, self.s)
        a = self.x + quotient(b * self.c, 32_767)
        halved = 0
        while max(abs(a), abs(b)) > 32_767:
            a, b, halved = quotient(a, 2), quotient(b, 2), halved + 1
        shift = 16 - halved
        rests = [code - self.offset - (a * D >> shift) - (-b * d >> shift) for D, d, code in half]
        return [max(-32_767, min(32_767, rest)) for rest in rests]

    def sums(self, half):
        rests = self.rests(half)
        return (
            len(half),
            sum(row[0] ** 2 for row in half),
            sum(rest * row[0] for rest, row in zip(rests, half, strict=True)),
            sum(rest * row[1] for rest, row in zip(rests, half, strict=True)),
            sum(row[2] for row in half),
        )

    def ahead(self, in_phase, before):
        return quotient(self.c * in_phase - 32_767 * before, self.s)

    def judge(self, half, energy, last_energy):
        """Return the fault of a half period."""
        if self.problem:
            return None
        current = sum((row[2] - self.offset) ** 2 for row in half)
        rests = self.rests(half)
        _, _, in_phase, before, _ = self.sums(half)
        sizes = math.isqrt(sum(r * r for r in rests)) * math.isqrt(energy)
        is_load = -self.ahead(in_phase, before) < quotient(sizes, 5)
        least = 3 * quotient(self.y, 32) if self.measured == 16 else 3 * quotient(self.p, 4)
        now = self.ahead(in_phase, before)
        of_period = quotient((now + self.last_ahead) * 65_536, energy + last_energy)
        is_less = of_period < -least
        self.lies = self.lies + 1 if is_less and not self.missing else 0
        peak = 700_000 * 32_767 // FULL_SCALE_NA
        half_of_it = self.p // 2
        if current > energy * (half_of_it**2 >> 12) >> 20:
            self.missing = 0
        else:
            self.missing += len(half)
            if self.missing > len(half) and self.missing >= OUTPUT_HZ // 2000:
                return NO_CURRENT, self.p, math.isqrt(current // len(half))
        if self.measured == 16 and is_load and max(map(abs, rests)) > peak:
            return PEAK_CURRENT, peak, max(map(abs, rests))
        return None

    def end_reading(self, untouched):
        n, energy, in_phase, before, codes = map(sum, zip(*self.reading, strict=True))
        x, y = (
            part + quotient(rest * 65_536, energy)
            for part, rest in ((self.x, in_phase), (self.y, self.ahead(in_phase, before)))
        )
        amplitude = min(math.isqrt(2 * energy // n), 32_767)
        in_phase_na, ahead_na = (
            quotient(ratio * amplitude * FULL_SCALE_NA, 65_536 * 32_767) for ratio in (x, y)
        )
        self.keep(self.clock, in_phase_na, ahead_na, amplitude)
        third = self.p // 3
        is_panel = abs(y - self.p) <= third and abs(x) <= (self.p + third) // 2
        is_driven = energy // n > self.least and self.problem == 0
        is_more = self.measured == 16 and y > self.y + quotient(self.y, 256)
        if is_driven and untouched and is_panel and not is_more:
            self.measured = min(self.measured + 1, 16)
            self.x += quotient(x - self.x, self.measured)
            self.y += quotient(y - self.y, self.measured)
        self.offset = max(-256, min(256, quotient(codes, n)))

    def keep(self, clock, in_phase_na, ahead_na, driven):
        flags = (LIES if self.lies or self.missing else self.problem) << 1
        self.readings.append(struct.pack("<QiihH", clock, in_phase_na, ahead_na, driven, flags))


def current(levels, phases, sine, pf, carrier_mhz, leak_pf=0):
    """Return codes of the current of a capacitance, as a converter of 12 bits gives them."""
    codes = []
    for number, (level, phase) in enumerate(zip(levels, phases, strict=True)):
        rad_per_s = 2 * math.pi * carrier_mhz / 1000
        full = rad_per_s * FULL_SCALE_MV * 1e-3 * 1e-12 * 1e9 / FULL_SCALE_NA
        ahead = sine((phase + 2**30) % 2**32) * pf * full
        code = level * (ahead + sine(phase) * leak_pf * full) / 32_767
        # An offset of 40 codes, and what looks like noise.
        codes.append((round(code) + 40 + number * 7 % 5 * 8) // 16 * 16)
    return codes
