"""Which extra of the distribution brings a module that is not installed."""

from __future__ import annotations

import re
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, requires

from mission.errors import InputError

_REQUIREMENT = re.compile(r"^(?P<name>[A-Za-z0-9._-]+).*;.*extra\s*==\s*[\"'](?P<extra>[^\"']+)[\"']")
_DISTRIBUTION = "sidestep"


def missing_extra(error: ModuleNotFoundError) -> InputError | None:
    """The error that tells the operator which extra to install.

    Args:
        error: of an import.

    Returns:
        None when the module is in no extra: then it is a fault of the program.
    """
    module = (error.name or "").partition(".")[0]
    try:
        extra = extra_of(module, requires(_DISTRIBUTION) or ())
    except PackageNotFoundError:  # run from a source tree that was never installed
        extra = None
    if extra is None:
        return None
    return InputError(
        f"This command needs {module}, which is not installed", f"pip install '{_DISTRIBUTION}[{extra}]'."
    )


def extra_of(module: str, requirements: Iterable[str]) -> str | None:
    """The extra that requires the distribution of the same name as `module`, or None.

    Args:
        module: top-level module.
        requirements: as in a distribution's metadata (Requires-Dist).
    """
    for requirement in requirements:
        found = _REQUIREMENT.match(requirement)
        if found and _normal(found["name"]) == _normal(module):
            return found["extra"]
    return None


def _normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()
