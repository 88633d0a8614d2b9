"""A board at a pseudo-terminal, with haptix's own firmware in it.

By itself it prints its port, and goes on until its input ends.
"""

import os
import pty
import select
import sys
import threading
import time
import tty

from firmware_io import MockDriver


class Board(threading.Thread):
    """Restarts when its port is opened: it says its boot text, and is deaf for a while."""

    def __init__(self, deaf_s, text=b"", driver=MockDriver):
        super().__init__(daemon=True)
        self.deaf_s, self.text, self.make = deaf_s, text, driver
        self.controller, port = pty.openpty()
        tty.setraw(port)
        self.port = os.ttyname(port)
        os.close(port)
        self.end = threading.Event()

    def run(self):
        poll = select.poll()
        poll.register(self.controller, select.POLLIN | select.POLLHUP)
        driver, hears_s = None, None
        while not self.end.is_set():
            flags = dict(poll.poll(1)).get(self.controller, 0)
            if flags & select.POLLHUP:  # nobody has the port open
                driver, hears_s = None, None
                self.end.wait(0.001)
                continue
            if hears_s is None:
                hears_s = time.monotonic() + self.deaf_s
                os.write(self.controller, self.text)
            data = os.read(self.controller, 4096) if flags & select.POLLIN else b""
            if time.monotonic() < hears_s:
                continue
            driver = driver or self.make()
            driver.receive(data)
            if answer := driver.transmit():
                os.write(self.controller, answer)


if __name__ == "__main__":
    board = Board(0.0, driver=lambda: MockDriver(pace="real", clock=time.monotonic))
    sys.stdout.write(f"{board.port}\n")
    sys.stdout.flush()
    board.start()
    sys.stdin.read()
    board.end.set()
