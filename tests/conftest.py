"""One thread for each process: tests run beside each other, and threads that wait for each other cost more than they bring."""

from __future__ import annotations

import os

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(name, "1")
