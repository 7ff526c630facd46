# make demo: the whole way from mesh to report, on a fresh Debian 12 or 13.   make test: the test suite.
# Both install first what is missing, and both are quick when all is there.

SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help
.PHONY: help install demo test lint

PYTHON := .venv/bin/python
SOFTPRINT := .venv/bin/softprint
RANKS ?= 2
EXPERIMENT ?= examples/jelly3d_small.toml
OUT ?= runs/$(basename $(notdir $(EXPERIMENT)))
# Further options for every verb of the demo, such as: make demo OPTIONS="--set sampling.places=8"
OPTIONS ?=
VERB_OPTIONS = $(EXPERIMENT) --out $(OUT) $(OPTIONS)
MODELS := full bare thesis5 mechanics ours

# One thread for each rank, and one for steps of simulations: small matrices gain nothing from more. Training does.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1
# Open MPI refuses to run as root, as in a container, unless it is told twice that this is meant.
MPIRUN := $(if $(filter 0,$(shell id -u)),OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1) mpirun --oversubscribe

help:
	@echo "make demo      mesh, truth on $(RANKS) ranks, training, simulation and report of $(EXPERIMENT)"
	@echo "make test      the test suite"
	@echo "make lint      ruff and mypy"
	@echo "make install   Debian packages and .venv; the others do this by themselves"

install:
	@tools/install.sh

# Every verb keeps what an earlier run finished, so a demo that was killed goes on where it was.
demo: install
	$(SOFTPRINT) body $(VERB_OPTIONS)
	$(MPIRUN) -n $(RANKS) $(SOFTPRINT) generate $(VERB_OPTIONS)
	OMP_NUM_THREADS=$(shell nproc) $(SOFTPRINT) train $(VERB_OPTIONS)
	$(SOFTPRINT) simulate $(VERB_OPTIONS) $(foreach model,$(MODELS),--model $(model))
	$(SOFTPRINT) report $(VERB_OPTIONS)

# Two at a time: each worker has a cache of compiled forms of its own, see tests/conftest.py.
test: install
	$(PYTHON) -m pytest -n 2 --dist loadfile

lint: install
	$(PYTHON) -m ruff check .
	$(PYTHON) -m mypy
