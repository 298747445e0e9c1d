"""Texts of files and messages: YAML, JSON, times, text without passwords, tracebacks."""

from __future__ import annotations

import functools
import hashlib
import json
import re
import traceback
from collections.abc import Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from sucre_bench.errors import in_words


def read_yaml(text: str) -> Any:
    """Return the value of a YAML text as OmegaConf reads it: dates stay text.

    Raises yaml.YAMLError, and MarkedYAMLError where a line can be named. Also for an alias (with merge keys, 400 bytes
    of them stand for gigabytes), and for a key that stands twice.
    """
    import yaml

    try:
        return yaml.load(text, _loader())
    except (
        ValueError,
        TypeError,
        LookupError,
        AttributeError,
        RecursionError,
    ) as fault:
        # of tags with odd values
        raise yaml.YAMLError(in_words(fault)) from fault


@functools.cache
def _loader() -> type[Any]:
    import yaml
    from omegaconf._utils import get_yaml_loader

    class Loader(get_yaml_loader()):  # type: ignore[misc]
        def compose_node(self, parent: Any, index: Any) -> Any:
            event = self.peek_event()
            if isinstance(event, yaml.AliasEvent):
                raise yaml.MarkedYAMLError(
                    problem=f"*{event.anchor} is an alias", problem_mark=event.start_mark
                )
            return super().compose_node(parent, index)

    return Loader


def json_text(value: Any) -> str:
    """Return a value as indented JSON, with null for NaN, and 1e999 for infinity, as which every reader takes it.

    >>> print(json_text({"low": float("nan")}))
    {
     "low": null
    }
    """
    known = json.loads(
        json.dumps(value), parse_constant=lambda name: None if name == "NaN" else float(name)
    )
    return re.sub(
        r"^(.*?)(-?)Infinity(,?)$",
        r"\1\g<2>1e999\3",
        json.dumps(known, indent=1),
        flags=re.MULTILINE,
    )


def short_hash(text: str) -> str:
    """Return the hash of a text that rows and names of files have: 12 hex digits."""
    return hashlib.blake2b(text.encode(), digest_size=6).hexdigest()


# -- rows, messages and logs -------------------------------------------------------------------------------


def now() -> str:
    """Return the time as rows have it: UTC, ISO 8601, microseconds."""
    return datetime.now(UTC).isoformat(timespec="microseconds")


# An address, up to a blank, a bracket or a quote. A password before the last "@" may hold those, and "/", "?" and "#".
_ADDRESS = re.compile(r"://(?:(?!/)\S*@)?[^\s'\"<>()]*")
_USER = re.compile(r"^://(?!/).*@")
_VALUE = re.compile(r"(?<=[?&;#])([^=&;#]*=)?[^&;#]+")


def masked(text: str) -> str:
    """Return text with "***" for all of its addresses that may be secret: user, password, and values after "?" or "#".

    >>> masked("postgresql://me:secret@host/runs?token=abc")
    'postgresql://***@host/runs?token=***'
    """
    return _ADDRESS.sub(
        lambda found: _VALUE.sub(r"\1***", _USER.sub("://***@", found[0])), text
    )


def keep_traceback(log: Path | None, where: str) -> None:
    """Append the exception being handled to a log of tracebacks, if there is one."""
    if log is None:
        return
    with suppress(OSError):  # the row has the reason, too
        log.parent.mkdir(parents=True, exist_ok=True)
        with log.open("a", encoding="utf-8", errors="backslashreplace") as file:
            file.write(f"--- {now()} {where}\n{masked(traceback.format_exc())}\n")


def natural_order(name: str) -> tuple[list[str | int], str]:
    """Return what sorts names as people count: 2.png before 10.png."""
    parts = re.split(r"([0-9]+)", name)
    return [int(part) if n % 2 else part for n, part in enumerate(parts)], name


def counted(number: int, name: str) -> str:
    """Return a number with its name: "1 table", "2 tables"."""
    return f"{number} {name}{'' if number == 1 else 's'}"


def first_few(names: Sequence[str], n: int) -> str:
    """Return the first n names, and an ellipsis if there are more: "a, b, ..."."""
    return ", ".join(names[:n]) + (", ..." if len(names) > n else "")
