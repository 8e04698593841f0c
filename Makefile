# Two words for a newcomer: `make demo` and `make test`; each does all set-up by itself.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PYTEST_ARGS ?= -n auto

.PHONY: setup demo test check bench plugin clean

setup: $(VENV)/.done

$(VENV)/.done: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --upgrade pip
	$(BIN)/pip install --quiet --editable '.[dev]'
	# For QGIS's own Python (tests/qgis_plugin): our pytest must not see pytest-qgis, which needs QGIS at once.
	$(BIN)/pip install --quiet --upgrade --target $(VENV)/qgis-tests 'pytest>=8' 'pytest-qgis>=2'
	# Compile the inner loops now, once: the first flight must not wait for it.
	$(BIN)/python -W ignore -c 'import photomap_gis.live.session, photomap_gis.pipeline.in_space, photomap_gis.mosaic.run'
	touch $@

demo: setup
	$(BIN)/photomap demo -o demo

test: setup
	$(BIN)/python -m pytest $(PYTEST_ARGS)

check: setup
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# The QGIS plugin's zip; needs nothing but Python (and Qt's lrelease, where its translations shall be in it).
plugin:
	$(PYTHON) scripts/build_plugin.py

bench: setup
	$(BIN)/python -m benchmarks.flights

clean:
	rm -rf $(VENV) demo build dist
