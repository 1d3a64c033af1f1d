# Every target makes .venv itself (tools/bootstrap.py); nothing is needed but make and Python 3.11 or newer.
# make PYTHON=/path/to/python3 ... chooses which one.

.DEFAULT_GOAL := help
.PHONY: help install demo test test-render test-simulation test-processes lint format bench gallery docs clean distclean

BIN := .venv/bin
# One test more at once than there are cores, up to four, since those with real nodes wait a lot; those of one file follow each other in one process.
# A process of tests that crashed is not started again: pytest-xdist may then wait for ever for what it was to run.
TOGETHER = -n $(shell $(BIN)/python -c 'import os; print(min(4, 1 + (os.cpu_count() or 1)))') --dist loadfile --no-loadscope-reorder --max-worker-restart=0
LINTERS = $(BIN)/ruff check --quiet && $(BIN)/ruff format --check --quiet && $(BIN)/mypy && $(BIN)/lint-imports --no-cache
LOOK_FOR := $(if $(PYTHON),$(PYTHON),python3 python3.11 python3.12 python3.13 python3.14)

# $(call ready,EXTRAS): empty when .venv holds them; otherwise make stops with the one line that says why.
# It runs while make expands the recipe, because a failing command would add make's own noise to that line.
ready = $(if $(findstring n,$(filter-out --%,$(firstword -$(MAKEFLAGS)))),,$(call check,$(shell \
  for python in $(LOOK_FOR); do \
    if "$$python" -c '' 2>/dev/null; then exec "$$python" tools/bootstrap.py --python "$(PYTHON)" --extras "$(1)"; fi; \
  done; \
  echo "cannot run $(or $(PYTHON),python3): install Python 3.11 or newer, or name one with: make PYTHON=/path/to/python3")))
check = $(if $(filter ready,$(firstword $(1))),,$(error $(or $(1),cannot make .venv: tools/bootstrap.py said nothing)))

help: ## this list
	@echo 'make demo    five nodes on this machine render the sample scene into demo-output/'
	@echo 'make test    lint, then all tests'
	@echo 'make test-render  the long forms of the tests of images, and Mitsuba through the kit'
	@echo 'make test-simulation  all tests in the simulated world and of its peers, also those that make test leaves out'
	@echo 'make test-processes  all tests with real processes, also those that make test leaves out'
	@echo 'make install .venv with scenectl in it'
	@echo 'make lint    ruff, mypy --strict, import-linter'
	@echo 'make format  let ruff arrange the code'
	@echo 'make bench   the measurements that docs/ quotes'
	@echo 'make gallery  the scenes of docs/gallery.md rendered; SCENES=folder of those that are not our own'
	@echo 'make docs    the documentation as pages, in site/'
	@echo 'make clean   remove what the above made, but not .venv (make distclean: also that)'

install:
	$(call ready,)@echo 'scenectl is installed: $(BIN)/scenectl --help'

demo:
	$(call ready,)$(BIN)/scenectl demo --output demo-output

# Tests start hundreds of processes, each of which would compile all modules again where the environment has Python keep nothing.
# While one core lints, another one compiles the kernels: else all tests that render would begin by compiling the same ones. They come late; those
# before them need not wait for it.
test: export PYTHONDONTWRITEBYTECODE =
test:
	$(call ready,dev)$(BIN)/python -m scenefold.render.warm & warm=$$!; { $(LINTERS); } || { kill $$warm; exit 1; }; \
	$(BIN)/python -m pytest --hypothesis-profile=ci $(TOGETHER); tested=$$?; wait $$warm && exit $$tested

# Minutes of furnaces, samplers and analytic scenes, and the renderer that needs an extra.
test-render: export PYTHONDONTWRITEBYTECODE =
test-render:
	$(call ready,dev mitsuba)$(BIN)/python -m pytest $(TOGETHER) -m 'long or not long' tests/render/test_at_length.py tests/render/test_kit.py tests/render/test_kit_mitsuba.py tests/render/test_furnace.py tests/render/test_example_renderer.py tests/render/test_losing_nodes.py tests/render/test_render_pools.py tests/render/test_mapped_lamps.py tests/unit/render/test_transmission_kernels.py

# Whole storms of each kind, of single parts too, and the crashes of all steps.
test-simulation: export PYTHONDONTWRITEBYTECODE =
test-simulation:
	$(call ready,dev)$(BIN)/python -m pytest $(TOGETHER) -m 'long or not long' tests/simulation tests/unit/peer

# `make test` has one of several that kill, bench or render with real processes; storms in the simulated world have all of it.
test-processes: export PYTHONDONTWRITEBYTECODE =
test-processes:
	$(call ready,dev)$(BIN)/python -m pytest $(TOGETHER) -m 'long or not long' tests/integration

lint:
	$(call ready,dev)$(LINTERS)

format:
	$(call ready,dev)$(BIN)/ruff check --fix --quiet
	$(BIN)/ruff format

bench:
	$(call ready,)$(BIN)/scenectl bench render

# The sheet and the page of the documentation; what is left out is said, and why.
SCENES := ../shared/scenes
gallery:
	$(call ready,)$(BIN)/python tools/gallery.py --scenes $(SCENES)

docs:
	$(call ready,docs)@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet
	@echo 'open site/index.html'

clean:
	rm -rf demo-output gallery-output site dist build .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
	@find . -path ./.venv -prune -o -path ./.git -prune -o -name __pycache__ -type d -exec rm -rf {} +

distclean: clean
	rm -rf .venv
