"""Surveys aligned in Agisoft Metashape or PhotoScan (1.3 on), from its export or its project."""

from sucre_bench.datasets.metashape.metashape import Metashape

__all__ = ["Metashape"]
