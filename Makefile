# The tests run beside each other, one process a core; those that fly in real time run alone, after the others.
# make demo: set everything up and locate a simulated walking person.   make test: the tests.   make lint: style, types,
# the directions of imports, and the documentation built with warnings as errors.
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin

.PHONY: demo test lint format bench soak lock clean

$(VENV)/installed: requirements.lock pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Sidestep needs Python 3.11 or newer")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --editable .
	touch $@

demo: $(VENV)/installed
	$(BIN)/sidestep sitl sitl/scenarios/demo.toml --report reports/demo

test: $(VENV)/installed
	$(BIN)/python -m pytest -n auto --dist loadfile -m 'not flight and not soak' --cov --cov-report=
	$(BIN)/python -m pytest -m 'flight and not soak' --cov --cov-append --cov-report=term:skip-covered

lint: $(VENV)/installed
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/mkdocs build --strict --quiet --site-dir build/docs

format: $(VENV)/installed
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

bench: $(VENV)/installed
	$(BIN)/python -m pytest tests/bench --benchmark-only

soak: $(VENV)/installed
	$(BIN)/python -m pytest -m soak

lock:
	rm -rf $(VENV)
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	( echo '# Exact versions for the demo and the tests (Python 3.11, Linux). Made by: make lock'; \
	  $(BIN)/python -m pip freeze --exclude-editable ) > requirements.lock
	touch $(VENV)/installed

clean:
	rm -rf $(VENV) build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
