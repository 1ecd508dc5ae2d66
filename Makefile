# The contributor's interface: every target does all the set-up that it needs.
PYTHON_BIN := .venv/bin/python
# Software rendering without a display; the user's own choice wins.
MUJOCO_GL ?= egl
export MUJOCO_GL

.PHONY: help demo test lint format bench wheel clean
help: ## show the targets
	@grep -E '^[a-z]+:.*## ' Makefile | sed -E 's/:.*## /\t/' | expand -t 12

demo: .venv/.installed ## train "raise both arms above the head" and write a policy, a video and a report
	$(PYTHON_BIN) -m agents.cli train "raise both arms above the head" --output runs/demo --overwrite

test: .venv/.installed ## run the tests
	$(PYTHON_BIN) -m pytest -x -q

lint: .venv/.installed ## ruff, mypy and the layering of imports
	$(PYTHON_BIN) -m ruff check .
	$(PYTHON_BIN) -m ruff format --check .
	$(PYTHON_BIN) -m mypy
	.venv/bin/lint-imports --no-cache

format: .venv/.installed ## format the code and sort the imports
	$(PYTHON_BIN) -m ruff check --fix .
	$(PYTHON_BIN) -m ruff format .

bench: .venv/.installed ## measure the speed of the simulation and of retrieval
	$(PYTHON_BIN) benchmarks/bench.py
	$(PYTHON_BIN) benchmarks/retrieval_search.py

wheel: .venv/.installed ## build the wheel and smoke-test it in a clean virtual environment
	bash tools/smoke_test_wheel.sh

clean: ## remove what building and testing leave (not .venv, not runs)
	rm -rf build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache

# A stamp file: the set-up runs again only when what it reads has changed.
.venv/.installed: setup.cfg pyproject.toml constraints.txt tools/set_up.sh
	bash tools/set_up.sh
	touch $@
