# make show    compile and verify shows/grid.yaml
# make test    the whole test suite
# make lint    linter, formatter, type checker, plain sentences
# make bench   the benchmark tables (each peer in an environment of its own)
# make fuzz    long campaign of hostile data and accidents; FUZZ="--cases 100 scripts"
# make docs    generate schemas, references and tables in the documentation
# make clean   remove what the above made

.DELETE_ON_ERROR:
.PHONY: show test lint bench fuzz docs clean setup

PYTHON ?= $(firstword $(foreach name,python3 python3.14 python3.13 python3.12 python3.11,$(shell $(name) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $(name))))
VENV := .venv
BIN := $(VENV)/bin
export OMP_NUM_THREADS := 1

show: $(VENV)/.installed
	$(BIN)/showc compile shows/grid.yaml
	$(BIN)/showc verify output.mcap

test: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -n auto --dist loadfile --durations=30

lint: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python tests/prose.py

bench: $(VENV)/.installed-dev
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[bench]'
	$(BIN)/python tests/benchmarks/run.py

fuzz: $(VENV)/.installed-dev
	$(BIN)/python tests/fuzz/run.py $(FUZZ)
	$(BIN)/python tests/fuzz/accidents.py

docs: $(VENV)/.installed-dev
	$(BIN)/python -m grpc_tools.protoc -Ischemas --python_out=showc/log --pyi_out=showc/log schemas/showc.proto
	$(BIN)/python tests/generate.py

setup: $(VENV)/.installed-dev
	$(BIN)/pre-commit install

clean:
	rm -rf $(VENV) build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis
	rm -rf output output.mcap
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(BIN)/python:
	@test -n "$(PYTHON)" || { echo "showc needs Python 3.11 or newer; install it, or name it: make PYTHON=/path/to/python3 $(MAKECMDGOALS)"; exit 2; }
	@$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); echo "$(PYTHON) cannot make a virtual environment; install its venv module (Debian, Ubuntu: apt install python3-venv)"; exit 2; }

$(VENV)/.installed: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	@touch $@

$(VENV)/.installed-dev: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev,cluster]'
	# A simulator to compare with, without what its other parts need (one of them is GPL).
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps 'rotorpy>=3,<4'
	@touch $@ $(VENV)/.installed
