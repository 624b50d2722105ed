"""One thread for each process: tests run beside each other, and threads would wait for each other."""

from __future__ import annotations

import os

from hypothesis import settings

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(name, "1")

settings.register_profile("unhurried", deadline=None)  # a slow machine is no fault of the code
settings.load_profile("unhurried")
