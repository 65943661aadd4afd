# What a fresh machine needs: Python 3.11 and make. Every target sets up what it uses.

PYTHON ?= $(shell command -v python3.11 || echo python3)
VENV := .venv
# The add-on is tested on both generations of Blender's API; the wheels exclude each other in one environment.
VENV_BPY45 := .venv-bpy45
BIN := $(VENV)/bin
# "no" goes on where libraries of Blender's module are missing and nobody may install them (run.py --no-blend).
BLENDER ?= yes
DEMO_OUT ?= out/demo
BENCH_OUT ?= out/bench

# A process for each core; the tests of a file stay together, because they share what was made for them.
SIDE_BY_SIDE := -n auto --dist loadfile

# Spinning OpenMP threads make everything ten times slower beside one busy neighbour.
export OMP_WAIT_POLICY = passive

.PHONY: venv demo test test-all lint bench licences clean

venv: $(VENV)/.ready

$(VENV)/.ready: pyproject.toml requirements.txt requirements-torch.txt requirements-dev.txt requirements-cuda.txt
	[ "$(BLENDER)" = no ] || sh scripts/system_libraries.sh
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python scripts/install_requirements.py requirements-dev.txt
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation -e .
	touch $@

$(VENV_BPY45)/.ready: requirements-bpy45.txt
	sh scripts/system_libraries.sh
	$(PYTHON) -m venv $(VENV_BPY45)
	$(VENV_BPY45)/bin/python -m pip install --quiet --require-hashes --no-deps -r requirements-bpy45.txt
	touch $@

demo: venv
	$(BIN)/python scripts/run.py core/demo/showroom --iterations 3000 --out $(DEMO_OUT)

test: lint $(VENV_BPY45)/.ready
	$(BIN)/python -m pytest $(SIDE_BY_SIDE)
	$(VENV_BPY45)/bin/python -m pytest $(SIDE_BY_SIDE) tests/addon

test-all: venv $(VENV_BPY45)/.ready
	$(BIN)/python -m pytest -m "slow or not slow"
	$(VENV_BPY45)/bin/python -m pytest tests/addon -m "slow or not slow"

# mypy wants the package under its own name, and a checkout may be called anything.
lint: venv
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	mkdir -p .build && ln -sfn .. .build/cvdgs
	MYPYPATH=.build $(BIN)/mypy -p cvdgs.core -p cvdgs.cvdgs_addon -p cvdgs.operators -p cvdgs.ui -p cvdgs.scripts

bench: venv
	$(BIN)/python scripts/benchmark.py step --out $(BENCH_OUT)
	$(BIN)/python scripts/benchmark.py trainer --out $(BENCH_OUT)

licences: venv
	$(BIN)/python scripts/licences.py

clean:
	rm -rf $(VENV) $(VENV_BPY45) .build out
