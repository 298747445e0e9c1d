"""The names in a message: what its reader needs of it, however the sentence is built."""

from __future__ import annotations

import re

_PUNCTUATION = "'\"`,;:.?!"
_TOGETHER = re.compile(r"(?<!\w)(?=('[^']*'|[\[(][^][()]*[\])]))")  # a quotation, an interval, a shape
_CALLED = re.compile(r"\w+(?=\()")


def names(message: object) -> set[str]:
    """Each word, number and path of a message, without the punctuation around it.

    A quotation stands with its quotes too, to tell a suggestion from the names that are listed after it.

    >>> sorted(names("x/a.json: no 'gan', did you mean 'gain'? (2 in [0, 1])") & {"a.json", "gan", "'gain'", "[0, 1]"})
    ["'gain'", '[0, 1]', 'a.json', 'gan']
    """
    text = str(message)
    whole = {word.strip("()").lstrip("'\"`").rstrip(_PUNCTUATION) for word in text.split()}
    bare = {word.strip(_PUNCTUATION + "()[]") for word in whole}
    return {
        *whole,
        *bare,
        *(word.rpartition("/")[2] for word in bare),
        *_TOGETHER.findall(text),
        *_CALLED.findall(text),
    }
