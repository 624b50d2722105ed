"""The MAVProxy module: `module load gcs_plugin.mavproxy`, then `locate help`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gcs_plugin.mavproxy.module import LocateModule


def init(mpstate: Any, **values: object) -> LocateModule:
    """What MAVProxy calls to load the module. The other parts run without MAVProxy, which is imported only here."""
    from gcs_plugin.mavproxy.module import LocateModule

    return LocateModule(mpstate, values)
