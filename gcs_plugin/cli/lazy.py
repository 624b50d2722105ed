"""Commands that are listed without being imported, so that `sidestep --help` is quick and needs no extra.

The sentence beside a command's name is the first line of its module's docstring, read from the source.
"""

from __future__ import annotations

import ast
import importlib
import re
from importlib.abc import InspectLoader
from importlib.util import find_spec
from typing import Any

import typer
from typer.core import TyperCommand
from typer.main import get_group

_PREFIX = re.compile(r"^`sidestep [^`]*`: ")


class LazyCommand(TyperCommand):
    """A command that imports its module when it runs, or when its own help is asked for.

    Args:
        name: of the command.
        module: with `register(app)`, which adds the command to a Typer application.
    """

    def __init__(self, name: str, module: str) -> None:
        super().__init__(name, help=summary(module))
        self._module = module

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> Any:
        """Import the command and let it parse its arguments; the context is of the imported command."""
        app = typer.Typer(pretty_exceptions_enable=False)
        importlib.import_module(self._module).register(app)
        command = get_group(app).commands[self.name or ""]
        return command.make_context(info_name, args, parent=parent, **extra)


def summary(module: str) -> str:
    """The first line of a module's docstring without the command's name; empty where there is no source."""
    spec = find_spec(module)
    loader = spec.loader if spec is not None else None
    source = loader.get_source(module) if isinstance(loader, InspectLoader) else None
    if source is None:
        return ""
    line = (ast.get_docstring(ast.parse(source)) or "").partition("\n")[0]
    text = _PREFIX.sub("", line)
    return text[:1].upper() + text[1:]
