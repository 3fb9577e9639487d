PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin
UV := $(shell command -v uv 2>/dev/null)

# Where uv is at hand, the versions of requirements.lock with the CPU build of torch; else pip's choice.
ifdef UV
install = VIRTUAL_ENV=$(VENV) $(UV) pip install --quiet --torch-backend cpu \
	--constraint requirements.lock $(1) || $(BIN)/pip install --quiet $(1)
else
install = $(BIN)/pip install --quiet $(1)
endif
compile = $(UV) pip compile --quiet --universal --python-version 3.11 --no-header --no-annotate \
	--no-emit-index-url --extra dev --extra docs pyproject.toml --output-file $(1) > /dev/null \
	&& sed -i -E '/^(cuda|nvidia|triton|knotflow)\b/d' $(1)

# A stamp is older than pyproject.toml or the lock file when something is to be installed.
$(VENV)/.package: pyproject.toml requirements.lock
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --upgrade pip
	$(call install,-e .)
	touch $@

$(VENV)/.installed: $(VENV)/.package
	$(call install,-e ".[dev]")
	touch $@

$(VENV)/.docs: $(VENV)/.package
	$(call install,-e ".[docs]")
	touch $@

.PHONY: run test quick check coverage docs lock lock-check dist smoke smoke-all report stale benchmark

# Two workers with one thread each; the tests of a file share fixtures, so they stay on one worker.
# Compiled tests are kept, else every worker would compile all of them.
PYTEST = OMP_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

run: $(VENV)/.package  ## plan an overhand in a random rope, with the shipped primitives
	$(BIN)/knotflow plan overhand

test: $(VENV)/.installed check  ## format, types and all tests
	$(PYTEST)

quick: $(VENV)/.installed  ## the tests that are not marked slow
	$(PYTEST) -m "not slow"

check: $(VENV)/.installed  ## format, lint and types
	$(BIN)/ruff check src tests
	$(BIN)/ruff format --check src tests
	$(BIN)/mypy

coverage: $(VENV)/.installed  ## all tests, with the lines that none of them runs
	$(PYTEST) --cov --cov-report=term:skip-covered

docs: $(VENV)/.docs  ## the documentation site, in site/
	$(BIN)/mkdocs build --quiet --strict

lock:  ## requirements.lock from pyproject.toml (needs uv)
	$(call compile,requirements.lock)

lock-check:  ## fail where requirements.lock does not fit pyproject.toml (needs uv)
ifdef UV
	cp requirements.lock requirements.lock.check
	$(call compile,requirements.lock.check)
	cmp requirements.lock requirements.lock.check; code=$$?; rm requirements.lock.check; exit $$code
else
	@echo "lock-check: skipped, uv is not installed"
endif

dist: $(VENV)/.package  ## sdist and wheel; what the wheel holds plans a knot (needs uv)
	rm -rf dist build/wheel
	$(UV) build --quiet
	$(BIN)/python -m zipfile -e dist/*.whl build/wheel
	cd build/wheel && PYTHONPATH=. $(abspath $(BIN))/python -m knotflow.apps.cli plan overhand --worlds 0 --out plan
	cd build/wheel && PYTHONPATH=. $(abspath $(BIN))/python -m knotflow --cfg job > /dev/null

smoke: $(VENV)/.installed  ## one experiment with small counts, and its report
	$(BIN)/python -m knotflow +experiment=single_stage budget=smoke
	$(BIN)/python -m knotflow.report --results results/smoke --out reports/smoke

smoke-all: $(VENV)/.installed  ## all experiments with small counts, and the report
	$(BIN)/python -m knotflow +experiment=everything budget=smoke
	$(BIN)/python -m knotflow.report --results results/smoke --out reports/smoke

report: $(VENV)/.package  ## reports/ from results/ alone
	$(BIN)/python -m knotflow.report

stale: $(VENV)/.installed  ## committed results that today's code would not produce
	$(BIN)/knotflow report --check
	$(BIN)/knotflow report --check --results results/afternoon

benchmark: $(VENV)/.package
	$(BIN)/python -m knotflow +experiment=benchmark
