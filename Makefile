# make demo: the whole way from mesh to report, on a fresh Debian 12 or 13.   make test: the test suite.
# make docs: the documentation.   make figures: the numbers of the documentation, in hours.   All install first what is missing, and are quick when all is there.

SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help
.PHONY: help install docs-tools demo test lint docs figures

PYTHON := .venv/bin/python
SOFTPRINT := .venv/bin/softprint
RANKS ?= 2
EXPERIMENT ?= examples/jelly3d_small.toml
OUT ?= runs/$(basename $(notdir $(EXPERIMENT)))
# Options of the demo, such as: make demo OPTIONS="--set sampling.places=8"
OPTIONS ?=
# Of `make figures`: names (see tools/figures.py --list), all where none is given.
FIGURES ?=

# One thread: small matrices do not gain from more. The demo chooses for each of its steps: training has all cores.
test figures: export OMP_NUM_THREADS ?= 1
test figures: export OPENBLAS_NUM_THREADS ?= 1

help:
	@echo "make demo      mesh, truth on $(RANKS) ranks, training, simulation and report of $(EXPERIMENT)"
	@echo "make test      the test suite"
	@echo "make lint      ruff and mypy"
	@echo "make docs      the documentation as a site in site/, with no link to fetch anything from the network"
	@echo "make figures   every number and picture of README.md and the pages of results, hours; a stopped run continues"
	@echo "make install   Debian packages and .venv; the others do this by themselves"

install:
	@tools/install.sh

# What builds the documentation has an environment of its own.
docs-tools:
	@tools/install.sh --docs

# All steps; finished results of an earlier run are kept, so an interrupted demo continues where it stopped.
demo: install
	$(SOFTPRINT) run $(EXPERIMENT) --out $(OUT) --ranks $(RANKS) $(OPTIONS)

# Two workers.
test:
	@tools/install.sh --for-tests
	$(PYTHON) -m pytest -n 2 --dist loadfile --no-loadscope-reorder

lint: install
	$(PYTHON) -m ruff check .
	$(PYTHON) -m mypy

# --strict: broken links between pages, and pages in no menu, fail the build.
docs: docs-tools
	NO_MKDOCS_2_WARNING=1 .venv.docs/bin/python -m mkdocs build --strict --quiet
	@echo "Open site/index.html"

# Each into runs/figures/NAME.txt; what is there and newer than its inputs is skipped.
figures: install
	$(PYTHON) -m tools.figures --ranks $(RANKS) $(FIGURES)
