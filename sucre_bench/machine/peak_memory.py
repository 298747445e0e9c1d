"""Measures the peak memory of a piece of work."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np


class PeakMemory:
    """Measures a block's peak resident memory, in MB above that at its start, plus GPU memory if torch uses some.

    Linux records the peak and lets a process reset its own. On other systems the value is NaN.
    """

    _STATUS = Path("/proc/self/status")

    def __enter__(self) -> PeakMemory:
        self.peak_mb = math.nan
        try:
            Path("/proc/self/clear_refs").write_text("5")
            self._before = self._read("VmRSS")
        except OSError:
            self._before = math.nan
        if gpu := self._gpu():
            gpu.reset_peak_memory_stats()
        return self

    def __exit__(self, *_: object) -> None:
        if not math.isnan(self._before):
            self.peak_mb = max(0.0, self._read("VmHWM") - self._before)
        if gpu := self._gpu():
            self.peak_mb = float(np.nansum([self.peak_mb, gpu.max_memory_allocated() / 2**20]))

    def _read(self, name: str) -> float:
        line = next(line for line in self._STATUS.read_text().splitlines() if line.startswith(name))
        return int(line.split()[1]) / 1024

    @staticmethod
    def _gpu() -> Any:
        torch = sys.modules.get("torch")
        return torch.cuda if torch and torch.cuda.is_initialized() else None
