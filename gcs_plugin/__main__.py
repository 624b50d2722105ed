"""`python -m gcs_plugin` is the `sidestep` command."""

from gcs_plugin.cli import main

main()
