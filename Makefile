PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin

# Everything lives in $(VENV); the stamps say that it is up to date with pyproject.toml: the package
# for those who run it, and what its tests need besides.
$(VENV)/.package: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --upgrade pip
	$(BIN)/pip install --quiet -e .
	touch $@

$(VENV)/.installed: $(VENV)/.package
	$(BIN)/pip install --quiet -e ".[test]"
	touch $@

.PHONY: run test quick check smoke smoke-all report benchmark

# Two workers, a thread each; the tests of a file share its fixtures, and so stay on one worker.
PYTEST = OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

run: $(VENV)/.package  ## a plan for the overhand in a random rope, with the shipped primitives
	$(BIN)/knotflow plan overhand

smoke: $(VENV)/.installed  ## in small: demonstrations, training, baselines, evaluation, report
	$(BIN)/python -m knotflow +experiment=single_stage budget=smoke
	$(BIN)/python -m knotflow.report --results results/smoke --out reports/smoke

smoke-all: $(VENV)/.installed  ## every experiment in small, and the report
	$(BIN)/python -m knotflow +experiment=paper budget=smoke
	$(BIN)/python -m knotflow.report --results results/smoke --out reports/smoke

test: $(VENV)/.installed check  ## everything that must hold
	$(PYTEST)

quick: $(VENV)/.installed  ## the tests that are not marked slow: for the work in between
	$(PYTEST) -m "not slow"

check: $(VENV)/.installed
	$(BIN)/ruff check src tests
	$(BIN)/ruff format --check src tests
	$(BIN)/mypy

report: $(VENV)/.installed  ## reports/ reproduced from results/ alone
	$(BIN)/python -m knotflow.report

benchmark: $(VENV)/.installed
	$(BIN)/python -m knotflow +experiment=benchmark
