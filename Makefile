PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# One environment in two steps: what the library needs, then what its development needs.
CORE := $(VENV)/.core
DEV := $(VENV)/.dev
DOCS := $(VENV)/.docs

export PIP_DISABLE_PIP_VERSION_CHECK := 1
# commands that tests start would compile all modules anew
export PYTHONDONTWRITEBYTECODE :=

.PHONY: help venv demo test lint quick slow faults mutate fuzz bench site serve dist explorer clean
.DELETE_ON_ERROR:

help:
	@echo "make demo    derive the base parameters of a robot arm"
	@echo "make test    lint, types, layers and the quick tests"
	@echo "make quick   the quick tests alone"
	@echo "make slow    the tests that take long"
	@echo "make faults  signals at fifty random moments of every command, full disks"
	@echo "make mutate  plant small faults in the core, which the tests must notice"
	@echo "make fuzz    send mutated files of every format through the commands"
	@echo "make bench   compare speed and results with other tools"
	@echo "make site    build the documentation site with the zoo of public robots, in build/site"
	@echo "make serve   show the site at http://127.0.0.1:8000"
	@echo "make dist    build wheel and source distribution, and try both in fresh environments"
	@echo "make explorer  build the page that derives in the browser into build/site/explorer"
	@echo "make venv    only set up the development environment"
	@echo "make clean   remove the environment and everything generated"
	@echo "PYTHON=...   the interpreter to build the environment with (3.11 or later)"

$(CORE): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Echelon needs Python 3.11 or later: make PYTHON=python3.11 ...")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --editable .
	@touch $@

$(DEV): $(CORE)
	$(BIN)/python -m pip install --quiet --editable ".[dev]"
	@touch $@

venv: $(DEV)

demo: $(CORE)
	$(BIN)/echelon derive examples/panda.yaml

lint: $(DEV)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo

# as many processes as cores run tests, and each of them does linear algebra
quick slow faults: export OPENBLAS_NUM_THREADS := 1
# compilers that tests start know nothing of make's other jobs
quick: $(DEV)
	env -u MAKEFLAGS -u MFLAGS $(BIN)/pytest -n auto --dist worksteal -m "not slow"

# types are checked by one process, beside the tests
test: $(DEV)
	@$(MAKE) --no-print-directory -j 2 lint quick

slow: $(DEV) $(DOCS)
	$(BIN)/pytest -n auto -m "slow or hypothesis" --hypothesis-profile thorough

faults: $(DEV)
	$(BIN)/pytest -n auto tests/cli/test_faults.py

# EXPLORER="--wheels DIR" names a folder with NumPy for Pyodide; otherwise its release is fetched, or NumPy is built
explorer: $(CORE)
	$(BIN)/python site/build_explorer.py build/site/explorer $(EXPLORER)

# MUTATE="--only exact/ --jobs 4" chooses faults and how many run at the same time
mutate: $(DEV)
	cd tests && ../$(BIN)/python -m mutation $(MUTATE)

# FUZZ="--only bag --cases 100" chooses formats and how many files
fuzz: $(DEV)
	cd tests && ../$(BIN)/python -m fuzz $(FUZZ)

bench: $(DEV)
	$(BIN)/python benchmarks/bench.py

$(DOCS): $(CORE)
	$(BIN)/python -m pip install --quiet --editable ".[docs]"
	@touch $@

# SITE="--only-pages" leaves zoo and explorer out; SITE="--zoo 'ur*'" takes a part of the zoo
site: $(DOCS)
	$(BIN)/python site/build.py $(SITE)

serve:
	$(BIN)/python -m http.server --directory build/site --bind 127.0.0.1 8000

dist: $(CORE)
	rm -rf dist
	$(BIN)/python -m pip install --quiet "build>=1.2"
	$(BIN)/python -m build --outdir dist
	$(PYTHON) packaging/smoke.py dist/*

clean:
	rm -rf $(VENV) build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
	find src tests -name __pycache__ -type d -prune -exec rm -rf {} +
