# Everything on a bare Debian or Ubuntu machine with Python >= 3.11: `make mug_hang`, `make test`.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Drake's wheel needs glib to be imported; depth rendering needs EGL with Mesa's software driver.
DEBIAN_PACKAGES := libglib2.0-0 libegl1 libgl1-mesa-dri
LIBRARIES := libglib-2.0.so.0 libEGL.so.1 libEGL_mesa.so.0

export OMP_WAIT_POLICY := PASSIVE

.PHONY: setup test mug_hang system-libraries

setup: $(VENV)/.ready

$(VENV)/.ready: pyproject.toml | system-libraries
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet $(PIP_FLAGS) --editable ".[dev]"
	touch $@

system-libraries:
	@missing=""; for library in $(LIBRARIES); do \
	  ldconfig -p | grep -q "$$library" || missing="$$missing $$library"; done; \
	if [ -z "$$missing" ]; then exit 0; fi; \
	if [ "$$(id -u)" = 0 ]; then \
	  apt-get update -qq && apt-get install -y -qq --no-install-recommends $(DEBIAN_PACKAGES); \
	else \
	  echo "missing libraries:$$missing"; \
	  echo "run: sudo apt-get install -y $(DEBIAN_PACKAGES)"; exit 1; \
	fi

test: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/pytest

mug_hang: setup
	$(BIN)/python -m scenarios.mug_hang --trials 40
