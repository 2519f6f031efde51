# Two commands do everything on a fresh machine with Python 3.11: make demo, make test.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1

.PHONY: demo test lint install bench docs clean

PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt

# What the demo needs, and what the tests need besides: the demo starts sooner without the latter.
$(VENV)/.demo: pyproject.toml constraints.txt
	@echo "Installing into $(VENV), some 1 GB; this takes a minute or more the first time."
	$(PYTHON) -m venv $(VENV)
	$(PIP) -e '.[demo,video]'
	touch $@

$(VENV)/.installed: $(VENV)/.demo
	@echo "Installing what the tests need, another 1 GB."
	$(PIP) -e '.[demo,video,test,docs]'
	touch $@

install: $(VENV)/.installed

demo: $(VENV)/.demo
	$(BIN)/physretarget demo --out out/demo

lint: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache

# The site of docs/, in out/site. (The theme advertises its successor unless told not to.)
docs: install
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict

test: lint docs
	$(BIN)/python -m pytest

bench: install
	$(BIN)/python -m benchmarks

clean:
	rm -rf $(VENV) out build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis
