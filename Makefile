# make demo and make test need Python 3.11+, git and make; everything else is installed into .venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
BENCH_STAMP := $(VENV)/.bench-installed
BROWSER_STAMP := $(VENV)/.browser-installed
export MAVSENTRY_CACHE_DIR ?= $(abspath $(VENV))/kernels

.PHONY: install demo test test-external lint bench audit clean

install: $(STAMP)

$(STAMP): pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	touch $@

$(BENCH_STAMP): $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[bench]'
	-$(BIN)/python -m pip install --quiet --disable-pip-version-check mavparser scikit-build-core pybind11
	-$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-build-isolation fasttlogparser
	touch $@

$(BROWSER_STAMP): $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[browser]'
	touch $@

demo: $(STAMP)
	$(BIN)/mavsentry demo --out demo-out

lint: $(STAMP)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

test: $(STAMP) lint
	$(BIN)/pytest

# Tests that need a browser; SCREENS=DIR keeps pictures of the pages.
test-external: $(BROWSER_STAMP)
	tests/browser/install-chromium
	$(BIN)/pytest -m external $(if $(SCREENS),--screens $(SCREENS))

bench: $(BENCH_STAMP)
	$(BIN)/mavsentry bench --json bench.json

# Licences, wheels for 64-bit Arm and known vulnerabilities of what the daemon needs.
audit: $(STAMP)
	-$(BIN)/python -m pip install --quiet --disable-pip-version-check pip-audit
	$(BIN)/python -m tests.audit

clean:
	rm -rf $(VENV) build dist demo-out bench.json
