"""The JSON beside a drive file: how to play it, its friction, and whether it can be heard."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import log10, sqrt
from typing import Any

import numpy as np

from haptix.base.checks import Array
from haptix.lab.stimuli.rendering import Apparatus, Block, Rendering, Tally
from haptix.model.perception.thresholds import Audibility, Perception
from haptix.model.status import Status
from haptix.model.surface import Column
from haptix.play.devices import MAX_PEAK_A, MAX_RMS_A, series_capacitance_f

_LOOK_S = 2.0  # length of the middle of a stimulus whose spectra are taken
_BAND = (5.0, 50.0, 95.0)

_NODES = 65  # of the table that pictures are drawn from


def predicted(tally: Tally, response: Column, each: Sequence[Column]) -> dict[str, Any]:
    """Predicted friction at the lowest and highest amplitude, of the median finger and of all."""
    ends = np.array([tally.lowest_amplitude_v, tally.highest_amplitude_v])
    low, high = response.mu(ends)
    amplitude = response.end_v * np.linspace(0, 1, _NODES)
    prediction: dict[str, Any] = {
        "mu_low": float(low),
        "mu_high": float(high),
        "mu_without_voltage": response.lowest_mu,
        "mu_reachable": [response.lowest_mu, response.highest_mu],
        "against_amplitude": {
            "amplitude_v": amplitude.tolist(),
            "mu": response.mu(amplitude).tolist(),
        },
    }
    if len(each) > 1:
        mu = np.array([response.mu(ends) for response in each])
        contrast = mu / np.array([[response.lowest_mu] for response in each]) - 1
        prediction["over_fingers"] = {
            "percentiles": list(_BAND),
            "mu_low": np.percentile(mu[:, 0], _BAND).tolist(),
            "mu_high": np.percentile(mu[:, 1], _BAND).tolist(),
            "contrast_high": np.percentile(contrast[:, 1], _BAND).tolist(),
        }
        all_mu = np.array([response.mu(amplitude) for response in each])
        edges = np.percentile(all_mu, (_BAND[0], _BAND[-1]), axis=0)
        prediction["against_amplitude"] |= dict(
            zip(("mu_p5", "mu_p95"), edges.tolist(), strict=True)
        )
    return prediction


def felt(tally: Tally) -> dict[str, Any] | None:
    """Sensation levels of a stimulus and of its edges; None outside the thresholds' data."""
    loudest = tally.sensation.finish()
    if loudest.sensation_db is None and loudest.edges_db is None:
        return None
    return {
        "channel": loudest.channel,
        "sensation_db": loudest.sensation_db,
        "at_s": loudest.at_s,
        "edges_db": loudest.edges_db,
        "share_without_threshold": loudest.outside_share,
        "threshold_is_placeholder": loudest.is_placeholder,
    }


def spectrum(values: Array, rate_hz: float) -> tuple[Array, Array]:
    """Frequencies [Hz] and amplitudes of a signal's components, in a Hann window."""
    taper = _taper(len(values))
    amplitude = np.abs(np.fft.rfft(values * taper)) * 2 / taper.sum()
    return np.asarray(np.fft.rfftfreq(len(values), 1 / rate_hz)), amplitude


@lru_cache(maxsize=2)
def _taper(size: int) -> Array:
    """Hann window without its zeros."""
    return np.asarray(np.hanning(size + 2)[1:-1])


def reach(name: str, tally: Tally, response: Column) -> str:
    """Name the friction of a stimulus that is not reachable, and the nearest that is."""
    why = {
        Status.ABOVE: "the voltage limit",
        Status.PULL_IN: "pull-in",
        Status.BREAKDOWN: "breakdown",
        Status.FRICTION: "the model's limit of friction",
        Status.PRESSURE: "the model's limit of pressure",
    }[response.ends_by]
    parts = []
    if tally.below:
        parts.append(
            f"friction down to {tally.target_low:.4f} in {tally.below / tally.samples:.1%} of its "
            f"samples, the lowest is {response.lowest_mu:.4f} (no voltage)"
        )
    if tally.above:
        parts.append(
            f"friction up to {tally.target_high:.4f} in {tally.above / tally.samples:.1%} of its "
            f"samples, the highest is {response.highest_mu:.4f} ({why}, {response.end_v:.0f} V)"
        )
    return f"{name}: asks for {'; and for '.join(parts)}"


def _current(
    apparatus: Apparatus, tally: Tally, rate_hz: float, contact_f: float
) -> dict[str, float]:
    """Current through the person: through the contact, leaks included, and the body in series."""
    body_f = apparatus.screen.body_capacitance_f
    capacitance_f = series_capacitance_f(contact_f, body_f)
    expected = tally.current(rate_hz, capacitance_f)
    return {
        "expected_peak_a": expected.peak_a,
        "expected_rms_a": expected.rms_a,
        "capacitance_f": capacitance_f,
        "contact_capacitance_f": contact_f,
        "body_capacitance_f": body_f,
        "limit_peak_a": MAX_PEAK_A,
        "limit_rms_a": MAX_RMS_A,
    }


def sidecar(
    rendering: Rendering,
    apparatus: Apparatus,
    each: Sequence[Column],
    tally: Tally,
    known: Perception,
) -> dict[str, Any]:
    """Return the table, without the file's own format, trigger and hash."""
    stimulus, response = rendering.stimulus, rendering.response
    error = max(float(surface.info["error_max"]) for surface in apparatus.surfaces)
    prediction = predicted(tally, response, each)
    prediction["error_mu_at_most"] = error
    prediction["error_jnd_at_most"] = error / known.difference_mu(response.lowest_mu)
    prediction["error_is"] = (
        "of the surface against its contact model; without the errors of the model and of its "
        "placeholders"
    )
    prediction["friction_is"] = (
        "at the mean attraction of the carrier"
        if stimulus.carrier_hz is not None
        else "mean over a period of the drive, whose ripple is taken as a sine's"
        + ("" if stimulus.speed is None else ", with the finger's response at its speed")
    )
    if tally.past_the_surface:  # of a drive in volts alone
        prediction["share_past_the_surface"] = tally.past_the_surface / tally.samples
    target = None
    if stimulus.quantity != "volts":
        target = {
            "mu_low": tally.target_low,
            "mu_high": tally.target_high,
            "share_below_reach": tally.below / tally.samples,
            "share_above_reach": tally.above / tally.samples,
        }
    # The middle, whose spectra are taken.
    rate = rendering.sample_rate_hz
    count = min(round(_LOOK_S * rate), rendering.samples)
    middle = tally.only or rendering.block((rendering.samples - count) // 2, count)
    changes = tally.sensation.changes if tally.only is middle else None
    contact, highest_v = apparatus.contact(stimulus), tally.highest_amplitude_v
    assert stimulus.frequency_hz is not None  # the apparatus has asked for it
    leak = contact.at("conductance_s", highest_v) / (2 * np.pi * stimulus.frequency_hz)
    capacitance = float(np.hypot(contact.at("capacitance_f", highest_v), leak))
    model, length_s = apparatus.models[0], tally.samples / rate
    current = _current(apparatus, tally, rate, capacitance)
    return {
        "name": stimulus.name,
        "stimulus": stimulus.describe(),
        "quantity": stimulus.quantity,
        "seeds": list(stimulus.signal.seeds),
        "conditions": dict(stimulus.conditions),
        "sample_rate_hz": rate,
        "samples": tally.samples,
        "length_s": tally.samples / rate,
        "carrier_hz": stimulus.carrier_hz,
        "drive_hz": stimulus.frequency_hz,
        "envelope": (
            "none: the voltage is the signal"
            if stimulus.carrier_hz is None
            else "the carrier's amplitude is the signal"
            if stimulus.quantity == "volts"
            else "the carrier's amplitude is what gives the friction, by the surface's inverse"
        ),
        "peak_v": tally.peak_v,
        "rms_v": tally.rms_v,
        "amplitude_v": [tally.lowest_amplitude_v, tally.highest_amplitude_v],
        "normal_force_n": stimulus.normal_force_n,
        "speed": None if stimulus.speed is None else stimulus.speed.describe(),
        "fingers": apparatus.fingers,
        "screen": apparatus.screen.name,
        "h0_m": apparatus.screen.h0_m if stimulus.h0_m is None else stimulus.h0_m,
        "wanted": target,
        "predicted": prediction,
        "friction": tally.friction.describe(),
        "felt": felt(tally),
        "theory": model.theory,
        "terms": sorted(model.terms),
        "x": contact.x,
        "warnings": list(contact.warnings),
        "pull_past_breakdown": contact.at("pull_past_breakdown", highest_v),
        "current": current,
        "dose": {
            "square_voltage_v2_s": tally.square_sum / rate,
            "square_current_a2_s": current["expected_rms_a"] ** 2 * length_s,
        },
        "audibility": heard(middle, rate, capacitance, known.audibility, changes),
        "placeholders": apparatus.placeholders(),
        "is_placeholder": bool(apparatus.placeholders()),
        "surface_hash": apparatus.surface_keys(),
        "profile_hash": apparatus.profile_hash(),
    }


#: A ripple of the attraction below this share of its mean is not counted as an envelope.
_LEAST_RIPPLE = 0.01

#: Poles of A-weighting [Hz] and its gain at 1 kHz [dB] (IEC 61672-1, annex E).
_A_POLES = (20.598997, 107.65265, 737.86223, 12194.217)

_A_GAIN_DB = 1.9997


def a_weighting_db(frequency_hz: Array) -> Array:
    """A-weighting [dB] at frequencies above 0: how loud a tone is beside one of 1 kHz."""
    square = np.square(frequency_hz)
    one, two, three, four = (pole**2 for pole in _A_POLES)
    top = four * square**2
    bottom = (square + one) * np.sqrt((square + two) * (square + three)) * (square + four)
    return np.asarray(20 * np.log10(top / bottom) + _A_GAIN_DB)


@dataclass(frozen=True, eq=False)
class _Lines:
    """Hann window of a length without its zeros, and the audible lines of its spectrum."""

    taper: Array
    total: float
    first: int
    end: int
    frequency_hz: Array
    a_power: Array


@lru_cache(maxsize=4)
def _lines(size: int, rate_hz: float, low_hz: float, high_hz: float) -> _Lines:
    taper = np.hanning(size + 2)[1:-1]
    frequency: Array = np.fft.rfftfreq(size, 1 / rate_hz).astype(np.float64)
    first, end = np.searchsorted(frequency, low_hz), np.searchsorted(frequency, high_hz, "right")
    heard = frequency[first:end]
    a_power = 10 ** (a_weighting_db(heard) / 10)
    return _Lines(taper, float(taper.sum()), int(first), int(end), heard, a_power)


def _power(values: Array, lines: _Lines) -> Array:
    spectrum = np.fft.rfft(values * lines.taper)
    return np.asarray(spectrum.real**2 + spectrum.imag**2)


def _shares(power: Array, lines: _Lines) -> tuple[float, float | None]:
    """Share of a power in the audible range, and its A-weighted level [dB] below the whole."""
    whole = float(power.sum())
    if not whole:
        return 0.0, None
    part = power[lines.first : lines.end]
    weighted = float(part @ lines.a_power) / whole
    return float(part.sum()) / whole, 10 * log10(weighted) if weighted else None


def heard(
    middle: Block,
    rate_hz: float,
    capacitance_f: float,
    known: Audibility,
    changes: Array | None = None,
) -> dict[str, Any]:
    """Flag a carrier or an envelope in the audible range, at the current that the finger draws.

    The strongest component of the drive and that of its envelope are checked. The current of a
    component of amplitude V at f is ``2 pi f C V / sqrt(2)``. An envelope is checked at the current
    of the whole drive.

    Parameters
    ----------
    middle : Block
        The samples to look at.
    rate_hz : float
        Samples per second.
    capacitance_f : float
        Of the finger's contact.
    known : Audibility
        Range and current.
    changes : ndarray, optional
        Power spectrum of the changes of ``instant_v**2 / 4`` in a Hann window, where it is known.
    """
    drive = middle.drive_v
    lines = _lines(len(drive), rate_hz, known.low_hz, known.high_hz)
    square = np.square(middle.instant_v)
    mean = float(square.mean())
    attraction = _power(square - mean, lines) if changes is None else 16 * changes
    of_drive = _power(drive, lines)
    # f V is largest where its square is.
    strength = of_drive[lines.first : lines.end] * lines.frequency_hz**2
    moving = attraction[lines.first : lines.end]
    carrier_hz, current_a, envelope_hz = 0.0, 0.0, None
    if strength.size:
        strongest = int(strength.argmax())
        carrier_hz = float(lines.frequency_hz[strongest])
        largest = 2 * sqrt(float(strength[strongest])) / lines.total
        current_a = 2 * np.pi * capacitance_f * largest / sqrt(2)
        rippling = int(moving.argmax())
        if 2 * sqrt(float(moving[rippling])) / lines.total > _LEAST_RIPPLE * mean:
            envelope_hz = float(lines.frequency_hz[rippling])
    total_a = capacitance_f * rate_hz * _rms_slope(drive)
    drive_flag = known(carrier_hz, current_a)
    envelope_flag = envelope_hz is not None and known(envelope_hz, total_a)
    drive_share, drive_db = _shares(of_drive, lines)
    envelope_share, envelope_db = _shares(attraction, lines)
    return {
        "audible": drive_flag or envelope_flag,
        "drive_is_audible": drive_flag,
        "envelope_is_audible": envelope_flag,
        "drive_hz": carrier_hz,
        "drive_current_a_rms": current_a,
        "envelope_hz": envelope_hz,
        "current_a_rms": total_a,
        "drive_share_in_range": drive_share,
        "drive_a_weighted_db": drive_db,
        "envelope_share_in_range": envelope_share,
        "envelope_a_weighted_db": envelope_db,
        "emission": "not known: no sound level is given; measure the panel's at the ear",
        "advice": _advice(
            carrier_hz if drive_flag else None, envelope_hz if envelope_flag else None
        ),
        "rule": (
            f"flagged where the drive's or the envelope's strongest component lies within "
            f"{known.low_hz:g} to {known.high_hz:g} Hz at a current of {known.current_a:g} A rms "
            f"or more, through at most {capacitance_f:.3g} F ({known.source}); shares are of the "
            "energy of the drive and of the attraction's changes, levels their A-weighted energy "
            "(IEC 61672-1) over the whole"
        ),
    }


def _rms_slope(drive: Array) -> float:
    """Rms of the central differences, one-sided at the ends."""
    if len(drive) < 2:
        return 0.0
    inner = drive[2:] - drive[:-2]
    ends = (drive[1] - drive[0]) ** 2 + (drive[-1] - drive[-2]) ** 2
    return sqrt((float(np.sum(inner * inner)) / 4 + float(ends)) / len(drive))


def _advice(drive_hz: float | None, envelope_hz: float | None) -> str:
    """Return advice about a flagged drive or envelope."""
    if drive_hz is None and envelope_hz is None:
        return "not flagged, and yet a panel may be heard: listen before the session"
    said = []
    if drive_hz is not None:
        said.append(
            f"the drive may be heard at {drive_hz:.0f} Hz, and its attraction at {2 * drive_hz:.0f}"
        )
    if envelope_hz is not None:
        said.append(
            f"the envelope may be heard at {envelope_hz:.0f} Hz, so that stimuli may be told apart "
            "by ear"
        )
    ceiling = max(filter(None, (2 * drive_hz if drive_hz else None, envelope_hz)))
    return (
        f"{'; '.join(said)}: mask it by noise up to {ceiling:.0f} Hz over closed headphones, and "
        "ask a listener without touch to tell the stimuli apart"
    )
