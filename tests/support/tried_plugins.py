"""Plugins made of a few lines, and what of the contract they break."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sucre_bench import plugins
from sucre_bench.plugins.registry import load_file
from sucre_bench.programs.contract.contract import Subject, check
from support.colmap_folder import write_dive

HEAD = """
import os, random, warnings
from dataclasses import dataclass
from pathlib import Path
import numpy as np
from sucre_bench import (Arrays, Camera, InputError, NotApplicableError, Restoration, Scene, Score, SolveError, View,
                         Water, dataset, method, metric)
"""
METHOD = """
@method(needs={needs}, cites="Nobody 2026")
@dataclass(frozen=True)
class Tried:
    '''A method that is tried.'''

    gain: float = 1.0
    '''A factor.'''

    def restore(self, scene: Scene, view: View) -> Restoration:
        {body}
"""
DATASET = """
@dataset(has={has}, source="nowhere")
@dataclass(frozen=True)
class Tried:
    '''A dataset that is tried.'''

    root: Path
    '''A folder.'''

    def scenes(self):
        if not (self.root / "sparse").is_dir():
            raise InputError(f"{{self.root}}: holds no scene; give another")
        rng = np.random.default_rng(0)
        rgb, depth = rng.random((6, 8, 3), dtype=np.float32), np.full((6, 8), 2, np.float32)
        K, pose, name, data_id = np.array([[8, 0, 4], [0, 8, 3], [0, 0, 1.0]]), np.eye(4), "a.png", "1"
        {body}
        views = [View(name, Arrays(rgb, depth), Camera(K, 8, 6), pose)]
        yield Scene("one", views, frozenset({{"depth", "poses"}}), data_id=data_id)
"""
METRIC = """
@metric(needs={needs}, variants={{"all": "of everything"}}, unit="", better="{better}", range=(0, 1))
@dataclass(frozen=True)
class Tried:
    '''A metric that is tried.'''

    def score(self, restored: Restoration, shown: np.ndarray, view: View, variant: str):
        seen = np.isfinite(shown).all(axis=-1)
        value = float(np.abs(shown - view.reference)[seen].mean()) if seen.any() else np.nan
        n, coverage = int(seen.sum()), float(seen.mean())
        {body}
        yield Score(value, n_pixels=n, coverage=coverage)
"""


def indented(body: str) -> str:
    return "\n        ".join(body.splitlines())


def write(folder: Path, template: str, body: str, **filled: Any) -> Path:
    path = folder / "tried.py"
    path.write_text(HEAD + template.format(body=indented(body), **filled))
    return path


def broken(folder: Path, kind: plugins.Kind, template: str, body: str, **filled: Any) -> dict[str, str]:
    """The breaches by the name of their rule, a line each; why a rule could not be checked."""
    load_file(write(folder, template, body, **filled))
    subject = Subject(plugins.find(kind, "tried"), {"root": write_dive(folder)} if kind == "dataset" else {})
    said: dict[str, str] = {}
    for one in check(subject, lasting=False):
        lines = [text for level, text in one.findings if level == "breach"] + [one.skipped] * bool(one.skipped)
        said |= {one.name: "\n".join(lines)} if lines else {}
    return said


GOOD = "image = view.rgb * np.float32(self.gain)\n"
FADED = "if not view.valid.any():\n    raise NotApplicableError(f'{view.name}: no pixel has depth')\n"
HOLES = "image = np.where(view.valid[..., None], view.rgb * np.exp(0.5 * view.depth)[..., None], np.nan)\n"
JUDGED = "{'reference'}"
