# What a fresh machine needs: Python 3.11 or 3.13, and make. Every target sets up what it uses.

# Asked instead of looked up: a version manager's stand-in for a Python that is not there can be found, but not run.
find_python = $(shell python$(1) -c "import sys; print(sys.executable)" 2>/dev/null)
# Blender's modules are built for these: 4.5 and 5.0 for the first, 5.2 for the second.
PYTHON311 ?= $(call find_python,3.11)
PYTHON313 ?= $(call find_python,3.13)
PYTHON ?= $(or $(PYTHON311),$(PYTHON313),python3)
VENV := .venv
# The add-on is tested on more Blenders than one; their modules exclude each other in one environment.
VENV_BPY45 := .venv-bpy45
VENV_BPY52 := .venv-bpy52
# Where the environment itself is for 3.13, it has 5.2.
VERSION := $(shell $(PYTHON) -c "import sys; print('%d.%d' % sys.version_info[:2])" 2>/dev/null)
OTHER_BLENDERS := $(and $(PYTHON311),$(VENV_BPY45)) $(and $(filter-out 3.13,$(VERSION)),$(PYTHON313),$(VENV_BPY52))
BIN := $(VENV)/bin
# "no" goes on where libraries of Blender's module are missing and nobody may install them (run.py --no-blend).
BLENDER ?= yes
DEMO_OUT ?= out/demo
BENCH_OUT ?= out/bench
WEIGHTS_OUT ?= out/weights

# A process for each core; the tests of a file stay together, because they share what was made for them.
SIDE_BY_SIDE := -n auto --dist loadfile

# Spinning OpenMP threads make everything ten times slower beside one busy neighbour.
export OMP_WAIT_POLICY = passive

.PHONY: venv demo test test-all lint bench weights licences clean

venv: $(VENV)/.ready

$(VENV)/.ready: pyproject.toml requirements.txt requirements-torch.txt requirements-dev.txt requirements-cuda.txt
	[ "$(BLENDER)" = no ] || sh scripts/system_libraries.sh
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python scripts/install_requirements.py requirements-dev.txt
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation -e .
	touch $@

$(VENV_BPY45)/.ready: THEIR_PYTHON = $(PYTHON311)
$(VENV_BPY52)/.ready: THEIR_PYTHON = $(PYTHON313)
.venv-%/.ready: requirements-%.txt
	sh scripts/system_libraries.sh
	$(THEIR_PYTHON) -m venv $(@D)
	$(@D)/bin/python -m pip install --quiet --require-hashes --no-deps -r $<
	touch $@

demo: venv
	$(BIN)/python scripts/run.py core/demo/showroom --iterations 3000 --out $(DEMO_OUT)

# The add-on's tests take minutes on each Blender. Where an older and a newer one are there, the environment's own, 5.0,
# is left to test-all.
OLDER_AND_NEWER := $(and $(findstring $(VENV_BPY45),$(OTHER_BLENDERS)),$(findstring $(VENV_BPY52),$(OTHER_BLENDERS)))
test: lint $(OTHER_BLENDERS:=/.ready)
	$(BIN)/python -m pytest $(SIDE_BY_SIDE) $(if $(OLDER_AND_NEWER),--ignore=tests/addon)
	set -e; for venv in $(OTHER_BLENDERS); do $$venv/bin/python -m pytest $(SIDE_BY_SIDE) tests/addon; done

test-all: venv $(OTHER_BLENDERS:=/.ready)
	$(BIN)/python -m pytest -m "slow or not slow"
	set -e; for venv in $(OTHER_BLENDERS); do $$venv/bin/python -m pytest tests/addon -m "slow or not slow"; done

# mypy wants the package under its own name, and a checkout may be called anything. Types are those of numpy 1, which
# Python 3.11 has; numpy 2 tells other ones.
PACKAGES := core cvdgs_addon operators ui scripts
lint: venv
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	mkdir -p .build && ln -sfn .. .build/cvdgs
	if $(BIN)/python -c "import sys; sys.exit(sys.version_info >= (3, 12))"; then \
	    MYPYPATH=.build $(BIN)/mypy $(PACKAGES:%=-p cvdgs.%); \
	else echo "Types are checked with Python 3.11."; fi

bench: venv
	$(BIN)/python scripts/benchmark.py step --out $(BENCH_OUT)
	$(BIN)/python scripts/benchmark.py trainer --out $(BENCH_OUT)

# From nothing to the shipped weights of --enhancer cgan; stopped, the same command goes on.
weights: venv
	nice $(BIN)/python scripts/train_enhancer.py $(WEIGHTS_OUT) --publish

licences: venv
	$(BIN)/python scripts/licences.py

# Of out/ what is made again in minutes: weights take hours to train, and the other runs there are the user's.
clean:
	rm -rf $(VENV) $(VENV_BPY45) $(VENV_BPY52) .build out/demo out/bench
