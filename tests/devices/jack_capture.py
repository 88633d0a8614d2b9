"""A JACK client "cap" that keeps what it hears, until its standard input ends."""

import json
import os
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import jack
import numpy as np

# Ahead of every ordinary program on a busy machine; JACK's own thread waits for this one's lock.
with suppress(PermissionError):
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))

blocks, times, xruns = [], [], []
client = jack.Client("cap", no_start_server=True)
ports = [client.inports.register(f"in{number}") for number in range(2)]


@client.set_process_callback
def process(frames):
    times.append(time.monotonic())
    blocks.append([bytes(port.get_buffer()) for port in ports])


@client.set_xrun_callback
def xrun(microseconds):
    xruns.append(microseconds)


longest_stall_s, ended = 0.0, threading.Event()


def watch():
    """Note for how long the machine stood still, whatever JACK and the player did."""
    global longest_stall_s
    before = time.monotonic()
    while not ended.wait(0.002):
        now = time.monotonic()
        longest_stall_s, before = max(longest_stall_s, now - before), now


watching = threading.Thread(target=watch)
with client:
    watching.start()
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    sys.stdin.read()
    ended.set()
    watching.join()
    period_s = client.blocksize / client.samplerate
heard = [b"".join(block[number] for block in blocks) for number in range(2)]
folder = Path(sys.argv[1])
np.save(folder / "heard.npy", [np.frombuffer(channel, np.float32) for channel in heard])
late_s = np.array(times) - np.arange(len(times)) * period_s
late_s -= np.median(late_s)
(folder / "capture.json").write_text(
    json.dumps(
        {
            "xruns": len(xruns),
            "late_p99_s": float(np.percentile(late_s, 99)),
            "longest_stall_s": longest_stall_s,
        }
    )
)
