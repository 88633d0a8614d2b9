"""The process that draws, checks and exports, as the service's front sees it."""

from __future__ import annotations

import asyncio
import json
import sys
from typing import Any

from haptix.service.messages import Problem
from haptix.service.wire import HEADER, MOST_BYTES, json_frame

LONGEST_S = 20.0
"""An answer that takes longer ends the process: a picture that is a bomb, or a fault of ours."""
MOST_WAITING = 16


class Maker:
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
        self.opening, self._longest_s = opening, longest_s
        self._process: asyncio.subprocess.Process | None = None
        self._turn = asyncio.Lock()
        self._waiting = self._number = 0

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
                return await self._ask_now(do, fields)
        finally:
            self._waiting -= 1

    async def stop(self) -> None:
        """End the process."""
        process, self._process = self._process, None
        if process is not None and process.returncode is None:
            process.kill()
            await process.wait()

    async def _ask_now(self, do: str, fields: dict[str, Any]) -> dict[str, Any]:
        is_new = self._process is None or self._process.returncode is not None
        try:
            async with asyncio.timeout(self._longest_s * (2 if is_new else 1)):
                if is_new:
                    self._process = await asyncio.create_subprocess_exec(
                        sys.executable,
                        "-m",
                        "haptix.service.making",
                        stdin=asyncio.subprocess.PIPE,
                        stdout=asyncio.subprocess.PIPE,
                        limit=MOST_BYTES,
                    )
                    await self._exchange("open", self.opening)
                answer = await self._exchange(do, fields)
        except TimeoutError:
            await self.stop()
            raise Problem("limit", f"{do}: took more than {self._longest_s:g} s") from None
        except (asyncio.IncompleteReadError, ConnectionError):
            await self.stop()
            raise Problem("internal", f"{do}: its process ended; ask again") from None
        except asyncio.CancelledError:
            await self.stop()  # its answer would be taken for the next one's
            raise
        if "problem" in answer:
            wrong = answer["problem"]
            raise Problem(wrong["code"], wrong["sentence"], wrong.get("path", ""))
        return answer

    async def _exchange(self, do: str, fields: dict[str, Any]) -> dict[str, Any]:
        assert self._process is not None and self._process.stdin and self._process.stdout
        self._number += 1
        self._process.stdin.write(json_frame({"n": self._number, "do": do, **fields}))
        await self._process.stdin.drain()
        length, _ = HEADER.unpack(await self._process.stdout.readexactly(HEADER.size))
        answer: dict[str, Any] = json.loads(await self._process.stdout.readexactly(length))
        answer.pop("n")
        return answer
