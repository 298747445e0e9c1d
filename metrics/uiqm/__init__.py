"""UIQM, a quality measure without a reference: colourfulness (UICM), sharpness (UISM) and contrast (UIConM)."""

from sucre_bench.metrics.uiqm.uiqm import Uicm, Uiconm, Uiqm, Uism

__all__ = ["Uicm", "Uiconm", "Uiqm", "Uism"]
