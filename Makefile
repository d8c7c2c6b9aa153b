# Everything that is done with this project. Each target sets up .venv by itself; a second call installs nothing.

PYTHON ?= python3
BIN := .venv/bin
READY := .venv/.ready
FUZZ := .venv/.fuzz
SOURCES := common onboard groundstation sitl tests
MISSION ?= inspection
NAME ?=
SECONDS ?= 60
KEY ?=
# All extras but oak, whose library has 400 MB.
LOCKED := groundstation gpio joystick laser logs realsense ros2 sitl token video

# Where bytecode is not kept, each start of a program or of the tests would compile everything anew.
unexport PYTHONDONTWRITEBYTECODE
# A notice of the site's theme about its successor, at each build.
export NO_MKDOCS_2_WARNING := 1

.PHONY: demo test unit check bench fuzz evidence schema docs pictures lock release clean

demo: $(READY)  ## simulated vehicle, onboard process and ground station, as three processes
	$(BIN)/gloc3 demo $(MISSION) --out runs/demo

test: $(READY)  ## all tests, every bar in a reduced form
	$(BIN)/python -m tests.everything

unit: $(READY)  ## the quick ones: no flights, simulators, sockets, processes, searches or pictures
	$(BIN)/python -m tests.unit

check: $(READY)  ## format, lint, types, import contracts, and the documentation as a site without a dead link
	$(BIN)/ruff format --check $(SOURCES)
	$(BIN)/ruff check $(SOURCES)
	$(BIN)/mypy $(SOURCES)
	$(BIN)/lint-imports
	$(BIN)/python -m mkdocs build --strict --quiet

bench: $(READY)  ## what the parts cost
	$(BIN)/python -m tests.benchmarks

fuzz: $(FUZZ)  ## every parser that a stranger's bytes reach, for SECONDS=60 each; NAME=… for one of them
	nice -n 10 $(BIN)/python -m tests.fuzz $(SECONDS) $(NAME)

evidence: $(FUZZ)  ## every bar in full, one page each under docs/evidence; NAME=… for one of them
	$(BIN)/python -m tests.evidence $(NAME)

schema: $(READY)  ## the JSON Schemas of mission files, platform files and the station's lines, as they are published
	$(BIN)/gloc3 mission schema --out docs/schema/mission.schema.json
	$(BIN)/gloc3 platform schema --out docs/schema/platform.schema.json
	$(BIN)/gloc3 station schema --out docs/schema/station-lines.schema.json

docs: $(READY)  ## the pages that are made from the code, then all of them as a site in site/; to search in it, serve it: python3 -m http.server -d site
	$(BIN)/python -m tests.house
	$(BIN)/python -m mkdocs build --strict --quiet

pictures: $(READY)  ## the pictures in the docs, from simulated flights; NAME=… for one set of them, such as demo
	$(BIN)/python -m tests.pictures $(NAME)

lock:  ## after a change of the dependencies: new hashes
	test -x $(BIN)/uv || $(BIN)/python -m pip install --quiet --disable-pip-version-check uv
	$(BIN)/uv pip compile -q pyproject.toml $(LOCKED:%=--extra %) --group dev --generate-hashes --universal \
	    --python-version 3.11 --no-header --no-annotate -o requirements.txt
	$(BIN)/uv pip compile -q --group fuzz --generate-hashes --universal \
	    --python-version 3.11 --no-header --no-annotate -o requirements-fuzz.txt

release: $(READY)  ## all that is published of a version, in dist/, once its notes are ready; KEY=FILE signs it with a private key of OpenSSH
	$(BIN)/python -m tests.release $(if $(KEY),--key "$(KEY)")

clean:
	rm -rf .venv runs site

$(READY): requirements.txt pyproject.toml
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	$(BIN)/python -m compileall -q common onboard groundstation sitl
	touch $@

$(FUZZ): $(READY) requirements-fuzz.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements-fuzz.txt
	touch $@
