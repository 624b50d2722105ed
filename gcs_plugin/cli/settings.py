"""`sidestep settings`: print all settings with their defaults, as a TOML file to start from."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import typer
from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from mission.settings import MissionSettings


def register(app: typer.Typer) -> None:
    """Add the command to the application."""

    @app.command()
    def settings() -> None:
        """Print all settings with their defaults, as a TOML file to start from."""
        typer.echo("\n".join(settings_toml(MissionSettings)))


def settings_toml(model: type[BaseModel]) -> Iterator[str]:
    """Lines of a TOML file that holds every default; those that have none stand in comments."""
    yield f"# {_first_line(model)}"
    sections = []
    for name, field in model.model_fields.items():
        if isinstance(field.default, BaseModel):
            sections.append((name, field))
        else:
            yield from _line(name, field)
    for name, field in sections:
        yield ""
        yield f"[{name}]  # {_first_line(type(field.default))}"
        for inner, inner_field in type(field.default).model_fields.items():
            yield from _line(inner, inner_field)


def _line(name: str, field: FieldInfo) -> Iterator[str]:
    value = field.default
    remarks = [field.description or "", _range(field)]
    comment = "; ".join(remark for remark in remarks if remark)
    tail = f"  # {comment}" if comment else ""
    if value is None or value is PydanticUndefined:
        yield f"# {name} ={tail}"
    else:
        yield f"{name} = {json.dumps(str(value) if isinstance(value, Path) else value)}{tail}"


def _range(field: FieldInfo) -> str:
    signs = {Ge: ("at least", "ge"), Gt: ("above", "gt"), Le: ("at most", "le"), Lt: ("below", "lt")}
    words = [
        f"{word} {getattr(rule, attribute)}"
        for rule in field.metadata
        for kind, (word, attribute) in signs.items()
        if isinstance(rule, kind)
    ]
    choices = getattr(field.annotation, "__args__", ())
    if choices and all(isinstance(choice, str) for choice in choices):
        words.append(" | ".join(str(choice) for choice in choices))
    return ", ".join(words)


def _first_line(model: type[BaseModel]) -> str:
    return (model.__doc__ or "").strip().splitlines()[0]
