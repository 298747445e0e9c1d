"""Sorts the words of a command: a line-up, bare words, and overrides for Hydra."""

from __future__ import annotations

import difflib
import shlex
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from sucre_bench import plugins
from sucre_bench.errors import InputError
from sucre_bench.jobs.explain_mistakes import not_an_override
from sucre_bench.jobs.presets import presets
from sucre_bench.jobs.quoting import quoted
from sucre_bench.machine.files import expanded

if TYPE_CHECKING:
    from hydra.core.override_parser.types import Override


def expand_home(override: str) -> str:
    """Expand a leading ~ of the value; the shell does so only at the start of a word."""
    key, equals, value = override.partition("=")
    bare = value.strip("'\"")
    return f"{key}='{expanded(bare)}'" if equals and bare.startswith("~/") else override


def line_up_file(words: Sequence[str]) -> Path | None:
    """Return the line-up among the words, None where there is none. Raises InputError for two."""
    files = [word for word in words if _is_bare(word) and Path(word).suffix.lower() in (".yaml", ".yml")]
    if len(files) > 1:
        raise InputError(f"{files[1]}: a second line-up; run one at a time")
    return expanded(files[0]) if files else None


def parse(texts: Iterable[str]) -> list[Override]:
    """Read overrides. Raises InputError for one that Hydra's grammar does not have, with how to write it."""
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import HydraException

    parser, parsed = OverridesParser.create(), []
    for text in texts:
        try:
            parsed.append(parser.parse_override(text))
        except HydraException as fault:
            raise not_an_override(text, fault) from fault
    return parsed


def refuse_bare_words(words: Sequence[str]) -> None:
    """Raise InputError for words that are no key=value, with the command that was probably meant."""
    bare = [word for word in words if _is_bare(word)]
    if not bare:
        return
    if bare[0].partition(".")[0] in ("method", "dataset", "metrics", "degrade", "study") and "." in bare[0]:
        raise InputError(f"{bare[0]}: has no value; an override reads key=value, write {bare[0]}=VALUE")
    meant = _meant(words)
    remedy = f"write {meant}" if meant else "`sucre-bench list methods` and `list datasets` show the names"
    raise InputError(f"{bare[0]}: an override reads key=value; {remedy}")


def _is_bare(word: str) -> bool:
    return "=" not in word and not word.startswith("~")


def _meant(words: Sequence[str]) -> str:
    """The command with a key before each bare word; empty where a word is like no name."""
    keyed: dict[str, list[str]] = {}
    for word in filter(_is_bare, words):
        key, name = next(_readings(word, keyed), ("", ""))
        if not key:
            return ""
        keyed.setdefault(key, []).append(name)
    several = "-m " if any(len(names) > 1 for key, names in keyed.items() if key != "metrics") else ""
    said = [f"{key}=[{','.join(n)}]" if key == "metrics" else f"{key}={','.join(n)}" for key, n in keyed.items()]
    return f"sucre-bench run {several}{shlex.join([*said, *(word for word in words if not _is_bare(word))])}"


def _readings(word: str, keyed: Iterable[str]) -> Iterator[tuple[str, str]]:
    """What a bare word may be, likeliest first: the key that goes before it, and the name that is meant."""
    names = {
        "dataset": [*plugins.discover("dataset")],
        "method": [*plugins.discover("method"), *(preset.name for preset in presets("method"))],
        "metrics": [*plugins.discover("metric")],
        "experiment": [preset.name for preset in presets("experiment")],
    }
    yield from ((key, word) for key, known in names.items() if word in known and (key != "dataset" or key not in keyed))
    if expanded(word).is_dir():
        yield "dataset", quoted(word if "/" in word else f"./{word}")
    near = {name: key for key, known in names.items() for name in known}
    yield from ((near[name], name) for name in difflib.get_close_matches(word, near, n=1, cutoff=0.7))
