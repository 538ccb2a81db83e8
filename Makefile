# Everything on a bare Debian or Ubuntu machine with Python >= 3.11: `make mug_hang`, `make test`.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Drake's wheel needs glib to be imported; depth rendering needs EGL with Mesa's software driver.
# Each library is looked for by loading it, since Ubuntu renames some packages.  Trials take less
# time where jemalloc is installed, and need it for nothing else.
NEEDED := libglib-2.0.so.0:libglib2.0-0 libEGL.so.1:libegl1

export OMP_WAIT_POLICY := PASSIVE

.PHONY: setup test mug_hang system-libraries

setup: $(VENV)/.ready

$(VENV)/.ready: pyproject.toml | system-libraries
	@echo "setting up $(VENV): 0.45 GB to download, 1.9 GB on disk, 1 to 5 minutes"
	@$(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check $(PIP_FLAGS) --editable ".[dev]"
	@touch $@
	@echo "set up"

system-libraries:
	@missing=""; wished=""; for needed in $(NEEDED); do \
	  $(PYTHON) -c "import ctypes; ctypes.CDLL('$${needed%%:*}')" 2>/dev/null \
	    || missing="$$missing $${needed##*:}"; done; \
	dpkg -s libgl1-mesa-dri >/dev/null 2>&1 || missing="$$missing libgl1-mesa-dri"; \
	$(PYTHON) -c "import ensurepip" 2>/dev/null || missing="$$missing python3-venv"; \
	$(PYTHON) -c "import ctypes.util as u; exit(u.find_library('jemalloc') is None)" \
	  || wished=" libjemalloc2"; \
	if [ -z "$$missing$$wished" ]; then exit 0; fi; \
	if [ "$$(id -u)" = 0 ]; then \
	  echo "installing$$missing$$wished: some seconds"; \
	  { apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq \
	    --no-install-recommends $$missing$$wished >/dev/null; } || [ -z "$$missing" ]; \
	elif [ -n "$$missing" ]; then \
	  echo "missing Debian packages; run: sudo apt-get install -y$$missing$$wished"; exit 1; \
	else \
	  echo "trials take less time with jemalloc: sudo apt-get install -y$$wished"; \
	fi

test: setup
	@echo "lint, types and tests: 10 to 15 minutes on two cores"
	@$(BIN)/ruff check --quiet .
	@$(BIN)/ruff format --quiet --check .
	@$(BIN)/mypy --no-error-summary
	@# A worker that crashed is not replaced: xdist then waits for ever for the rest of its files.
	@OMP_NUM_THREADS=1 $(BIN)/pytest -n auto --dist loadfile --max-worker-restart 0

mug_hang: setup
	@echo "40 trials, 2 to 6 minutes on two cores"
	@$(BIN)/python -m scenarios.mug_hang --trials 40
