# Two targets do everything on a fresh machine with Python 3.11, pip, make and gcc:
#   make dry-run   set up, then six emulated presses, their replay and the report
#   make test      set up, then the tests but the slow ones
PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV ?= .venv
BIN := $(VENV)/bin
PYTHON312 ?= python3.12
ISAACLAB ?= .venv-isaaclab
# One thread for each numerical library: two cores carry eight processes during a run.
export OMP_NUM_THREADS ?= 1
export MKL_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1
# Hundreds of processes start in the tests: each would compile all sources anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: dry-run test test-slow check lint types contracts dependencies docs words architecture format newton isaaclab clean

dry-run: $(VENV)/.product
	$(BIN)/tacauchy-rig dry-run

# A third worker would starve what a dry run does at low priority.
test: $(VENV)/.tools
	$(BIN)/python -m pytest -n 2 --dist worksteal --durations=50 -m "not slow"

test-slow: $(VENV)/.tools
	$(BIN)/python -m pytest -n 2 --dist worksteal --durations=20 -m "slow"

check: lint types contracts dependencies

lint: $(VENV)/.tools
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.tools
	$(BIN)/mypy

contracts: $(VENV)/.tools
	$(BIN)/lint-imports

dependencies: $(VENV)/.tools
	$(BIN)/deptry .

# Balls that come to rest on gels in newton; prints wrench over weight.
newton: $(BIN)/python
	$(INSTALL) ".[newton]"
	$(BIN)/python -m tacauchy_rig.envs.newton

# Isaac Lab has an environment of its own (docs/how-to/use-isaac-lab.md): Python 3.12, 8 GB.
isaaclab: $(ISAACLAB)/.ready
	$(ISAACLAB)/bin/python docs/envs/isaaclab_ball.py 4
	$(ISAACLAB)/bin/python docs/envs/isaaclab_ball.py 60

$(ISAACLAB)/.ready: pyproject.toml
	$(PYTHON312) -m venv $(ISAACLAB)
	$(ISAACLAB)/bin/python -m pip install --quiet --disable-pip-version-check --no-compile \
		-e . isaaclab==3.0.0
	touch $@

# Into site/, without network; every warning is an error. site/index.html opens from disk.
docs: $(VENV)/.tools
	NO_COLOR=1 PYTHONPATH=. $(BIN)/python -m zensical build --clean --strict

words: $(VENV)/.tools
	$(BIN)/python -m tests.documentation.words

architecture: $(VENV)/.tools
	$(BIN)/python -m tests.architecture

format: $(VENV)/.tools
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# Without --no-compile pip compiles every package for half a minute; most modules are never imported.
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile \
	-c constraints.txt -e

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.product: pyproject.toml constraints.txt | $(BIN)/python
	$(INSTALL) .
	touch $@

$(VENV)/.tools: pyproject.toml constraints.txt | $(BIN)/python
	$(INSTALL) ".[dev]"
	touch $(VENV)/.product $@

clean:
	rm -rf $(VENV) $(ISAACLAB) site .cache .mypy_cache .ruff_cache .pytest_cache .hypothesis
