# `make demo` and `make test` do all the set-up they need on a machine with Rust, Python 3.11 and pip.

PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
BIN := $(VENV)/bin
OUT := out
# How the wheel is compiled; with `checked` it shares that with the tests (Cargo.toml, .ci/run).
WHEEL := release
# What the wheel is made of, in the order in which the crates need each other.
CRATES := lapack predict recording numeric gp core
PACKAGES := $(foreach crate,$(CRATES),--package sgpr-$(crate))
SOURCES := Cargo.toml Cargo.lock $(foreach crate,$(CRATES) py,crates/sgpr-$(crate)/Cargo.toml) crates/sgpr-py/pyproject.toml \
	$(shell find $(foreach crate,$(CRATES) py,crates/sgpr-$(crate)/src) crates/sgpr-py/python examples/thesis \
	-name '*.rs' -o -name '*.py' -o -name '*.pyi' -o -name '*.js' -o -name '*.css' -o -name '*.html')

.PHONY: docs figures readme first-hour package semver sdist build c-library controller-demo demo workbench fleet-demo fleet-alarms demo-real estimators test test-rust compiled test-python skipped browser compilers lint lint-rust msrv deny bench \
	diagnosis-bench notebook diagnosis-mujoco peers fuzz soak clean thesis fuzz-guided fuzz-count

build: $(VENV)/.built

$(VENV)/.pip:
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --upgrade pip 'maturin>=1.9,<2'
	@touch $@

# The wheel is built from the locked dependencies, in the workspace's own target folder, and installed like any wheel.
$(VENV)/.built: $(SOURCES) | $(VENV)/.pip
	rm -rf $(VENV)/wheels
	$(BIN)/maturin build --profile $(WHEEL) --locked --quiet --manifest-path crates/sgpr-py/Cargo.toml \
		--interpreter $(BIN)/python --out $(VENV)/wheels
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --force-reinstall --no-deps $(VENV)/wheels/*.whl
	$(BIN)/python -m pip install --quiet --disable-pip-version-check $(VENV)/wheels/*.whl
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --force-reinstall --no-deps examples/thesis
	@touch $@

$(VENV)/.test: crates/sgpr-py/pyproject.toml | $(VENV)/.built
	$(BIN)/python -m pip install --quiet --disable-pip-version-check "$$(ls $(VENV)/wheels/*.whl)[test]"
	@touch $@

## The main job on bundled logs: identify on three, compare on one that the fit never saw.
demo: build
	$(BIN)/sgpr identify --robot data/demo/robot.urdf \
		--train data/demo/train_1.csv.gz data/demo/train_2.csv.gz data/demo/train_3.csv.gz \
		--test data/demo/test.csv.gz \
		--effects viscous_friction coulomb_friction rotor_inertia --out $(OUT)/demo
	@echo "report: $(OUT)/demo/report.html"
	@echo "model:  $(OUT)/demo/model.sgpr"
	@echo "by hand, in the browser: make workbench"

## The notebook with its outputs, figures as pictures (needs playwright and Chromium).
notebook: build
	$(BIN)/python tools/notebook.py

## The workbench on the bundled logs, in the browser (docs/workbench.md).
workbench: build
	$(BIN)/python -m pip install --quiet --disable-pip-version-check "$$(ls $(VENV)/wheels/*.whl)[workbench]"
	$(BIN)/sgpr workbench data/demo

## A simulated fleet with wear, tools, a collision and faults of sensors, and the page on what changed in which arm.
ARMS ?= 200
DAYS ?= 30
SESSIONS ?= 1
SESSION_SECONDS ?= 10
FLEET_ROBOTS = puma560=puma560 ur5e=data/reference/urdf/ur5e_like.urdf panda=data/reference/urdf/panda_like.urdf two_link=two_link
fleet-demo: build
	$(BIN)/python -m pip install --quiet --disable-pip-version-check "$$(ls $(VENV)/wheels/*.whl)[fleet]"
	@begin=$$(date +%s); tell() { echo "$$1: $$(($$(date +%s) - begin)) s since the beginning"; }; set -e; \
	$(BIN)/sgpr fleet simulate --robot $(FLEET_ROBOTS) --arms $(ARMS) --days $(DAYS) \
		--sessions $(SESSIONS) --seconds $(SESSION_SECONDS) --out $(OUT)/fleet/logs; tell logs; \
	$(BIN)/sgpr fleet run $(OUT)/fleet/logs/fleet.csv --robot $(FLEET_ROBOTS) --out $(OUT)/fleet/records; tell records; \
	$(BIN)/sgpr fleet report $(OUT)/fleet/records --robot $(FLEET_ROBOTS) --out $(OUT)/fleet/report; tell page

## False alarms of healthy simulated arms and rises of friction found, with intervals; minutes.
YEARS ?= 10
RISES ?= 24
fleet-alarms: build
	$(BIN)/python -m pip install --quiet --disable-pip-version-check "$$(ls $(VENV)/wheels/*.whl)[fleet]" scipy
	$(BIN)/python benches/fleet_alarms.py --years $(YEARS) --rises $(RISES)

## The same on the logs of real robots, in the folder that SGPR_DATA names.
demo-real: build
	$(BIN)/python examples/real_robots.py --out $(OUT)/real

## Estimators against each other on simulated logs: the tables of docs/estimators.md, on all cores.
EXPERIMENTS ?= 100
estimators:
	cargo run --locked --release --quiet --package sgpr-core --example estimators -- $(EXPERIMENTS)

## The experiments of the thesis, a few minutes; its numbers beside ours go to docs/thesis.md.
thesis: build
	$(BIN)/sgpr reproduce thesis --out $(OUT)/thesis --page docs/thesis.md
	@echo "figures: $(OUT)/thesis/report.html"

test: test-rust test-python skipped

# With the features of the wheel, which has no tests of its own here.
RUST_TESTS = cargo test --locked --quiet --profile checked $(PACKAGES) --package sgpr-c --package sgpr-py

test-rust: compilers
	$(RUST_TESTS)

# The same without running them; after the lints, which fail sooner.
compiled: lint-rust
	$(RUST_TESTS) --no-run

test-python: build $(VENV)/.test browser
	cd crates/sgpr-py && ../../$(BIN)/python -m pytest -q -rs --numprocesses=auto --maxprocesses=4 --dist=loadfile tests
	$(BIN)/python -m pytest -q -rs --numprocesses=auto --maxprocesses=4 --dist=loadfile tests

# Tests on logs that are not part of the repository run where SGPR_DATA names their folder (docs/real-data.md). Each says
# above that it was skipped; this is the last line that a person sees.
skipped:
	@test -n "$$SGPR_DATA" && echo "tests on logs of real robots: in $$SGPR_DATA" || \
		echo "skipped: tests on logs of real robots, because SGPR_DATA does not name the folder that holds them"

# The C library is tested with what people build with; without one of them those tests say that they skip.
compilers:
	@for tool in clang cmake; do \
		command -v $$tool > /dev/null || \
			{ [ "$$(id -u)" = 0 ] && apt-get install --yes --quiet $$tool > /dev/null 2>&1; } || \
			echo "no $$tool: tests of the C library with it will skip (apt install $$tool)"; \
	done

# The report is tested in a real browser; without one those tests say that they skip.
browser:
	@command -v chromium > /dev/null || command -v chromium-browser > /dev/null || \
		{ [ "$$(id -u)" = 0 ] && apt-get install --yes --quiet chromium > /dev/null; } || \
		echo "no Chromium: tests of the report in a browser will skip (apt install chromium)"

$(VENV)/.docs: docs/requirements.txt | $(VENV)/.built
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r docs/requirements.txt
	@touch $@

## The documentation as a site in out/site; a broken link fails.
docs: build $(VENV)/.docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet --strict
	@echo "site: $(OUT)/site/index.html"
	@echo "with its search, which needs a server: $(BIN)/python -m http.server --directory $(OUT)/site"

## The figures of the documentation, from the logs in data/.
figures: build
	$(BIN)/python -m pip install --quiet --disable-pip-version-check matplotlib
	$(BIN)/python tools/figures.py

## The figures of README.md, measured again and written into it.
readme: build
	$(BIN)/python tools/readme.py

## Formatting, lints, documentation and stubs without a warning.
lint: build $(VENV)/.test lint-rust
	$(BIN)/ruff check crates/sgpr-py examples tests benches tools
	$(BIN)/ruff format --check crates/sgpr-py examples tests benches tools
	$(BIN)/python -m mypy.stubtest sgpr._sgpr
	$(BIN)/python -m mypy --strict --package sgpr
	$(BIN)/python -m mypy --strict examples/thesis/sgpr_thesis

lint-rust:
	cargo fmt --all --check
	cargo clippy --locked --quiet --profile checked --workspace --all-targets -- -D warnings
	cargo clippy --locked --quiet --profile checked --package sgpr-recording -- -D warnings # Without formats that are features.
	RUSTDOCFLAGS="-D warnings" cargo doc --locked --quiet --profile checked --workspace --no-deps

## The oldest Rust that Cargo.toml promises, if rustup has it (rustup toolchain install $(MSRV)).
MSRV := $(shell sed -n 's/^rust-version = "\(.*\)"/\1/p' Cargo.toml)
msrv:
	@if rustup run $(MSRV) cargo --version > /dev/null 2>&1; then \
		rustup run $(MSRV) cargo check --locked --workspace --all-targets --target-dir target/msrv; \
	else \
		echo "skipped: no Rust $(MSRV) here; clippy checks what is used of the standard library instead"; \
		cargo clippy --locked --quiet --workspace --all-targets -- -D clippy::incompatible_msrv; \
	fi

## Licences, known vulnerabilities and sources of all dependencies (deny.toml).
deny:
	@cargo deny --version > /dev/null 2>&1 || cargo install --locked --quiet cargo-deny
	cargo deny --locked check licenses bans sources
	@if cargo deny fetch db > /dev/null 2>&1; then \
		cargo deny --locked check advisories; \
	else \
		echo "skipped: known vulnerabilities, because RustSec's data base cannot be reached from here"; \
	fi

## The path of docs/first-hour.md in an empty environment, timed.
first-hour: build
	rm -rf $(OUT)/first_hour
	$(PYTHON) tools/first_hour.py $$(ls $(VENV)/wheels/*.whl) $(OUT)/first_hour

## The crates as they would be published, built from what is in them; a warning fails.
package:
	@cargo package --locked --allow-dirty $(PACKAGES) 2> $(OUT)-package.log; \
		status=$$?; cat $(OUT)-package.log; grep -q '^warning' $(OUT)-package.log && status=1; rm -f $(OUT)-package.log; exit $$status

## The public interface of the crates beside that of BASE, a tag or commit: by default the last release.
BASE ?= $(shell git describe --tags --abbrev=0 --match 'v*' 2> /dev/null)
semver:
	@test -n "$(BASE)" || { echo "skipped: no release to compare with; make semver BASE=COMMIT compares with a commit"; exit 0; }; \
	cargo semver-checks --version > /dev/null 2>&1 || cargo install --locked --quiet cargo-semver-checks; \
	cargo semver-checks --baseline-rev "$(BASE)" $(PACKAGES)

## Source archives in out/dist, one of them with all crates: it builds without a network.
sdist: $(VENV)/.pip
	$(BIN)/python tools/vendored_sdist.py $(OUT)/dist

## The C library with its headers, for pkg-config and CMake: make c-library PREFIX=/usr/local (DESTDIR for packages).
PREFIX ?= $(CURDIR)/$(OUT)/c-library
c-library:
	cargo build --locked --release --quiet --package sgpr-c
	crates/sgpr-c/install.sh "$${CARGO_TARGET_DIR:-target}/release" "$(PREFIX)"
	@echo "library: $(PREFIX)/lib, headers: $(PREFIX)/include"

## A controller in C++ on an arm that MuJoCo moves: before, with the identified model, with what was found (docs/controllers.md).
controller-demo: build c-library
	$(BIN)/python -m pip install --quiet --disable-pip-version-check mujoco matplotlib
	$(BIN)/python examples/controller/run.py --out $(OUT)/controller --library $(PREFIX)
	@echo "plot: $(OUT)/controller/tracking.png"

bench:
	cargo bench --locked --package benches

## The diagnosis on random arms with hidden effects: how often it is right (docs/diagnosis.md).
diagnosis-bench:
	cargo run --locked --release --package sgpr-core --example diagnosis_bench -- --seed 1 --rounds 1

## The same on arms that MuJoCo moves in closed loop, one case for each effect.
diagnosis-mujoco: build
	$(BIN)/python -m pip install --quiet --disable-pip-version-check mujoco
	$(BIN)/python benches/peers/mujoco_cases.py $(OUT)/mujoco_cases
	cargo run --locked --release --package sgpr-core --example evaluate_diagnosis -- $(OUT)/mujoco_cases

## Against Pinocchio's C++ and Python interfaces, and a simulation step against MuJoCo's, each pair in one run.
peers: build
	$(BIN)/python benches/peers/run.py
	$(BIN)/python benches/peers/gp.py
	$(BIN)/python benches/peers/gp.py --points 6006 --inputs 18 --no-fit
	$(BIN)/python benches/peers/exported.py
	$(BIN)/python benches/peers/simulation.py

## Damaged and made-up files of every kind, many of them, and logs and models with values that no arm makes.
FUZZ_CASES ?= 100000
VALUE_CASES ?= 2000
fuzz:
	SGPR_FUZZ_CASES=$(FUZZ_CASES) cargo test --locked --release --package sgpr-recording --package sgpr-core \
		--features sgpr-recording/formats --test recording_hostile --test robot -- any changed damaged
	SGPR_FUZZ_CASES=$(VALUE_CASES) cargo test --locked --release --package sgpr-core --test hostile_values

## Files that are made where they reach code that no file reached before (fuzz/README.md), for FUZZ_SECONDS each.
FUZZ_SECONDS ?= 600
FUZZ_TARGETS ?= urdf dh csv mcap model semi_parametric
fuzz-guided:
	@cargo fuzz --version > /dev/null 2>&1 || cargo install --locked --quiet cargo-fuzz
	@mkdir -p $(foreach target,$(FUZZ_TARGETS),fuzz/found/$(target))
	for target in $(FUZZ_TARGETS); do \
		log=fuzz/found/$$target.log; \
		cargo +nightly fuzz run --sanitizer none $$target fuzz/found/$$target fuzz/corpus/$$target -- \
			-max_len=16384 -timeout=20 -rss_limit_mb=3000 -max_total_time=$(FUZZ_SECONDS) -print_final_stats=1 > $$log 2>&1 \
			|| { tail -40 $$log; exit 1; }; \
		sed -n "s/^stat::number_of_executed_units: */$$target /p" $$log | tee -a fuzz/executions.txt; \
	done
	@$(MAKE) --no-print-directory fuzz-count

## Executions so far, of fuzz/executions.txt, one line for each run: the table of fuzz/README.md.
fuzz-count:
	@echo "| target | executions |"; echo "|---|---:|"
	@awk '{ sum[$$1] += $$2; all += $$2 } END { for (target in sum) printf "| `%s` | %d |\n", target, sum[target] | "sort"; \
		close("sort"); printf "| all | %d |\n", all }' fuzz/executions.txt

## Millions of calls of a predictor and ten thousand identifications, in which memory must not grow; how long the slowest calls take.
SOAK_CALLS ?= 10000000
SOAK_FITS ?= 10000
soak:
	SGPR_SOAK_CALLS=$(SOAK_CALLS) SGPR_SOAK_FITS=$(SOAK_FITS) cargo test --locked --release --package sgpr-core --test soak
	SGPR_SOAK_CALLS=$(SOAK_CALLS) cargo test --locked --release --package sgpr-predict --features simd --test endurance

clean:
	rm -rf $(OUT) $(VENV) target
