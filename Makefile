# `make` does everything; `make help` lists the rest.
PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/.installed
PIP := $(BIN)/python -m pip install --disable-pip-version-check
TORCH := torch==2.13.0
UV := $(shell sed -n '/^name = "uv"$$/{n;s/version = "\(.*\)"/uv==\1/p}' uv.lock)
CASES ?= 5000
KILLS ?= 60
# A file of tests goes to one process, so that what its tests share is made once.
SHARED := -n 2 --dist loadfile --no-loadscope-reorder
PYTEST := $(BIN)/python -m pytest $(SHARED)

# Installs an extra with all that it needs, in the versions of uv.lock, checked against its hashes; counts on one line.
define install
	@$(BIN)/uv export --quiet --frozen --no-emit-project --extra $(1) --output-file .venv/requirements.txt
	@all=$$(grep -c '^[^ #]' .venv/requirements.txt); n=0; \
		{ $(PIP) --require-hashes --no-deps --requirement .venv/requirements.txt || echo failed; } | \
		{ while read -r line; do case $$line in Collecting*|Processing*|Requirement*|Ignoring*) n=$$((n + 1)); \
		printf "\r$$n of $$all packages";; "Installing coll"*) printf ", unpacking";; failed) exit 1;; esac; done; echo; }
endef

.PHONY: all env run claims packet test test-fast fuzz chaos coverage smoke ui docs dist notebook lint format lock clean help
.DEFAULT_GOAL := all

all: run  ## install what is missing, then run the whole workflow on the embedded data

env: $(STAMP)  ## create .venv with the packages of uv.lock, checked against its hashes

$(STAMP): pyproject.toml uv.lock tools/system.py relight/core/libraries.py
	@$(PYTHON) -m tools.system
	@echo "installing the packages of uv.lock into .venv (some minutes the first time)"
	@$(PIP) --quiet $(UV)
	$(call install,dev)
	@$(PIP) $(TORCH)
	@$(PIP) --quiet --no-deps --no-build-isolation --editable .
	@touch $@

run: $(STAMP)  ## the workflow; make run ARGS="scale=smoke train.lr=1e-3"
	@$(BIN)/relight run $(ARGS)

test: $(STAMP)  ## the tests
	@$(PYTEST) $(ARGS)

test-fast: $(STAMP)  ## the tests without those that take CPU-seconds each
	@$(PYTEST) -m "not slow" $(ARGS)

claims: $(STAMP)  ## run the commands behind the numbers of the pages; all, or with a word: make claims ARGS=all
	@$(BIN)/python tools/claims.py $(ARGS)

packet: $(STAMP)  ## a finished run to give away, as an RO-Crate in build/; make packet ARGS=demo
	$(call install,packet)
	@$(BIN)/python tools/packet.py $(ARGS)

fuzz: $(STAMP)  ## feed the readers thousands of damaged files; make fuzz CASES=50000
	@RELIGHT_FUZZ=$(CASES) $(PYTEST) tests/reliability/test_readers.py $(ARGS)

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
	$(call install,docs)
	@rm -rf build/web
	@$(BIN)/relight web build build/web >/dev/null || echo "the site is built without its demo, the page that relights photos in the browser"
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict --config-file tools/mkdocs.yml
	@echo "the site is in build/site; to read it with its search: python3 -m http.server --bind 127.0.0.1 --directory build/site"

dist: $(STAMP)  ## the wheel and the source of a release, and its citation with the commit's SWHID, in dist/
	@$(BIN)/python -m hatchling build
	@{ cat CITATION.cff; printf 'identifiers:\n  - type: swh\n    value: "swh:1:rev:%s"\n' $$(git rev-parse HEAD); } > dist/CITATION.cff

lint: $(STAMP)  ## style of Python, Snakemake and JavaScript files, and types
	@$(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/snakefmt --check Snakefile workflow
	@$(BIN)/mypy
	@if command -v eslint > /dev/null; then cd relight/viewer/web && eslint .; fi

format: $(STAMP)  ## put Python and Snakemake files into style
	@$(BIN)/ruff check --fix . ; $(BIN)/ruff format . && $(BIN)/snakefmt Snakefile workflow

lock: $(STAMP)  ## write uv.lock anew from pyproject.toml
	@$(BIN)/uv lock --upgrade

notebook: $(STAMP)  ## run docs/first_hour.md, and write its outputs and pictures anew
	@$(BIN)/python tools/notebook.py

clean:  ## remove results and runs (not .venv)
	rm -rf results build .snakemake mlflow.db mlruns .mlflow.lock .coverage*

help:
	@awk -F':.*## ' '/^[a-z-]+:.*## /{printf "  make %-9s %s\n", $$1, $$2}' $(MAKEFILE_LIST)
