"""The `code` of a row: hashes of what made it, with dots between them. The table stores it as text."""

from __future__ import annotations

from dataclasses import dataclass

_DIGITS = 12


@dataclass(frozen=True)
class RowCode:
    """What made a row."""

    restoration: str
    """Hash of the code that restored, 12 digits, followed by that of the charts which the method looked at."""

    metric: str = ""
    """Hash of the metric's source; "-" and a hash of its options follow if it has any. Empty for a restoration."""

    seen: str = ""
    """Hash of the charts, or of the restored views, that the metric looked at."""

    mask: str = ""
    """Hash of the common pixels that were scored."""

    @classmethod
    def read(cls, text: str, on_common: bool = False) -> RowCode:
        """Return what a row says. on_common: whether it is of a score on common pixels, whose hash comes last."""
        rest, _, mask = text.rpartition(".") if on_common else (text, "", "")
        restoration, metric, seen = [*rest.split(".", 2), "", ""][:3]
        return cls(restoration, metric, seen, mask)

    def __str__(self) -> str:
        return ".".join(filter(None, (self.restoration, self.metric, self.seen, self.mask)))

    @property
    def method(self) -> str:
        """The hash of the code that restored, without charts."""
        return self.restoration[:_DIGITS]

    @property
    def metric_source(self) -> str:
        """The hash of the metric's source, without its options."""
        return self.metric.partition("-")[0]

    @property
    def metric_options(self) -> str:
        """The hash of the metric's options; empty if it has none."""
        return self.metric.partition("-")[2]
