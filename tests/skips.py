"""One line for all that was skipped: what would run more tests, and the command that brings it."""

import re
from collections import Counter
from collections.abc import Iterable

#: What `scripts/setup-devices.sh` brings, and the words of the reasons of tests that lack it.
BROUGHT = {
    "a browser": "chromium",
    "Mono": "mono-",
    "an ARM compiler and emulator": "arm",
    "Node 20 and `make clients`": "node",
    "a C compiler": r"\bcc\b|sanitizers",
    "JACK": "missing: ",
    "a display": "xvfb",
}


def summary(reasons: Iterable[str]) -> str:
    """Return the line, empty without a skip."""
    whats = Counter(
        next((what for what, words in BROUGHT.items() if re.search(words, reason.lower())), "")
        for reason in reasons
    )
    others = whats.pop("", 0)
    parts = [f"{what} ({count})" for what, count in whats.most_common()]
    line = ""
    if parts:
        line = f"skipped for want of {', '.join(parts)}: bash scripts/setup-devices.sh brings them"
    if others:
        line += f"{'; ' if line else 'skipped: '}{others} for other reasons"
    return f"{line}; ARGS=-rs lists all" if line else ""
