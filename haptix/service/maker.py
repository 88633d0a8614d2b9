"""The process that draws, checks, decodes and exports, as the service's front sees it."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from typing import Any

from haptix.service.helper import HelperProcess
from haptix.service.messages import Problem

LONGEST_S = 20.0
"""An answer that takes longer ends the process: a picture that is a bomb, or a fault of ours."""
START_S = 120.0
"""For the process to start: torch loads in 20 s where other programs use both cores."""
MOST_WAITING = 16


class Maker(HelperProcess):
    """Starts the process with the first question, and anew when it has ended.

    Parameters
    ----------
    opening : dict
        Assets, surface, finger and screen, as the engine has them.
    longest_s : float
        Longest time for one answer, from when its turn comes and the process has started.
    """

    def __init__(self, opening: dict[str, Any], longest_s: float = LONGEST_S) -> None:
        super().__init__("making", "maker", longest_s)
        self.opening, self._longest_s = opening, longest_s
        self._turn = asyncio.Lock()
        self._waiting = 0
        self._ends = False

    async def ask(self, do: str, **fields: Any) -> dict[str, Any]:
        """Return the answer to a question.

        Raises
        ------
        Problem
            If it is refused, takes too long, or too many wait.
        """
        if self._waiting >= MOST_WAITING:
            raise Problem("limit", f"expected at most {MOST_WAITING} questions that wait")
        self._waiting += 1
        try:
            async with self._turn:
                if self._ends:
                    raise Problem("device", f"{do}: the service ends")
                return await self._ask_now(do, fields)
        finally:
            self._waiting -= 1

    async def warm(self, do: str = "warm") -> None:
        """Start the process before the first question; `do` says for what."""
        with suppress(Problem):  # the question that needs it will tell
            await self.ask(do)

    def end(self) -> None:
        """End the process at once; all questions that wait are refused."""
        self._ends = True
        self.kill()

    async def stop(self) -> None:
        """End the process."""
        self.kill()
        await super().stop()

    async def _ask_now(self, do: str, fields: dict[str, Any]) -> dict[str, Any]:
        limit_s = START_S
        try:
            if self.pid is None:
                async with asyncio.timeout(limit_s):
                    await self.launch()
                    await super().ask("open", **self.opening)
            limit_s = self._longest_s
            async with asyncio.timeout(limit_s):
                return await super().ask(do, **fields)
        except TimeoutError:
            await self.stop()
            raise Problem("limit", f"{do}: took more than {limit_s:g} s") from None
