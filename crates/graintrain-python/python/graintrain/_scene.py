"""Scenes as dicts: their text in TOML, which is what the reader of scenes takes and names in messages."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Mapping
from typing import Any


def value(thing: Any, place: str) -> str:
    """A value as TOML has it."""
    if hasattr(thing, "tolist"):  # numbers and arrays of NumPy
        thing = thing.tolist()
    if isinstance(thing, bool):
        return "true" if thing else "false"
    if isinstance(thing, int):
        return str(thing)
    if isinstance(thing, float):
        return repr(thing) if math.isfinite(thing) else str(thing)
    if isinstance(thing, os.PathLike):
        thing = os.fspath(thing)
    if isinstance(thing, str):
        # TOML's basic strings have the escapes of JSON.
        return json.dumps(thing)
    if isinstance(thing, Mapping):
        return "{ " + ", ".join(f"{json.dumps(key(k, place))} = {value(v, f'{place}.{k}')}" for k, v in thing.items()) + " }"
    if isinstance(thing, Iterable):
        return "[" + ", ".join(value(item, place) for item in thing) + "]"
    raise TypeError(f"{place}: a scene has numbers, texts, bools, lists and dicts, not {type(thing).__name__}")


def key(thing: Any, place: str) -> str:
    """A key, which has to be a text."""
    if isinstance(thing, str):
        return thing
    raise TypeError(f"{place or 'scene'}: keys are texts, not {type(thing).__name__} ({thing!r})")


def text(scene: Mapping[str, Any]) -> str:
    """The scene's text: a line for every key, in the order of the dict."""
    lines = []
    for name, thing in scene.items():
        name = key(name, "")
        if isinstance(thing, Mapping) and thing:
            # Tables of tables (bodies, packings): a line for each, which messages can point to.
            for inner, item in thing.items():
                lines.append(f"{json.dumps(name)}.{json.dumps(key(inner, name))} = {value(item, f'{name}.{inner}')}")
        else:
            lines.append(f"{json.dumps(name)} = {value(thing, name)}")
    return "\n".join(lines) + "\n"


def settings(changes: Mapping[str, Any] | Iterable[str]) -> list[str]:
    """Changes of a scene as KEY=VALUE."""
    if isinstance(changes, str):
        raise TypeError(f"set is a dict or a list of texts, not one text: [{changes!r}]")
    if isinstance(changes, Mapping):
        return [f"{key(k, 'set')}={v if isinstance(v, str) else value(v, k)}" for k, v in changes.items()]
    return [key(item, "set") for item in changes]
