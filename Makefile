# Thin words over the tools. Nothing is needed beforehand but Python >= 3.11 and make.
# The first interpreter that runs and is new enough; a version manager's shim may be there and not run.
PYTHON ?= $(shell for p in python3 python3.13 python3.12 python3.11 python; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; done)
VENV ?= .venv
BIN = $(VENV)/bin
STAMP = $(VENV)/.installed
DEVELOP = $(VENV)/.installed-dev

.DEFAULT_GOAL := help
.PHONY: help install demo test stress check format bench openapi clean

help: ## List these targets
	@grep -E '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

install: $(DEVELOP) ## Make the virtual environment with pinned packages

$(STAMP): pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "Adret needs Python 3.11 or newer; say where: make PYTHON=/path/to/python3.12"; exit 1; }
	@echo "Installing into $(VENV) ..."
	@$(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[service]"
	@touch $(STAMP)

$(DEVELOP): $(STAMP)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[service,dev]"
	@touch $(DEVELOP)

demo: $(STAMP) ## Light the Aletsch region: horizons, sky view, shadow, a lit picture
	@$(BIN)/python examples/demo.py

test: $(DEVELOP) ## Run the tests (library, command line, service through a real server)
	$(BIN)/python -m pytest -q -n auto --maxprocesses 4 --dist loadfile

stress: $(DEVELOP) ## Run the slow checks
	$(BIN)/python -m pytest -q -m slow

check: $(DEVELOP) ## Lint, types, import directions
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(DEVELOP) ## Format and fix what can be fixed
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

bench: $(STAMP) ## Measure run time against error, with peers; writes benchmarks/results
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[service,dev,bench]"
	$(BIN)/python benchmarks/horizon.py
	$(BIN)/python benchmarks/skips.py
	$(BIN)/python benchmarks/products.py
	$(BIN)/python benchmarks/sky.py
	$(BIN)/python benchmarks/threads.py
	$(BIN)/python benchmarks/visibility.py
	$(BIN)/python benchmarks/viewsheds.py
	$(BIN)/python benchmarks/bounces.py
	$(BIN)/python benchmarks/ssao.py

openapi: $(STAMP) ## Regenerate openapi/
	$(BIN)/python -m adret_service.openapi

clean: ## Remove the virtual environment and what the demo wrote
	rm -rf $(VENV) demo-output
