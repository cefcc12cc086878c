# One command each; the first run of any installs what is missing (scripts/setup.sh), later runs start at once.
#
#   make demo     the whole system on this machine: http://localhost:8080
#   make test     every test
#   make fast     unit and property tests, but for the slow ones
#   make lint     ruff (rules and format) and pyright
#   make format   sort imports and format
#   make bench    the benchmarks
#   make clean    remove what was built and installed here

SHELL := /bin/bash
.DEFAULT_GOAL := help
.PHONY: help demo test fast lint format bench clean

PYTHON := .venv/bin/python
PYTEST := $(PYTHON) -m pytest
# Beside each other, which two cores bear: tests/conftest.py says what stays together, and what needs the machine alone
# (the flights before the browser, which draws on both cores until the end).
BESIDE := -n 5 --dist loadfile --no-loadscope-reorder
SETUP_FILES := pyproject.toml constraints.txt scripts/setup.sh
# More for one command: make demo ARGS="--headless --duration 120"
ARGS ?=

help:
	@sed -n 's/^#   //p' Makefile

# A stamp per level of set-up: they live in the environment, so removing it asks for set-up again.
.venv/.ready-%: $(SETUP_FILES)
	@scripts/setup.sh $*
	@touch $@
.PRECIOUS: .venv/.ready-%

demo: .venv/.ready-run
	@.venv/bin/outrider demo $(ARGS)

test: .venv/.ready-test
	$(PYTEST) $(BESIDE) -m "not alone and not in_pairs"
	$(PYTEST) -n 2 --dist loadfile tests/system -m in_pairs
	$(PYTEST) tests/system tests/browser -m alone

fast: .venv/.ready-dev
	$(PYTEST) $(BESIDE) tests/unit tests/property -m "not slow" $(ARGS)

lint: .venv/.ready-dev
	$(PYTHON) -m ruff check .
	$(PYTHON) -m ruff format --check .
	PYRIGHT_PYTHON_IGNORE_WARNINGS=1 $(PYTHON) -m pyright

format: .venv/.ready-dev
	$(PYTHON) -m ruff check --fix .
	$(PYTHON) -m ruff format .

bench: .venv/.ready-run
	@.venv/bin/outrider bench $(ARGS)

clean:
	rm -rf .venv build dist *.egg-info .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
