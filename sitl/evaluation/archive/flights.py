"""The benchmark's flights: seeded, so that everybody gets the same ones; the truth lies apart from what is given out.

OUT/
    given/f000.mp4, f000.tlog, f000.camera.toml     what a program gets
    truth/f000.truth.json                           what it does not
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final, get_args

from sitl.evaluation.rendered.case import drawn_cases
from sitl.recorded.flight import LogName, record

GIVEN: Final = "given"
TRUTH: Final = "truth"
KINDS: Final[tuple[LogName, ...]] = get_args(LogName)


def make_flights(out: Path, count: int, seed: int, kind: LogName = "tlog") -> Iterator[str]:
    """Write flights that are not there yet; each one's name as it is done.

    Args:
        out: made where it is not there.
        count: how many.
        seed: of the draw; the k-th flight is the same whatever the count.
        kind: of the logs.

    Raises:
        VideoError: there is no renderer.
    """
    given, truth = out / GIVEN, out / TRUTH
    given.mkdir(parents=True, exist_ok=True)
    truth.mkdir(exist_ok=True)
    for k, case in enumerate(drawn_cases(count, seed)):
        name = f"f{k:03d}"
        kept = truth / f"{name}.truth.json"
        if not kept.exists():
            # The truth is moved last: it says that the flight is whole.
            record(case, given, kind, name).truth.replace(kept)
        yield name
