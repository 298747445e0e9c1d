"""How fast methods and metrics run on this machine, measured once and stored in the user's cache."""

import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from sucre_bench.errors import OutputError
from sucre_bench.machine.files import user_cache, write_atomically


@dataclass(frozen=True)
class Rates:
    """What a method and its metrics take.

    view_s: for a view of any size; restore_s, restore_mb: for a megapixel; with methods of several views for a
    megapixel and view that shows it; score_s: seconds to score and write, and file_mb: MB of files, for a megapixel;
    decode_s: to decode image and depth map, for a megapixel.
    """

    view_s: float
    restore_s: float
    restore_mb: float
    score_s: float
    file_mb: float
    decode_s: float


class MeasuredRates:
    """Rates by what they are of. path: of the file; one that cannot be read or written is done without."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def get(self, key: str, measure: Callable[[], Rates]) -> Rates:
        """Return the rates of a key, measured now if they were not before."""
        known = self._read()
        with suppress(KeyError, TypeError, ValueError):
            return Rates(**{field.name: float(known[key][field.name]) for field in fields(Rates)})
        rates = measure()
        with suppress(OutputError):
            write_atomically(self._path, json.dumps({**self._read(), key: asdict(rates)}, indent=1).encode())
        return rates

    def _read(self) -> dict[str, Any]:
        with suppress(OSError, ValueError):
            content = json.loads(self._path.read_bytes())
            return content if isinstance(content, dict) else {}
        return {}


def rates_path() -> Path:
    """The file of this machine's rates in the user's cache."""
    return user_cache() / "rates.json"
