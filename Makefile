# `make` does everything; `make help` lists the rest.
PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/.installed
CASES ?= 5000

.PHONY: all env run report test fuzz smoke ui docs lint format lock clean help
.DEFAULT_GOAL := all

all: run  ## install what is missing, then run the whole workflow on the embedded data

env: $(STAMP)  ## create .venv with the versions of constraints.txt

$(STAMP): pyproject.toml constraints.txt workflow/scripts/system.py
	@$(PYTHON) workflow/scripts/system.py
	@test -x $(BIN)/python || { rm -rf .venv; $(PYTHON) -m venv .venv; }
	@echo "installing the packages of constraints.txt into .venv (some minutes the first time)"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	@touch $@

run: $(STAMP)  ## the workflow; make run ARGS="scale=smoke train.lr=1e-3"
	@$(BIN)/relight run $(ARGS)

test: $(STAMP)  ## the tests
	@$(BIN)/python -m pytest -n 2 $(ARGS)

fuzz: $(STAMP)  ## feed the readers 5,000 damaged panoramas and meshes; make fuzz CASES=50000
	@RELIGHT_FUZZ=$(CASES) $(BIN)/python -m pytest -n 2 tests/panoramas/test_panoramas_fuzz.py \
		tests/meshes/test_meshes_malformed.py $(ARGS)

smoke: $(STAMP)  ## the whole workflow at the smallest scale
	@$(BIN)/relight run scale=smoke $(ARGS)

ui: $(STAMP)  ## browse the runs in MLflow on this machine
	@$(BIN)/relight ui

docs: $(STAMP)  ## the site of docs/, in results/site
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev,docs]'
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict
	@echo "the site is in results/site; to read it with its search: python3 -m http.server --bind 127.0.0.1 --directory results/site"

lint: $(STAMP)  ## style of Python and Snakemake files
	@$(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/snakefmt --check workflow

format: $(STAMP)  ## put Python and Snakemake files into style
	@$(BIN)/ruff check --fix . ; $(BIN)/ruff format . && $(BIN)/snakefmt workflow

lock: $(STAMP)  ## write constraints.txt anew from pyproject.toml, and environment.yml with it
	@$(BIN)/python workflow/scripts/lock.py

clean:  ## remove results and runs (not .venv)
	rm -rf results .snakemake mlflow.db mlruns .mlflow.lock

help:
	@awk -F':.*## ' '/^[a-z]+:.*## /{printf "  make %-8s %s\n", $$1, $$2}' $(MAKEFILE_LIST)
