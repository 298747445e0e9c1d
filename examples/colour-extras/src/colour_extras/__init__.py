"""Plugins for sucre_bench: a method, a metric and a dataset."""
