PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin

# Everything lives in $(VENV); the stamp says that it is up to date with pyproject.toml.
$(VENV)/.installed: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --upgrade pip
	$(BIN)/pip install --quiet -e ".[test]"
	touch $@

.PHONY: run test check smoke report benchmark

run: $(VENV)/.installed  ## a plan for the overhand in a random rope, with the shipped primitives
	$(BIN)/python -m knotflow +experiment=overhand

smoke: $(VENV)/.installed  ## in small: demonstrations, training, baselines, evaluation, report
	$(BIN)/python -m knotflow +experiment=single_stage budget=smoke
	$(BIN)/python -m knotflow.report --results results/smoke --out reports/smoke

test: $(VENV)/.installed check  ## everything that must hold
	$(BIN)/python -m pytest

check: $(VENV)/.installed
	$(BIN)/ruff check src tests
	$(BIN)/ruff format --check src tests
	$(BIN)/mypy

report: $(VENV)/.installed  ## reports/ again from results/ alone
	$(BIN)/python -m knotflow.report

benchmark: $(VENV)/.installed
	$(BIN)/python -m knotflow +experiment=benchmark
