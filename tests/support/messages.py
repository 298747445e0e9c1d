"""The names in a message: what its reader needs of it, however the sentence is built."""

import contextlib
import re
import threading
from collections import Counter
from collections.abc import Iterator

import pytest

from sucre_bench.errors import InputError

_PUNCTUATION = "'\"`,;:.?!"
# a quotation, an interval, a shape
_TOGETHER = re.compile(r"(?<!\w)(?=('[^']*'|[\[(][^][()]*[\])]))")
_CALLED = re.compile(r"\w+(?=\()")


def names(message: object) -> set[str]:
    """Each word, number and path of a message, without the punctuation around it.

    A quotation stands with its quotes too, to tell a suggestion from the names that are listed after it.

    >>> sorted(names("x/a.json: no 'gan', did you mean 'gain'? (2 in [0, 1])") & {"a.json", "gan", "'gain'", "[0, 1]"})
    ["'gain'", '[0, 1]', 'a.json', 'gan']
    """
    text = str(message)
    words = {word.rstrip(",;:.") for word in text.split()}
    whole = {word.strip("()").lstrip("'\"`").rstrip(_PUNCTUATION) for word in words}
    bare = {word.strip(_PUNCTUATION + "()[]") for word in whole}
    # of a.py:12
    parts = {
        part for word in bare for part in (word.rpartition("/")[2], word.partition(":")[0])
    }
    return {*words, *whole, *bare, *parts, *_TOGETHER.findall(text), *_CALLED.findall(text)}


@contextlib.contextmanager
def refused(*named: str, error: type[Exception] = InputError) -> Iterator[None]:
    """What is within raises an error whose message is one line and has these names."""
    with pytest.raises(error) as fault:
        yield
    assert "\n" not in str(fault.value)
    assert set(named) <= names(fault.value)


class Lines:
    """Keeps every line that is said, and counts the steps of each line of work. has_one: set when a line is said."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.has_one = threading.Event()
        self.works: dict[str, tuple[str, int | None]] = {}
        self.steps: Counter[str] = Counter()

    def __call__(self, event: str, *values: object) -> None:
        if event == "said":
            self.lines.append(str(values[0]))
            self.has_one.set()
        elif event == "started":
            number, what, total = values
            self.works[str(number)] = str(what), total if isinstance(total, int) else None
        elif event == "advanced":
            self.steps[self.works[str(values[0])][0]] += 1
