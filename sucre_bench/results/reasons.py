"""Why a row has no value: the text that rows store, as data."""

from __future__ import annotations

from enum import Enum

from sucre_bench.errors import Death, Lack


class Reason(Enum):
    """Kinds of reasons. The value is the text that rows store, except where the text says more: see `of`."""

    NOTHING_TO_SCORE = "nothing to score in this view"
    NO_VALUE = "no value (NaN)"
    NOT_STORED = "the computed image is not stored; save=full stores it"
    NOT_HELD = "compare_methods holds pictures, not computed images; sucre-bench run with save=full stores them"
    FILLS_LITTLE = "fills less than 1 % of the image"
    NO_SHARED_PIXELS = "no pixel that all methods fill"
    ONE_VIEW = "only one view of the scene is restored; two are needed"
    NO_OVERLAP = "no other restored view shows the same points"
    LACK = "needs ..., the scene has ..."
    DIED = "the process died ..."
    OTHER = "..."

    @classmethod
    def of(cls, text: str) -> Reason:
        """Return the kind of a row's reason: a `Lack`, a `Death`, a text that is equal in all rows, or any other."""
        if Lack.read(text):
            return cls.LACK
        if Death.read(text):
            return cls.DIED
        return _FIXED.get(text, cls.OTHER)


_FIXED = {reason.value: reason for reason in Reason if reason not in (Reason.LACK, Reason.DIED, Reason.OTHER)}


def brief(text: str) -> str:
    """Return a row's reason without what differs between scenes: what is needed, not what there is."""
    lack = Lack.read(text)
    return lack.brief if lack else text


def with_remedy(text: str) -> str:
    """Return a row's reason, followed by the command that makes what is lacking, if there is one."""
    lack = Lack.read(text)
    makes = {"depth", "poses"} & ({*lack.needs} - {*lack.has} if lack else set())
    return f"{text}; `sucre-bench prepare` makes {' and '.join(sorted(makes))}" if makes else text


def without_view(text: str, view: str) -> str:
    """Return a reason without the view's name at its start, so that views with one reason count together."""
    starts_with_it = bool(view) and text.startswith((f"{view} ", f"{view}:"))
    return text.removeprefix(view).lstrip(" :") if starts_with_it else text
