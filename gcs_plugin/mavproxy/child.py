"""`python -m gcs_plugin.mavproxy.child serve ...`: the `sidestep` command, ended when its parent ends.

The parent holds the other end of standard input. When the parent is killed, that end closes, and this program gets the
SIGTERM that the parent could not send: an aircraft that it flies is put into hold.
"""

from __future__ import annotations

import os
import signal
import threading
from typing import Final

_CHUNK: Final = 4096


def end_with_parent(descriptor: int) -> None:
    """Send SIGTERM to this process when the parent's end of a pipe closes.

    Args:
        descriptor: of the pipe; what comes through it is thrown away.
    """

    def watch() -> None:
        while os.read(descriptor, _CHUNK):
            pass
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=watch, name="parent-watch", daemon=True).start()


if __name__ == "__main__":
    from gcs_plugin.cli import main

    end_with_parent(0)
    main()
