import os

# Torch's threads wait for each other by spinning: on a busy machine the small arrays of these tests
# would take ten times as long with two threads as with one. Subprocesses inherit the variable.
os.environ["OMP_NUM_THREADS"] = "1"

import torch

torch.set_num_threads(1)
