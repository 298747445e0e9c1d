# make demo        set-up, then the main job on the built-in scene
# make test        set-up, then the whole test suite
# make test-short  set-up, then the tests marked `short`; with another Python: make test-short PYTHON=python3.13 VENV=.venv-3.13
# make fuzz        set-up, then 3,000 generated files for each reader, commands killed 20 times; SEED=7 repeats a campaign
# make docs        set-up, then the documentation as a site, outputs/site/index.html
# make setup       .venv with exact versions; seconds when nothing changed

VENV ?= .venv
bin = $(VENV)/bin

# PYTHONDONTWRITEBYTECODE would make each of the processes that the demo or the tests start compile all it imports.
kept = env -u PYTHONDONTWRITEBYTECODE
# A file's tests run in one process: what they share is made once.
pytest = $(kept) $(bin)/python -m pytest
in_parallel = -n auto --dist loadfile --no-loadscope-reorder

SEED ?= $(shell od -An -N4 -tu4 /dev/urandom)

.PHONY: demo test test-short fuzz setup check docs

setup:
	@VENV=$(VENV) scripts/setup.sh

demo: setup
	@$(kept) $(bin)/sucre-bench run -m experiment=demo

test: setup
	@$(pytest) $(in_parallel)

test-short: setup
	@$(pytest) $(in_parallel) -m short $$(grep -rl --include='*.py' 'pytest\.mark\.short' tests)

fuzz: setup
	@mkdir -p outputs/fuzz && echo "$(strip $(SEED))" >> outputs/fuzz/seeds.txt && echo "seed $(strip $(SEED))"
	@FUZZ_EXAMPLES=3000 FUZZ_KILLS=20 FUZZ_SEED=$(strip $(SEED)) $(pytest) \
		tests/hostile/test_readers.py tests/hostile/test_words.py tests/hostile/test_killed.py --hypothesis-seed=$(strip $(SEED))

docs: setup
	@$(bin)/python docs/site/show_at_work.py
	@NO_MKDOCS_2_WARNING=1 $(bin)/mkdocs build --strict
	@echo outputs/site/index.html

# What CI runs beside the tests: style, types, and which room imports which.
check: setup
	@$(bin)/ruff check .
	@$(bin)/ruff format --check .
	@$(bin)/mypy
	@$(bin)/lint-imports
	@$(bin)/python scripts/packed.py
