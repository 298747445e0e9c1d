"""Parts of the light that differ between observations, and the words for them."""

from __future__ import annotations

from dataclasses import dataclass

from sucre_bench.errors import InputError


@dataclass(frozen=True, slots=True)
class Parts:
    """Which parts the light has; gains: numbers a view, 0, 1 (exposure) or 3 (white_balance)."""

    gains: int = 0
    lens: bool = False
    strobe: bool = False

    @property
    def words(self) -> list[str]:
        words = {
            "exposure": self.gains == 1,
            "white_balance": self.gains == 3,
            "lens": self.lens,
            "strobe": self.strobe,
        }
        return [word for word, has in words.items() if has]


AUTO, EVEN = "auto", "even"
_WORDS = {"exposure": Parts(1), "white_balance": Parts(3), "lens": Parts(lens=True), "strobe": Parts(strobe=True)}


def parts_of(words: str, place: str) -> Parts | None:
    """Return the parts that a user chose, "exposure+lens"; None for auto. InputError, naming the place, for others."""
    if words == AUTO:
        return None
    parts = Parts()
    for word in words.split("+") if words != EVEN else []:
        if word not in _WORDS:
            known = (AUTO, EVEN, *_WORDS)
            raise InputError(f"{place}: '{word}' is not a choice; use one of {', '.join(known)}, or parts joined by +")
        one = _WORDS[word]
        parts = Parts(max(parts.gains, one.gains), parts.lens or one.lens, parts.strobe or one.strobe)
    return parts
