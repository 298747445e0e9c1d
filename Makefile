# make demo   set-up, then the main job on the built-in scene
# make test   set-up, then the whole test suite
# make setup  .venv with exact versions; seconds when nothing changed

.PHONY: demo test setup check

setup:
	@scripts/setup.sh

demo: setup
	@.venv/bin/sucre-bench run -m experiment=demo

test: setup
	@.venv/bin/python -m pytest -n auto

# What CI runs beside the tests: style and types.
check: setup
	@.venv/bin/ruff check .
	@.venv/bin/ruff format --check .
	@.venv/bin/mypy
