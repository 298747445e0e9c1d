"""The words of a command: read by Hydra's grammar, and written in it and for a shell."""

from __future__ import annotations

import contextlib
import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sucre_bench.errors import InputError

if TYPE_CHECKING:
    from hydra.core.config_loader import ConfigLoader

# Words that Hydra does not read as text, in any case.
_NO_TEXT = frozenset({"true", "false", "null", "nan", "inf"})


@dataclass(frozen=True)
class Word:
    """A setting, typed or of an experiment."""

    key: str
    """As given."""

    values: tuple[Any, ...]
    """Of which each job has one; none of an interval or an empty range."""

    text: str
    """The whole word."""

    is_swept: bool = False
    """Whether labels name its value."""

    is_deleted: bool = False
    """Whether the key is taken out (~key)."""

    line: str = ""
    """The word as Hydra is to read it."""

    is_glob: bool = False
    """Whether the values are all names that fit."""

    @property
    def head(self) -> str:
        """The key up to its first dot."""
        return self.key.partition(".")[0]

    @property
    def option(self) -> str:
        """The key behind its first dot, empty without one."""
        return self.key.partition(".")[2]

    @property
    def value(self) -> str:
        """What stands behind the key, as Hydra is to read it."""
        return self.line.partition("=")[2]


def literal(value: Any) -> Any:
    """Return a value in which OmegaConf finds nothing to interpolate."""
    if isinstance(value, (list, tuple)):
        return [literal(one) for one in value]
    if isinstance(value, Mapping):
        return {key: literal(one) for key, one in value.items()}
    return re.sub(r"(\\*)\$\{", r"\1\1\\${", value) if isinstance(value, str) else value


_QUOTED = r"""'(?:\\.|[^'])*'|"(?:\\.|[^"])*\""""
# Text in quotes, or a bare value of a list or a mapping.
_VALUE = re.compile(_QUOTED + r"""|(?<![^,\[:])[^][{},:'"$ ]+(?![^],}])""")


def parse(texts: Iterable[str], loader: ConfigLoader | None = None) -> list[Word]:
    """Read overrides. Raises InputError for one that Hydra's grammar does not have, with how to quote it.

    loader: knows the names that glob() may mean.

    A number that Hydra would write in another way stays text, for it may be a name: 2026_11_22, not 20261122. The type
    of its option tells whether it is a number.
    """
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.core.override_parser.types import Glob
    from hydra.errors import HydraException

    parser = OverridesParser.create(loader)
    words = []
    for text in texts:
        key, equals, typed = text.partition("=")
        readable = typed if "(" in typed else _VALUE.sub(_literal_number, typed)
        try:
            (override,) = parser.parse_overrides([f"{key}{equals}{readable}"])
            values: list[Any] = [override.value()]
            is_swept = override.is_sweep_override()
            if is_swept:
                each = override.sweep_string_iterator() if override.is_discrete_sweep() else ()
                values = [parser.parse_override(f"{key}={one}").value() for one in each]
        except HydraException as fault:
            value = quoted(typed.strip("'\""))
            if typed.startswith("["):
                value = value_of([name.strip() for name in typed[1:].rstrip("]").split(",")])
            remedy = f"write {shell([f'{key}={value}'])}"
            raise InputError("special characters need quotes", text, remedy) from fault
        name = override.get_key_element().lstrip("+~")
        # + is for keys that Hydra does not know, and ours are all known
        as_read = key if name.startswith("hydra") else key.lstrip("+")
        if name.startswith("hydra.sweeper.params"):
            as_read = f"++{name}"
        words.append(
            Word(
                name,
                tuple(values),
                text,
                is_swept,
                override.is_delete(),
                f"{as_read}{equals}{readable}",
                isinstance(override.value(), Glob),
            )
        )
    return words


def _literal_number(found: re.Match[str]) -> str:
    """A value in quotes if it is a number, true or false in another form than Hydra gives it back."""
    text = found[0]
    for read in (int, float):
        with contextlib.suppress(ValueError):
            return text if str(read(text)) == text else f"'{text}'"
    return f"'{text}'" if text.lower() in ("true", "false") and not text.islower() else text


def first_line(fault: BaseException) -> str:
    """Return what Hydra or OmegaConf says in its first line with content."""
    lines = str(fault).strip().splitlines() or [type(fault).__name__]
    if lines[0].endswith(":"):
        lines = lines[1:] or lines
    return lines[0].strip().rstrip(".:")


def quoted(text: str) -> str:
    """Return any text as the value of an override: bare if Hydra reads that as the same text, else in quotes.

    Backslashes are doubled right before a quote, and before ``${``, which is escaped: it would be interpolated. All
    others are read as they are.
    """
    is_number = re.fullmatch(r"\.[\d_]+(e[+-]?\d+)?", text, re.IGNORECASE)
    if (
        re.fullmatch(r"[A-Za-z_./][\w./-]*", text, re.ASCII)
        and text.lower() not in _NO_TEXT
        and not is_number
    ):
        return text
    escaped = re.sub(
        r"(\\*)('|$)", lambda found: found[1] * 2 + (r"\'" if found[2] else ""), literal(text)
    )
    return f"'{escaped}'"


def value_of(value: Any) -> str:
    """Return a value, of an option as rows keep it, as Hydra reads it back."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (list, tuple)):
        return f"[{','.join(map(value_of, value))}]"
    if isinstance(value, Mapping):
        return "{" + ",".join(f"{k}:{value_of(v)}" for k, v in value.items()) + "}"
    return quoted(value) if isinstance(value, str) else repr(value)


def shell(words: Sequence[str]) -> str:
    """Words as a shell takes them: in double quotes where a word has single ones and nothing that is read within."""
    return " ".join(map(_in_shell, words))


def _in_shell(word: str) -> str:
    is_plain_in_double = not set(word) & set('"$`\\!')
    return f'"{word}"' if "'" in word and is_plain_in_double else shlex.quote(word)
