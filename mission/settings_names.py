"""What an unknown name in a settings file was meant to be."""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches

from pydantic import BaseModel


def unknown_name(model: type[BaseModel], place: Sequence[str | int]) -> str:
    """A message for a name that no setting has, with the nearest one that exists.

    Args:
        model: of the whole file.
        place: section and name, or the name alone, as in the file.
    """
    names = _dotted(model)
    given = ".".join(str(part) for part in place)
    last = str(place[-1])
    same_name = [name for name in names if name.rpartition(".")[2] == last]
    near = same_name or get_close_matches(given, names, n=1, cutoff=0.7)
    if not near:
        by_name = {name.rpartition(".")[2]: name for name in names}
        near = [by_name[name] for name in get_close_matches(last, by_name, n=1, cutoff=0.8)]
    return f"there is no such setting; did you mean {near[0]}?" if near else "there is no such setting"


def _dotted(model: type[BaseModel]) -> list[str]:
    names = []
    for name, field in model.model_fields.items():
        names.append(name)
        if isinstance(field.default, BaseModel):
            names += [f"{name}.{inner}" for inner in type(field.default).model_fields]
    return names
