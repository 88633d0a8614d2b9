"""How much one frame may hold, and how often a revision may be sent: by set-up, driver and link."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_io.link import Link
from firmware_io.protocol import STREAM_OVERHEAD_BYTES, Setup, samples_per_frame
from firmware_io.setting import MOST_REPORTS_PER_S

#: Reports in a frame: the fewest with less than 15 % overhead (PROTOCOL.md).
_REPORTS_PER_FRAME = 3
_REPORTS_PER_REVISION = 4
_REVISIONS_PER_S = 100  # that a link should carry: the usual touchscreen's reports
_LEAST_INTERVAL_S = 0.0025  # between two revisions, whatever the link
_OTHER_REPORTS_PER_S = 10  # questions to the driver
_USED_SHARE = 0.9  # of a link's bytes
_REVISE_OVERHEAD_BYTES = STREAM_OVERHEAD_BYTES + 2


@dataclass(frozen=True)
class Pace:
    """Sizes of frames and of revisions.

    Parameters
    ----------
    setup : Setup
        The driver's set-up.
    link : Link
        Carries the frames.
    max_frame_samples : int
        Samples in the longest frame that the driver accepts.
    """

    setup: Setup
    link: Link
    max_frame_samples: int

    @property
    def frame_samples(self) -> int:
        """Samples in a whole frame: at most a quarter of the watchdog time."""
        most = self.max_frame_samples
        if self.link.report_bytes is not None:
            most = min(most, samples_per_frame(_REPORTS_PER_FRAME, self.link.report_bytes))
        return max(1, min(most, self._lasting))

    @property
    def most_revised_samples(self) -> int:
        """Samples in the longest revision: in reports, of four of them."""
        most = self.max_frame_samples
        if self.link.report_bytes is not None:
            most = min(most, samples_per_frame(_REPORTS_PER_REVISION, self.link.report_bytes) - 1)
        return max(1, min(most, self._lasting))

    @property
    def _lasting(self) -> int:
        return self.setup.watchdog_ms * self.setup.sample_rate_hz // 4000

    def most_ahead(self, is_revisable: bool) -> int:
        """Return the most samples in the driver: it plays them before its watchdog time is over."""
        setup = self.setup
        if is_revisable:  # and a quarter of that time is for what holds up a frame
            return int(0.75 * setup.watchdog_ms / 1e3 * setup.sample_rate_hz)
        ahead_s = setup.watchdog_ms / 1e3 / 2 - min(setup.lead_us / 1e6, setup.watchdog_ms / 4e3)
        return max(self.frame_samples, int(ahead_s * setup.sample_rate_hz))

    def revision_budget(self, window_s: float) -> tuple[int, float]:
        """Return samples in a revision, and the least time between two; see `Device`."""
        rate_hz, link = self.setup.sample_rate_hz, self.link
        most = min(self.most_revised_samples, int(window_s * rate_hz))
        if link.report_bytes is not None:
            # In whole reports, of those that frames leave over.
            reports = rate_hz / self.frame_samples * _REPORTS_PER_FRAME + _OTHER_REPORTS_PER_S
            left = MOST_REPORTS_PER_S - reports
            each = min(_REPORTS_PER_REVISION, max(1, int(left / _REVISIONS_PER_S)))
            most = min(most, samples_per_frame(each, link.report_bytes) - 1)
            return most, max(_LEAST_INTERVAL_S, each / max(left, 1.0))
        if link.bytes_per_s is not None:
            left = _USED_SHARE * link.bytes_per_s - 2.0 * rate_hz
            most = min(most, int(left / _REVISIONS_PER_S / 2) - _REVISE_OVERHEAD_BYTES // 2)
            most = max(most, 1)
            return most, max(
                _LEAST_INTERVAL_S, (2 * most + _REVISE_OVERHEAD_BYTES) / max(left, 1.0)
            )
        return most, _LEAST_INTERVAL_S
