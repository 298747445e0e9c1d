"""Makes names of files that any system takes, and says which names are one on some systems."""

import hashlib
import re
import unicodedata

# of a name without suffix; file systems take 255 bytes with it, some archives 200
_MOST_BYTES = 190
_REFUSED = re.compile(r'[\x00-\x1f\x7f<>:"/\\|?*]')  # by Windows


def portable_name(text: str, unlike: str = "") -> str:
    """Return a text as the name of a file or folder, without suffix, on Linux, macOS and Windows.

    What a system refuses becomes "_". A name too long is cut and ends on a hash of the text.
    unlike: where other texts have this name, a text that they do not have: the name ends on its hash.
    """
    name = _REFUSED.sub("_", text).rstrip(". ") or "_"
    content = _bytes(name)
    if not unlike and len(content) <= _MOST_BYTES:
        return name
    cut = content[: _MOST_BYTES - 20].decode(errors="ignore")
    return f"{cut}-{hashlib.blake2b(_bytes(unlike or text), digest_size=6).hexdigest()}"


def _bytes(text: str) -> bytes:
    """A name as file systems have it, whatever the locale."""
    return text.encode(errors="surrogateescape")


def folded(name: object) -> str:
    """Return a text that is equal for names that are one file where capitals or forms of accents do not count."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", str(name)).casefold())
