# make demo   set-up, then the main job on the built-in scene
# make test   set-up, then the whole test suite
# make docs   set-up, then the documentation as a site, outputs/site/index.html
# make setup  .venv with exact versions; seconds when nothing changed

.PHONY: demo test setup check docs

setup:
	@scripts/setup.sh

demo: setup
	@.venv/bin/sucre-bench run -m experiment=demo

test: setup
	@.venv/bin/python -m pytest -n auto

docs: setup
	@NO_MKDOCS_2_WARNING=1 .venv/bin/mkdocs build --quiet --strict
	@echo outputs/site/index.html

# What CI runs beside the tests: style, types, the layers of the house, and whether docs/cli.md is up to date.
check: setup
	@.venv/bin/ruff check .
	@.venv/bin/ruff format --check .
	@.venv/bin/mypy
	@.venv/bin/lint-imports
	@.venv/bin/python docs/site/cli_reference.py --check
