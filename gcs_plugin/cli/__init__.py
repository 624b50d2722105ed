"""The command line: `sidestep ...`, one file per command."""

from gcs_plugin.cli.app import main

__all__ = ["main"]
