# `make demo` and `make test` do everything, in a .venv of the project's own.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt

.PHONY: demo test lint pictures clean

demo: $(VENV)/demo.installed
	$(BIN)/flipcar demo

test: $(VENV)/dev.installed
	$(BIN)/python -m pytest

lint: $(VENV)/dev.installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# The README's pictures and the charts' figures, drawn again; the viewer's needs a graphics driver.
pictures: $(VENV)/dev.installed
	$(BIN)/python -m train.pictures docs

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "FlipCar needs Python 3.11 or newer; set PYTHON=python3.11")'
	$(PYTHON) -m venv $(VENV)

$(VENV)/demo.installed: $(BIN)/python pyproject.toml constraints.txt
	$(PIP) -e .
	touch $@

# torch first and by itself: an open range would bring the newest build with its CUDA libraries.
$(VENV)/dev.installed: $(BIN)/python pyproject.toml constraints.txt
	$(PIP) "torch==$$(sed -n 's/^torch==//p' constraints.txt)"
	$(PIP) -e '.[dev]'
	touch $@ $(VENV)/demo.installed

clean:
	rm -rf $(VENV) build *.egg-info
