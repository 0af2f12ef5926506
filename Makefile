# Every target sets up what it needs, on a fresh Debian, Ubuntu or macOS machine with Python 3.11+ and a C compiler.

PYTHON := .venv/bin/python
CRUNCH := .venv/bin/crunch
WORKERS ?= auto
PORT ?= 8000
UPGRADE ?=
BENCH ?=

.DEFAULT_GOAL := help
.PHONY: help demo test check bench setup format lock config clean

help: ## This list
	@awk -F ':.*## ' '/^[a-z]+:.*## /{printf "  make %-8s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

demo: ## A virtual robot drives by itself, and its map grows in the browser
	@.ci/setup run
	$(CRUNCH) demo --autopilot --port $(PORT)

test: ## The whole suite; kernels once more with bounds checks, browsers one at a time: drivers have 300 ms
	@.ci/setup test
	NUMBA_BOUNDSCHECK=1 $(PYTHON) -m pytest -q -n $(WORKERS) tests/slam
	$(PYTHON) -m pytest -n $(WORKERS) --ignore tests/web
	$(PYTHON) -m pytest tests/web

check: ## Formatting, lint, types, and that the documents tell the truth
	@.ci/setup test
	.venv/bin/ruff format --check .
	.venv/bin/ruff check .
	.venv/bin/pyright
	$(PYTHON) docs/check.py

bench: ## A quick set of benchmarks; BENCH="cycle real" runs those in full, BENCH=firmware the firmware's; see `crunch bench --list`
	@.ci/setup test
	$(CRUNCH) bench --jobs 2 $(BENCH)

setup: ## Everything that the other targets need, tests included
	@.ci/setup test

format: ## Format the sources
	@.ci/setup test
	.venv/bin/ruff check --fix .
	.venv/bin/ruff format .

LOCK = $(PYTHON) -m uv pip compile --quiet --universal --generate-hashes --python-version 3.11 --no-header \
	--no-emit-index-url --no-emit-find-links --no-annotate $(UPGRADE) --extra build pyproject.toml

lock: ## Choose the versions of all dependencies again; UPGRADE=--upgrade takes the newest
	@.ci/setup test
	$(LOCK) -o requirements.lock
	$(LOCK) --extra dev -c requirements.lock -o requirements-dev.lock

config: ## Write config.toml again from the defaults in the code
	@.ci/setup run
	$(PYTHON) docs/make_config.py > config.toml

clean: ## Remove what was built here
	rm -rf .venv build dist *.egg-info .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
