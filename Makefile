# Everything on a bare Debian or Ubuntu machine with Python >= 3.11: `make mug_hang`, `make test`.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Drake's wheel needs glib to be imported; depth rendering needs EGL with Mesa's software driver.
# Each library is looked for by loading it, since Ubuntu renames some packages.
NEEDED := libglib-2.0.so.0:libglib2.0-0 libEGL.so.1:libegl1

export OMP_WAIT_POLICY := PASSIVE

.PHONY: setup test mug_hang system-libraries

setup: $(VENV)/.ready

$(VENV)/.ready: pyproject.toml | system-libraries
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet $(PIP_FLAGS) --editable ".[dev]"
	touch $@

system-libraries:
	@missing=""; for needed in $(NEEDED); do \
	  $(PYTHON) -c "import ctypes; ctypes.CDLL('$${needed%%:*}')" 2>/dev/null \
	    || missing="$$missing $${needed##*:}"; done; \
	dpkg -s libgl1-mesa-dri >/dev/null 2>&1 || missing="$$missing libgl1-mesa-dri"; \
	$(PYTHON) -c "import ensurepip" 2>/dev/null || missing="$$missing python3-venv"; \
	if [ -z "$$missing" ]; then exit 0; fi; \
	if [ "$$(id -u)" = 0 ]; then \
	  apt-get update -qq && apt-get install -y -qq --no-install-recommends $$missing; \
	else \
	  echo "missing Debian packages; run: sudo apt-get install -y$$missing"; exit 1; \
	fi

test: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/pytest

mug_hang: setup
	$(BIN)/python -m scenarios.mug_hang --trials 40
