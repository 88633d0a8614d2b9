"""Tasks per second of a campaign on one process of this machine, and on two.

    python benchmarks/campaign_efficiency.py [benchmarks/campaigns/own-load.toml] [--tasks 16]

Processes are started and have done a task before the clock runs; each has one thread of torch.
The results of both are compared by their hashes.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from campaign_faults import tree

from haptix.tasks.campaign import load_campaign, run_campaign
from haptix.tasks.campaign.processes import Processes


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    own = Path(__file__).parent / "campaigns" / "own-load.toml"
    parser.add_argument("plan", nargs="?", type=Path, default=own)
    parser.add_argument("--tasks", type=int, default=16)
    asked = parser.parse_args()
    plan, rates, trees = load_campaign(asked.plan), [], []
    for count in (1, 2):
        with TemporaryDirectory() as folder, Processes(count) as pool:
            run_campaign(plan, folder, pool, most=count)
            began = time.perf_counter()
            run_campaign(plan, folder, pool, most=asked.tasks)
            rates.append(asked.tasks / (time.perf_counter() - began))
            trees.append(tree(Path(folder)))
        print(f"{count} process(es): {rates[-1]:.3f} tasks a second", flush=True)
    same = all(trees[1].get(name) == digest for name, digest in trees[0].items())
    print(f"2 processes do {rates[1] / rates[0]:.2f} times as much as 1; results equal: {same}")


if __name__ == "__main__":
    main()
