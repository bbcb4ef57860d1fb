# make demo    set up what is missing, reconstruct the bundled pair, say where the results lie
# make test    set up what is missing, run every check and every test
# make check   format, lint, types and the quick tests

PYTHON ?= python3
VENV   ?= .venv
TORCH  ?= torch==2.13.0
BIN    := $(VENV)/bin

.PHONY: demo test check setup clean

demo: setup
	$(BIN)/reconstruct demo -o out/demo

test: check
	$(BIN)/python -m pytest -m "slow or gpu"

check: setup
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/python -m pytest -m "not slow and not gpu"

setup: $(VENV)/.installed

# torch first and pinned: a range would bring the newest build with several GB for CUDA.
$(VENV)/.installed: pyproject.toml setup.py
	sh ./setup.sh "$(PYTHON)" "$(VENV)"
	$(BIN)/python -m pip install --quiet --disable-pip-version-check "$(TORCH)"
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[dev]"
	touch $@

clean:
	rm -rf $(VENV) out build *.egg-info .mypy_cache .pytest_cache .ruff_cache
