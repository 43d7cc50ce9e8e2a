# Every target sets up what it needs: a virtual environment, the dependencies, and for the browser tests Chromium.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
DEV_READY := $(VENV)/.ready-dev
# Four workers for two cores, as tests of pages mostly wait; tests of one file share their fixtures, and run in the
# order of tests/conftest.py.
WORKERS ?= 4
IN_WORKERS = -n $(WORKERS) --dist loadfile --no-loadscope-reorder
# What is imported, and rewritten by pytest, is kept from run to run, also where the environment forbids it.
test test-fast: export PYTHONDONTWRITEBYTECODE :=
# Workers share the processors already: threads of linear algebra would only wait for one another, busily.
test test-fast: export OPENBLAS_NUM_THREADS := 1

.PHONY: demo demo-live test test-fast check format bench paper recordings screenshots docs dist test-pythons clean chromium

demo: $(READY)
	@$(BIN)/simaps demo

# A robot that is not there plays the café; the map grows in the browser. Ctrl-C ends both.
demo-live: $(READY)
	@$(BIN)/python apps/fake_robot.py & robot=$$!; trap "kill $$robot" EXIT; \
		$(BIN)/simaps live foxglove://127.0.0.1:8765 -o demo-live.npz --view

test: $(DEV_READY) chromium
	@$(BIN)/python -m pytest $(IN_WORKERS)

# For every few minutes: no browser, no processes.
test-fast: $(DEV_READY)
	@$(BIN)/python -m pytest $(IN_WORKERS) -m "not browser and not slow" $(addprefix --ignore=tests/,browser docs process)

check: $(DEV_READY)
	@$(BIN)/ruff check --no-cache .
	@$(BIN)/ruff format --check .
	@$(BIN)/lint-imports --no-cache
	@$(BIN)/pyright

format: $(DEV_READY)
	@$(BIN)/ruff check --fix .
	@$(BIN)/ruff format .

bench: $(DEV_READY)
	@$(BIN)/python apps/bench.py

# The paper's experiment on all embedded places: renders them once, builds, drives, and renews docs/PAPER.md.
paper: $(READY)
	@$(BIN)/python apps/paper.py --write

recordings: $(READY)
	@$(BIN)/python apps/record_build.py --output recordings/cafe-evidence.rrd

screenshots: $(DEV_READY) chromium
	@$(BIN)/python apps/screenshots.py --output assets

docs: $(DEV_READY)
	@$(BIN)/python apps/reference.py
	@$(BIN)/python apps/method_figures.py assets

# The wheel is built from the source archive, so that the archive is known to be complete.
dist: $(DEV_READY)
	@rm -rf dist
	@$(BIN)/python -m build --no-isolation --outdir dist .

# The wheel on other Pythons, in environments of their own; all tests but the browser's, or those named:
# make test-pythons PYTHONS="python3.12 python3.13" TESTS=tests/cli/test_cli.py
PYTHONS ?= python3.12 python3.13
TESTS ?= tests
test-pythons: dist
	@for python in $(PYTHONS); do \
		env=build/env-$$($$python -c 'import sys; print("%d.%d" % sys.version_info[:2])') && echo "$$env" && \
		$$python -m venv $$env && $$env/bin/python -m pip install --quiet --disable-pip-version-check \
			"$$(ls dist/*.whl)[dev]" && $$env/bin/pytest -m "not browser" $(IN_WORKERS) $(TESTS) || exit 1; \
	done

clean:
	rm -rf $(VENV) build dist .pytest_cache .ruff_cache .hypothesis

# What is imported is compiled then: pip would compile all there is first.
define install
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(0 if (3, 11) <= v < (3, 14) else \
		f"make: expected Python 3.11 to 3.13, found {v.major}.{v.minor}; try make PYTHON=python3.11")'
	@echo "Setting up $(VENV) (once; a few minutes on a slow line)"
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --progress-bar on --no-compile -e '.$(1)'
endef

$(READY): pyproject.toml
	$(call install,)
	@touch $@

# With what tests and checks need; at once, as finding out what fits together takes long.
$(DEV_READY): pyproject.toml
	$(call install,[dev])
	@touch $(READY) $@

# The browser tests drive Debian's Chromium.
chromium:
	@test -x /usr/bin/chromium || { \
		echo "Installing chromium (apt)"; \
		if [ "$$(id -u)" = 0 ]; then SUDO=; else SUDO=sudo; fi; \
		$$SUDO apt-get update -qq && $$SUDO apt-get install -y -qq --no-install-recommends chromium >/dev/null; }
