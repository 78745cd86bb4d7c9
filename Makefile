# Every target is self-sufficient on a fresh machine.
# Options pass through ARGS, as in: make demo ARGS="--duration 30 --port 8090"

SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:

# Images often set it; each process would then compile all sources again.
unexport PYTHONDONTWRITEBYTECODE

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
ARGS ?=
SOURCE ?=

# Show a long command's progress in one line; standard error stays.
ON_ONE_LINE := | awk '{ gsub(/[^ -~]/, ""); printf "\r\033[K  %.100s", $$0; fflush() } END { print "\r\033[K  done" }'

DASHBOARD := cloud/dashboard
DASHBOARD_SOURCES := $(shell find $(DASHBOARD)/src $(DASHBOARD)/public -type f 2>/dev/null) \
	$(DASHBOARD)/index.html $(DASHBOARD)/package.json $(DASHBOARD)/package-lock.json
DASHBOARD_BUILT := cloud/eskin_cloud/dashboard/index.html

# MicroPython, which runs the firmware in tests.
MICROPYTHON := tests/contract/micropython
MICROPYTHON_INSTALLED := $(MICROPYTHON)/node_modules/.package-lock.json

# Home Assistant, in an environment of its own: tests check how it reads our discovery messages.
HOME_ASSISTANT := $(VENV)/homeassistant
HOME_ASSISTANT_NEEDS := tests/unit/gateway/homeassistant/requirements.txt

# rtamt, in an environment of its own: it wants an old ANTLR; tests and `make bench` compare with it.
RTAMT := $(VENV)/rtamt
RTAMT_NEEDS := tests/unit/eskin/monitor/rtamt/requirements.txt

# thingsboard-gateway, in an environment of its own: `make bench` compares the gateway with it.
THINGSBOARD := $(VENV)/thingsboard
THINGSBOARD_NEEDS := benchmarks/thingsboard/requirements.txt

# TLC, in an environment of its own: checks the model of delivery.
TLC := $(VENV)/tlc
TLC_NEEDS := tests/robustness/model/requirements.txt

# Patroni, in an environment of its own: tests and `make chaos ARGS=--cluster` have it promote a standby.
PATRONI := $(VENV)/patroni
PATRONI_NEEDS := tests/system/patroni/requirements.txt

# What builds Citus, in `make test-cluster SOURCE=DIR` and `make chaos ARGS=--citus SOURCE=DIR`.
CITUS_PACKAGES := $(if $(PG_CONFIG),,postgresql-server-dev-15 libkrb5-dev liblz4-dev libzstd-dev libssl-dev)

.PHONY: help demo test test-nightly test-compose test-cluster lint bench soak chaos powercut fuzz simulate interleavings model nightly scan lock docs dashboard install system clean

help: ## List these commands
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 16

demo: $(VENV)/.runtime $(DASHBOARD_BUILT) ## Run the whole stack on this machine and print a login URL
	@exec $(BIN)/eskin demo $(ARGS)

test: $(VENV)/.development $(DASHBOARD_BUILT) $(MICROPYTHON_INSTALLED) $(HOME_ASSISTANT)/.installed $(RTAMT)/.installed system ## Run the tests, without the nightly ones (installs Mosquitto, PostgreSQL, Prometheus, Chromium and SoftHSM on Debian)
	$(BIN)/pytest --numprocesses 4 --dist loadscope --no-loadscope-reorder $(ARGS)
	services/npm.sh $(DASHBOARD) test

test-nightly: $(VENV)/.development $(DASHBOARD_BUILT) $(MICROPYTHON_INSTALLED) $(HOME_ASSISTANT)/.installed $(RTAMT)/.installed $(TLC)/.installed $(PATRONI)/.installed system ## Run the tests that are marked nightly: make test leaves them out, CI runs them
	@services/install_test_packages.sh openjdk-17-jre-headless
	$(BIN)/pytest --numprocesses 4 --dist loadscope --no-loadscope-reorder -m nightly $(ARGS)

test-compose: $(VENV)/.development ## Bring docker-compose.yml up on a real container engine and check it (root)
	@services/install_test_packages.sh docker.io docker-compose debootstrap
	$(BIN)/pytest tests/system/compose -m compose --timeout 1800 $(ARGS)

test-cluster: $(VENV)/.development ## Build Citus from a source tree, and check a distributed store and docker-compose.cluster.yml on it (SOURCE=DIR, a checkout of v13.0.5; root)
ifneq ($(SOURCE),)
	@services/install_test_packages.sh postgresql $(CITUS_PACKAGES) docker.io docker-compose debootstrap
endif
	ESKIN_CITUS_SOURCE="$(SOURCE)" $(BIN)/pytest tests/system -m cluster --timeout 1800 $(ARGS)

lint: $(VENV)/.development $(DASHBOARD_BUILT) ## Format, lint, types, import rules, banned words
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m tests.architecture.prose
	services/npm.sh $(DASHBOARD) run lint

bench: $(VENV)/.development $(VENV)/.peers $(RTAMT)/.installed $(THINGSBOARD)/.installed $(DASHBOARD_BUILT) system ## Measure speed; prints a table, writes build/bench.json
	@services/install_test_packages.sh influxdb
	$(BIN)/python -m benchmarks $(ARGS)

soak: $(VENV)/.development ## Measure the stack's memory under a steady load (ARGS="--duration 3600 --rate 1000")
	@services/install_test_packages.sh mosquitto
	$(BIN)/python -m benchmarks.soak $(ARGS)

chaos: $(VENV)/.development $(TLC)/.installed $(PATRONI)/.installed ## Put the real stack under a seeded plan of faults (root; ARGS="--duration 120 --seed 1 --cluster"; ARGS=--citus SOURCE=DIR on Citus)
	@services/install_test_packages.sh mosquitto iproute2 iptables gcc libc6-dev postgresql etcd-server openjdk-17-jre-headless
ifneq ($(SOURCE),)
	@services/install_test_packages.sh $(CITUS_PACKAGES)
endif
	ESKIN_CITUS_SOURCE="$(SOURCE)" $(BIN)/python -m tests.robustness.chaos $(ARGS)

powercut: $(VENV)/.development ## Cut the power of flash, spool and store at any byte (ARGS="--images 500 --seed 1")
	@services/install_test_packages.sh gcc libc6-dev
	$(BIN)/python -m tests.robustness.powercut $(ARGS)

fuzz: $(VENV)/.development $(VENV)/.fuzz ## Hostile inputs to every parser (ARGS="--inputs 100000 --target wire")
	$(BIN)/python -m tests.robustness.fuzz $(ARGS)

simulate: $(VENV)/.development ## Nodes, gateways and a cloud in one thread, under seeded faults (ARGS="--seeds 100", ARGS="--seed 3")
	$(BIN)/python -m tests.robustness.simulation $(ARGS)

interleavings: $(VENV)/.development ## Clouds on one PostgreSQL, in many orders of their statements (200; more by python -m tests.robustness.interleavings)
	@services/install_test_packages.sh postgresql
	$(BIN)/pytest -m schedules tests/robustness/interleavings $(ARGS)

model: $(VENV)/.development $(TLC)/.installed ## Check the model of delivery with TLC (ARGS="--large", ARGS="--mutants")
	@services/install_test_packages.sh openjdk-17-jre-headless
	$(BIN)/python -m tests.robustness.model $(ARGS)

nightly: $(VENV)/.development $(DASHBOARD_BUILT) $(MICROPYTHON_INSTALLED) $(HOME_ASSISTANT)/.installed $(RTAMT)/.installed $(TLC)/.installed $(PATRONI)/.installed system ## Every long check, one after the other; logs in build/nightly (root; ARGS="--step fuzz --seed 2"; SOURCE=DIR also on Citus)
	ESKIN_CITUS_SOURCE="$(SOURCE)" $(BIN)/python -m tests.nightly $(ARGS)

scan: $(VENV)/.scan ## Check the pinned libraries for known vulnerabilities (needs the network)
	@status=0; \
		$(BIN)/pip-audit --strict --no-deps --disable-pip --requirement requirements.lock $(ARGS) || status=1; \
		services/scan_npm.sh $(DASHBOARD) || status=1; \
		exit $$status

lock: ## Resolve and pin all libraries, with hashes, in requirements.lock (ARGS=--upgrade; needs the network)
	@services/lock.sh $(ARGS)

docs: $(VENV)/.docs ## Build pages and API reference as one site with search, in build/docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build $(ARGS)

dashboard: $(DASHBOARD_BUILT) ## Build the dashboard

install: $(VENV)/.runtime ## Make the virtual environment with the command eskin, and compile its kernels
	@echo "Compiling the kernels, so no first call waits for it: about a minute, once …"
	@$(BIN)/eskin warm

system: ## Install the Debian packages that the tests need
	@services/install_test_packages.sh mosquitto mosquitto-clients chromium gcc libc6-dev postgresql etcd-server softhsm2 prometheus prometheus-alertmanager

clean: ## Remove what was built (data folders stay)
	rm -rf $(VENV) build $(dir $(DASHBOARD_BUILT)) $(DASHBOARD)/node_modules

$(VENV)/bin/pip:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
		|| { echo "eskin needs Python 3.11 or newer; $(PYTHON) is $$($(PYTHON) --version)" >&2; exit 1; }
	@echo "Making a virtual environment …"
	@$(PYTHON) -m venv $(VENV) \
		|| { echo "no virtual environment could be made; on Debian: apt-get install python3-venv" >&2; exit 1; }

$(VENV)/.runtime: pyproject.toml requirements.lock | $(VENV)/bin/pip
	@echo "Installing eskin and what it needs …"
	@services/install.sh $(VENV) stack figures $(ON_ONE_LINE)
	@touch $@

$(VENV)/.development: pyproject.toml requirements.lock | $(VENV)/bin/pip
	@echo "Installing eskin and what its tests need …"
	@services/install.sh $(VENV) dev $(ON_ONE_LINE)
	@touch $@ $(VENV)/.runtime

$(VENV)/.peers: pyproject.toml requirements.lock | $(VENV)/.development
	@echo "Installing the libraries of the benchmark …"
	@services/install.sh $(VENV) bench $(ON_ONE_LINE)
	@touch $@

$(VENV)/.fuzz: pyproject.toml requirements.lock | $(VENV)/.development
	@echo "Installing the fuzzer …"
	@services/install.sh $(VENV) fuzz $(ON_ONE_LINE)
	@touch $@

$(VENV)/.docs: pyproject.toml requirements.lock | $(VENV)/.development
	@echo "Installing what builds the documentation …"
	@services/install.sh $(VENV) docs $(ON_ONE_LINE)
	@touch $@

$(VENV)/.scan: pyproject.toml requirements.lock | $(VENV)/bin/pip
	@echo "Installing pip-audit …"
	@services/install.sh $(VENV) --only scan $(ON_ONE_LINE)
	@touch $@

$(MICROPYTHON_INSTALLED): $(MICROPYTHON)/package.json $(MICROPYTHON)/package-lock.json | $(VENV)/bin/pip
	@services/npm.sh $(MICROPYTHON) ci
	@touch $@

$(HOME_ASSISTANT)/.installed: $(HOME_ASSISTANT_NEEDS) | $(VENV)/bin/pip
	@echo "Installing Home Assistant's MQTT sensor, for tests of discovery …"
	@$(PYTHON) -m venv $(HOME_ASSISTANT)
	@$(HOME_ASSISTANT)/bin/pip install --disable-pip-version-check --no-deps --requirement $< $(ON_ONE_LINE)
	@touch $@

$(RTAMT)/.installed: $(RTAMT_NEEDS) | $(VENV)/bin/pip
	@echo "Installing rtamt, for tests of monitors …"
	@$(PYTHON) -m venv $(RTAMT)
	@$(RTAMT)/bin/pip install --disable-pip-version-check --no-deps --requirement $< $(ON_ONE_LINE)
	@touch $@

$(THINGSBOARD)/.installed: $(THINGSBOARD_NEEDS) | $(VENV)/bin/pip
	@echo "Installing thingsboard-gateway, for the benchmark …"
	@$(PYTHON) -m venv $(THINGSBOARD)
	@$(THINGSBOARD)/bin/pip install --disable-pip-version-check --no-deps --requirement $< $(ON_ONE_LINE)
	@touch $@

$(TLC)/.installed: $(TLC_NEEDS) | $(VENV)/bin/pip
	@echo "Installing TLC, for the model of delivery …"
	@$(PYTHON) -m venv $(TLC)
	@$(TLC)/bin/pip install --disable-pip-version-check --no-deps --requirement $< $(ON_ONE_LINE)
	@touch $@

$(PATRONI)/.installed: $(PATRONI_NEEDS) | $(VENV)/bin/pip
	@echo "Installing Patroni, for tests of failover …"
	@$(PYTHON) -m venv $(PATRONI)
	@$(PATRONI)/bin/pip install --disable-pip-version-check --require-hashes --no-deps --requirement $< $(ON_ONE_LINE)
	@touch $@

$(DASHBOARD_BUILT): $(DASHBOARD_SOURCES) | $(VENV)/bin/pip
	@echo "Building the dashboard …"
	@services/npm.sh $(DASHBOARD) ci
	@services/npm.sh $(DASHBOARD) run build
	@touch $@
