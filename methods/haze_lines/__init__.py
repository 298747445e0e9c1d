"""Underwater haze-lines (Berman, Levy, Avidan & Treibitz 2021, IEEE TPAMI 43(8))."""

from sucre_bench.methods.haze_lines.haze_lines import HazeLines

__all__ = ["HazeLines"]
