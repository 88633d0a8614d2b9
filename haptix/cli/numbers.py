"""Numbers as people type them on the command line."""

from __future__ import annotations

from haptix.errors import InputError


def read_numbers(option: str, text: str) -> list[float]:
    """Read numbers separated by commas."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(
            f"--{option}: expected numbers separated by commas, such as 0.2,0.5, got {text!r}"
        ) from None


def read_pair(option: str, text: str) -> tuple[float, float]:
    """Read LOW,HIGH; one value stands for both."""
    numbers = read_numbers(option, text)
    if len(numbers) > 2:
        raise InputError(f"--{option}: expected LOW,HIGH or one value, got {text!r}")
    return numbers[0], numbers[-1]
