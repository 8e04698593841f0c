"""How good is the pose graph: flights made by simulation at the level of registrations, with known truth."""

import os

# CPU time is told for one thread: numpy's libraries read this once, when they are loaded, after this.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
