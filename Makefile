# make demo and make test need Python 3.11+, git and make; everything else is installed into .venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
BENCH_STAMP := $(VENV)/.bench-installed
BROWSER_STAMP := $(VENV)/.browser-installed
PEERS_STAMP := $(VENV)/.peers-installed
# One process more than processors: tests of the daemon mostly wait for its clock.
PARALLEL := -n $(shell echo $$(($$(getconf _NPROCESSORS_ONLN) + 1))) --maxprocesses 9 --dist worksteal
export MAVSENTRY_CACHE_DIR ?= $(abspath $(VENV))/kernels

.PHONY: install demo docs test test-external lint kernels dist bench audit clean

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
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[browser,dist]'
	touch $@

# MAVProxy, MAVSDK and node-mavlink, apart from what the daemon uses.
$(PEERS_STAMP): tests/peers/install $(STAMP)
	tests/peers/install $(PYTHON) $(VENV)/peers
	touch $@

demo: $(STAMP)
	$(BIN)/mavsentry demo --out demo-out

lint: $(STAMP)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/mypy examples/*.py
	$(BIN)/lint-imports

# The documentation as a site, from nothing: docs/_build/html/index.html; a warning fails it.
docs: $(STAMP)
	rm -rf docs/_build
	$(BIN)/python -m sphinx -q -W --keep-going -j auto docs docs/_build/html

# The machine code of the kernels; where it is made already, this takes seconds.
kernels: $(STAMP)
	$(BIN)/mavsentry warmup

# The kernels are compiled once, beside lint and docs, before several processes would each do it.
test: $(STAMP)
	$(MAKE) --no-print-directory -j2 lint docs kernels
	$(BIN)/pytest $(PARALLEL)

# Tests that need a browser or programs of others; SCREENS=DIR keeps pictures of the pages. Where
# `make test` went before, the kernels are there.
test-external: $(BROWSER_STAMP) $(PEERS_STAMP) kernels
	tests/browser/install-chromium
	$(BIN)/pytest $(PARALLEL) --dist loadfile -m external $(if $(SCREENS),--screens $(SCREENS))

# Source distribution and wheel, in dist/.
dist: $(BROWSER_STAMP)
	$(BIN)/python -m build

bench: $(BENCH_STAMP)
	$(BIN)/mavsentry bench --json bench.json

# Licences, wheels for 64-bit Arm and known vulnerabilities of what the daemon needs.
audit: $(STAMP)
	-$(BIN)/python -m pip install --quiet --disable-pip-version-check pip-audit
	$(BIN)/python -m tests.audit

clean:
	rm -rf $(VENV) build dist demo-out bench.json docs/_build
