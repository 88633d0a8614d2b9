"""Events of made-up touch panels, as the kernel sends them, with what truly touches at each report.

The kernel keeps the values of slots and keys and sends what changes; protocol A sends every contact
in every report (Documentation/input/multi-touch-protocol.rst).
"""

import random
from collections import Counter
from dataclasses import dataclass, field

from haptix.play.touch import AxisRange, ScreenAxes, SlotDecoder
from haptix.play.touch import touchscreen as codes

AXES = ScreenAxes(AxisRange(0, 4095, 20.0), AxisRange(0, 2303, 20.0))
SLOTS = 3
SHOWN_BY = ("distance", "key", "pressure")
"""How a panel says that a finger hovers: each alone."""


@dataclass
class Contact:
    """A finger near the panel."""

    number: int
    x: int
    y: int
    height: int  # above the glass; 0 touches
    is_palm: bool = False

    @property
    def touches(self):
        return self.height == 0 and not self.is_palm


@dataclass
class Panel:
    """Fingers that come, hover, land, slide, lift and leave at random."""

    protocol: str
    shown_by: str
    chance: random.Random
    contacts: dict[int, Contact] = field(default_factory=dict)  # by slot
    numbers: int = 0
    has_pressed: bool = False
    sent: dict = field(default_factory=dict)
    slot: int = 0

    def step(self):
        """Let one thing happen."""
        chance = self.chance
        most = 1 if self.protocol == "single" or self.shown_by == "key" else SLOTS
        slot = chance.randrange(most)
        contact = self.contacts.get(slot)
        if contact is None:
            self.numbers += 1
            hovers = chance.random() < 0.7 and self.may_hover
            self.contacts[slot] = Contact(
                self.numbers,
                chance.randrange(1, 4096),
                chance.randrange(1, 2304),
                5 if hovers else 0,
            )
        elif (what := chance.random()) < 0.3:
            contact.x = min(4095, contact.x + chance.randrange(60))
        elif what < 0.5:
            contact.height = 0
        elif what < 0.7:
            contact.height = chance.randrange(1, 20)
        elif what < 0.75 and self.protocol == "B":
            contact.is_palm = not contact.is_palm
        elif what < 0.8 and self.protocol == "B":  # another finger in the slot, none between
            self.numbers += 1
            height = 3 * int(self.may_hover)
            self.contacts[slot] = Contact(self.numbers, chance.randrange(1, 4096), 100, height)
        else:
            del self.contacts[slot]

    @property
    def may_hover(self):
        """By pressure alone fingers are known to hover once one has touched."""
        return self.shown_by != "pressure" or self.has_pressed

    @property
    def key(self):
        """Value of BTN_TOUCH."""
        if self.shown_by == "key" or self.protocol == "single":
            return int(any(contact.height == 0 for contact in self.contacts.values()))
        return int(bool(self.contacts))

    def values(self, contact):
        """Values of a slot, by code."""
        if contact is None:
            return {codes.ABS_MT_TRACKING_ID: -1}
        values = {
            codes.ABS_MT_TRACKING_ID: contact.number,
            codes.ABS_MT_POSITION_X: contact.x,
            codes.ABS_MT_POSITION_Y: contact.y,
            codes.ABS_MT_TOOL_TYPE: 2 if contact.is_palm else 0,
        }
        if self.shown_by == "distance":
            values[codes.ABS_MT_DISTANCE] = contact.height
        if self.shown_by == "pressure":
            values[codes.ABS_MT_PRESSURE] = 40 if contact.height == 0 else 0
        return values

    def ask(self):
        """What the kernel answers: the current slot, and the values of all."""
        return self.slot, {
            slot: {
                code: self.sent.get((slot, code), -1 if code == codes.ABS_MT_TRACKING_ID else 0)
                for code in codes.SLOT_CODES
            }
            for slot in range(SLOTS)
        }

    def ask_key(self):
        """Whether BTN_TOUCH is 1, as the kernel answers."""
        return self.sent.get((None, codes.BTN_TOUCH), 0) == 1

    def report(self):
        """Events (type, code, value) of what changed since the last report, with its end."""
        self.has_pressed |= any(each.height == 0 for each in self.contacts.values())
        return [*self._places(), *self._changes(None, {codes.BTN_TOUCH: self.key}), (0, 0, 0)]

    def _changes(self, slot, values):
        changed = [(c, v) for c, v in values.items() if self.sent.get((slot, c), 0) != v]
        self.sent.update({(slot, c): v for c, v in values.items()})
        return [(codes.EV_KEY if slot is None else codes.EV_ABS, c, v) for c, v in changed]

    def _places(self):
        if self.protocol == "A":
            for contact in self.contacts.values():
                for code, value in self.values(contact).items():
                    if code not in (codes.ABS_MT_TRACKING_ID, codes.ABS_MT_TOOL_TYPE):
                        yield codes.EV_ABS, code, value
                yield codes.EV_SYN, codes.SYN_MT_REPORT, 0
            if not self.contacts:
                yield codes.EV_SYN, codes.SYN_MT_REPORT, 0
        elif self.protocol == "single":
            values = self.values(self.contacts[0]) if self.contacts else {}
            for code, known in codes.SINGLE_CODES.items():
                if known in values:
                    found = self._changes(0, {known: values[known]})
                    yield from ((codes.EV_ABS, code, value) for _, _, value in found)
        else:
            for slot in range(SLOTS):
                self.sent.setdefault((slot, codes.ABS_MT_TRACKING_ID), -1)
                changes = self._changes(slot, self.values(self.contacts.get(slot)))
                if changes and slot != self.slot:
                    self.slot = slot
                    yield codes.EV_ABS, codes.ABS_MT_SLOT, slot
                yield from changes

    @property
    def touching(self):
        """Places [mm] of the fingers that touch."""
        touching = (each for each in self.contacts.values() if each.touches)
        return Counter(AXES.place_mm(each.x, each.y) for each in touching)


def reports(seed, protocol, count=10, begin_us=0, interval_us=10_000):
    """A random sequence: the panel, its touches, the decoder, and whether events were lost."""
    chance = random.Random(f"{protocol} {seed}")
    panel = Panel(protocol, chance.choice(SHOWN_BY), chance)
    asks = chance.random() < 0.5
    # Before it is opened. A recording begins where no finger is near; and where pressure alone
    # shows hovering, that of each finger must have been seen.
    for _ in range(chance.randrange(3) if asks and panel.shown_by != "pressure" else 0):
        panel.step()
        list(panel.report())
    decoder = SlotDecoder(
        AXES,
        panel.ask if asks and protocol != "A" else None,
        protocol,
        panel.ask_key if asks else (lambda: False) if panel.shown_by == "key" else None,
        codes.SLOT_CODES if panel.shown_by == "distance" else (codes.ABS_MT_TOOL_TYPE,),
    )
    missed = False
    for number in range(count):
        panel.step()
        events = list(panel.report())
        missed = missed and not asks
        if (
            panel.shown_by != "pressure" and chance.random() < 0.05
        ):  # the kernel drops the begin of the report
            del events[: chance.randrange(len(events))]
            events.insert(0, (codes.EV_SYN, codes.SYN_DROPPED, 0))
            missed = protocol == "A" or not asks
        at_s, at_us = divmod(begin_us + interval_us * number, 1_000_000)
        found = [touch for event in events for touch in decoder.feed(at_s, at_us, *event)]
        yield panel, found, decoder, missed
