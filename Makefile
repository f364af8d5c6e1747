# `make` does everything; `make help` lists the rest.
PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/.installed
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
CASES ?= 5000
KILLS ?= 60
# A file of tests goes to one process, so that what its tests share is made once.
SHARED := -n 2 --dist loadfile --no-loadscope-reorder
PYTEST := $(BIN)/python -m pytest $(SHARED)

.PHONY: all env run test test-fast fuzz chaos coverage smoke ui docs notebook settings lint format lock licences sbom audit clean help
.DEFAULT_GOAL := all

all: run  ## install what is missing, then run the whole workflow on the embedded data

env: $(STAMP)  ## create .venv with the packages of requirements.txt, checked against its hashes

# Two `make` at once: the second waits, and finds that all is installed.
$(STAMP): pyproject.toml requirements.txt constraints.txt workflow/scripts/system.py
ifndef INSTALLING
	@$(PYTHON) workflow/scripts/alone.py requirements.txt $(MAKE) --no-print-directory INSTALLING=1 $@
else
	@$(PYTHON) workflow/scripts/system.py
	@test -x $(BIN)/python || { rm -rf .venv; $(PYTHON) -m venv .venv; }
	@echo "installing the packages of requirements.txt into .venv (some minutes the first time)"
	@$(PIP) --require-hashes --no-deps --requirement requirements.txt
	@$(PIP) --constraint constraints.txt torch
	@$(PIP) --no-deps --no-build-isolation --editable .
	@touch $@
endif

run: $(STAMP)  ## the workflow; make run ARGS="scale=smoke train.lr=1e-3"
	@$(BIN)/relight run $(ARGS)

test: $(STAMP)  ## the tests
	@$(PYTEST) $(ARGS)

test-fast: $(STAMP)  ## the tests without those that take CPU-seconds each
	@$(PYTEST) -m "not slow" $(ARGS)

fuzz: $(STAMP)  ## feed the readers 5,000 damaged panoramas, meshes and other files each; make fuzz CASES=50000
	@RELIGHT_FUZZ=$(CASES) $(PYTEST) tests/panoramas/test_panoramas_fuzz.py tests/meshes/test_meshes_malformed.py \
		tests/reliability/test_reliability_readers.py $(ARGS)

chaos: $(STAMP)  ## kill the workflow 60 times at random moments; make chaos KILLS=6
	@RELIGHT_CHAOS=$(KILLS) $(BIN)/python -m pytest -s tests/workflow/test_resume.py $(ARGS)

coverage: $(STAMP)  ## which lines the tests run, file by file
	@$(BIN)/python -m coverage erase
	@COVERAGE_FILE="$(CURDIR)/.coverage" $(BIN)/python -m coverage run -m pytest $(SHARED) $(ARGS)
	@$(BIN)/python -m coverage combine --quiet && $(BIN)/python -m coverage report --sort=cover

smoke: $(STAMP)  ## the whole workflow at the smallest scale
	@$(BIN)/relight run scale=smoke $(ARGS)

ui: $(STAMP)  ## browse the runs in MLflow on this machine
	@$(BIN)/relight ui

docs: $(STAMP)  ## the site of docs/, in build/site; after `relight web setup` with its demo
	@$(PIP) --constraint constraints.txt --no-build-isolation --editable '.[docs]'
	@rm -rf build/web
	@$(BIN)/relight web build build/web >/dev/null || echo "the site is built without its demo, the page that relights photos in the browser"
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict
	@echo "the site is in build/site; to read it with its search: python3 -m http.server --bind 127.0.0.1 --directory build/site"

lint: $(STAMP)  ## style of Python and Snakemake files, and types
	@$(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/snakefmt --check Snakefile workflow
	@$(BIN)/mypy

format: $(STAMP)  ## put Python and Snakemake files into style
	@$(BIN)/ruff check --fix . ; $(BIN)/ruff format . && $(BIN)/snakefmt Snakefile workflow

lock: $(STAMP)  ## write requirements.txt and constraints.txt anew from pyproject.toml
	@$(BIN)/python workflow/scripts/lock.py

notebook: $(STAMP)  ## run docs/first_hour.md, and write its outputs and pictures anew
	@$(BIN)/python workflow/scripts/notebook.py

settings: $(STAMP)  ## write docs/settings.md anew from the schema and conf/
	@$(BIN)/python workflow/scripts/settings.py

licences: $(STAMP)  ## write docs/licences.md anew from what is installed
	@$(BIN)/python workflow/scripts/licences.py

sbom: $(STAMP)  ## list what is installed as CycloneDX, in sbom.json; fetches the tool
	@$(BIN)/uvx --from cyclonedx-bom==7.5.0 cyclonedx-py environment $(BIN)/python --output-reproducible -o sbom.json

audit: $(STAMP)  ## look for known vulnerabilities in the locked versions; fetches the tool, asks a database on the network
	@$(BIN)/uvx pip-audit==2.10.1 --requirement requirements.txt --require-hashes --disable-pip

clean:  ## remove results and runs (not .venv)
	rm -rf results build .snakemake mlflow.db mlruns .mlflow.lock .coverage* sbom.json

help:
	@awk -F':.*## ' '/^[a-z-]+:.*## /{printf "  make %-9s %s\n", $$1, $$2}' $(MAKEFILE_LIST)
