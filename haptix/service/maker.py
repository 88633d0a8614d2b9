"""The process that draws, checks, decodes and exports, as the service's front sees it."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from typing import Any

from haptix.service.helper import HelperProcess
from haptix.service.messages import Problem

LONGEST_S = 20.0
"""An answer that takes longer ends the process: a picture that is a bomb, or a fault of ours."""
MOST_WAITING = 16


class Maker(HelperProcess):
    """Starts the process with the first question, and anew when it has ended.

    Parameters
    ----------
    opening : dict
        Assets, surface, finger and screen, as the engine has them.
    longest_s : float
        Longest time for one answer, from when its turn comes; that of the first one has as much
        again, for the process to start.
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
        is_new = self.pid is None
        try:
            async with asyncio.timeout(self._longest_s * (2 if is_new else 1)):
                if is_new:
                    await self.launch()
                    await super().ask("open", **self.opening)
                return await super().ask(do, **fields)
        except TimeoutError:
            await self.stop()
            raise Problem("limit", f"{do}: took more than {self._longest_s:g} s") from None
