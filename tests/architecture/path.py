"""``python -m tests.architecture.path``: the files of ours that a sample and a command pass.

The real parts run: Mosquitto, one cloud, one gateway, and two emulated nodes, each a process of
its own. Once all are connected and warm, two windows are traced.

- **Sample.** The node ``sample`` has one capacitive taxel of two channels, and sends frames. The
  window lasts until live events and an answer of ``/series`` show samples that were measured after
  the window began.
- **Command.** The node ``command`` writes a frame a minute. The window lasts from
  ``POST /nodes/command/commands`` until the cloud has stored the node's answer.

The rules:

- A *file* is passed if a function in it runs in the window, not its import. The profiler of each
  thread sees the functions in Python, and each compiled kernel that Python calls. What is compiled
  into a kernel is not seen.
- A file *carries* the sample if an argument or a result of such a function is data: bytes, an
  array, numbers in a row, or an instance of a wrapper type.
- A *wrapper type* is a class of ours of which instances are made in the window, are arguments or
  results there, and refer to data, by themselves or through other such instances. Exceptions do not
  count. A ``TypedDict`` is a plain ``dict`` and is not seen.
- Background work does not count: `BACKGROUND_THREADS`, and each task that has run a function of
  `BACKGROUND_FILES`, with what it leaves to other threads. Nor do the files and
  types in `NOT_COUNTED`. Status messages come less often.
- A command's answer takes the way of every message, so a command is counted by the files that a
  sample does not pass.

``--update`` writes the list into ``docs/architecture.md``.
"""

from __future__ import annotations

import array
import contextlib
import gc
import json
import multiprocessing
import os
import signal
import sys
import tempfile
import threading
import time
import traceback
from collections import Counter, defaultdict
from contextlib import ExitStack
from contextvars import ContextVar, copy_context
from dataclasses import dataclass, field
from datetime import timedelta
from functools import cache, partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NoReturn, Self

import eskin_cloud.service
import eskin_gateway.service
import eskin_sensor_node.service
import httpx
import numpy as np
from eskin_cloud.access import Scope, create_token
from eskin_cloud.settings import CloudSettings
from eskin_cloud.store import Store
from eskin_cloud.store.write.writer import Writer
from eskin_gateway.settings import GatewaySettings
from eskin_sensor_node.settings import NodeSettings
from numba.core.dispatcher import Dispatcher

from eskin.demo.ports import free_ports
from eskin.identity import IdentityKind
from eskin.runtime.logs import start_logs
from eskin.wire.timestamp import parse_timestamp
from tests.support.brokers import Mosquitto
from tests.support.files import write_settings
from tests.support.fleets import TAXEL
from tests.support.identities import Identities
from tests.support.processes import PLAIN, free_port, wait_until

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from multiprocessing.connection import Connection
    from types import CodeType, FrameType, TracebackType

ROOT: Final = Path(__file__).parents[2]
PAGE: Final = ROOT / "docs" / "architecture.md"
BEGIN: Final = "<!-- begin: python -m tests.architecture.path --update -->\n"
END: Final = "<!-- end -->\n"
FOLDERS: Final = tuple(
    f"{ROOT / name}/"
    for name in (
        *("sensor_node/eskin_sensor_node", "gateway/eskin_gateway", "cloud/eskin_cloud"),
        *("ca_service/eskin_ca", "eskin"),
    )
)
BACKGROUND_THREADS: Final = {
    "sample": {"command_poller", "subject_sync", "health_server", "keyring", "control"},
    "command": {"subject_sync", "health_server", "keyring", "control"},
}
"""By window."""
JOBS: Final = (
    "cloud/eskin_cloud/jobs/",
    "cloud/eskin_cloud/rollup/patch_tile_builder.py",
    "cloud/eskin_cloud/alarms/evaluator.py",
)
BACKGROUND_FILES: Final = {
    "sample": (*JOBS, "cloud/eskin_cloud/api/deliveries.py"),
    "command": JOBS,
}
"""By window."""
NOT_COUNTED: Final = {
    "eskin/identity/identity.py": "start of a TLS connection",
    "eskin.runtime.http_server.protocol.GuardedProtocol": "start of a TLS connection",
    "eskin/identity/tls.py": "start of a TLS connection",
    "eskin/runtime/http_server/listener.py": "start of a TLS connection",
    "eskin/runtime/logs.py": "logging",
    "eskin/union_bound.py": "runs where frames come faster than hulls are published",
    "eskin/runtime/printable.py": "logging",
}
NODES: Final = {"sample": (1000.0, 250.0), "command": (0.1, 60_000.0)}
"""Samples a second of each node, and how long a frame is, ms."""
MOST_CALLS: Final = 300
"""Calls of a function whose arguments and results are examined."""
MOST_ITEMS: Final = 50
MOST_DEPTH: Final = 4
BACKGROUND: Final[ContextVar[bool]] = ContextVar("background", default=False)


@cache
def find_file(code: CodeType) -> str:
    """The file of ours that a function stands in, from the repository's root; else empty."""
    if code.co_name == "<module>" or not code.co_filename.startswith(FOLDERS):
        return ""
    name = str(Path(code.co_filename).relative_to(ROOT))
    return "" if name in NOT_COUNTED else name


def is_ours(value: object) -> bool:
    """Whether an object's class is ours, and no exception."""
    package = str(type(value).__module__).partition(".")[0]
    return package.startswith("eskin") and not isinstance(value, BaseException | type)


@dataclass
class Trace:
    """What one window recorded.

    Attributes:
        files: Their functions that ran.
        carriers: Files that carry data.
        types: Wrapper types.
    """

    files: dict[str, set[str]] = field(default_factory=lambda: defaultdict(set))
    carriers: set[str] = field(default_factory=set)
    types: set[str] = field(default_factory=set)

    def add(self, other: Trace) -> None:
        """Take over what another process recorded."""
        for name, functions in other.files.items():
            self.files[name] |= functions
        self.carriers |= other.carriers
        self.types |= other.types


class Recorder:
    """Records what runs in one process while a window is open."""

    def __init__(self) -> None:
        self._window = ""
        self._files: dict[str, set[str]] = {}
        self._carriers: set[str] = set()
        self._calls: Counter[CodeType] = Counter()
        self._old: list[object] = []
        self._old_ids: set[int] = set()
        self._new: dict[int, object] = {}
        self._handled: dict[str, set[int]] = {}

    def install(self) -> None:
        """Profile this thread and those that start from now on, and calls of kernels."""
        call_kernel, submit = Dispatcher.__call__, Writer.submit

        def call(dispatcher: Any, *args: Any, **named: Any) -> Any:
            if self._window:
                code = dispatcher.py_func.__code__
                self._record(code, code.co_name, (*args, *named.values()))
            return call_kernel(dispatcher, *args, **named)

        def submit_in_context(writer: Writer, work: Callable[..., Any], **named: Any) -> Any:
            return submit(writer, partial(copy_context().run, work), **named)

        dispatcher: Any = Dispatcher
        dispatcher.__call__ = call
        store_writer: Any = Writer
        store_writer.submit = submit_in_context
        threading.setprofile(self._profile)
        sys.setprofile(self._profile)

    def begin(self, window: str) -> None:
        """Open a window."""
        self._files, self._handled = defaultdict(set), defaultdict(set)
        self._new, self._carriers = {}, set()
        self._calls.clear()
        gc.unfreeze()  # what is frozen is not listed
        # These are kept, so that no new object gets the identity of an old one.
        self._old = [each for each in gc.get_objects() if is_ours(each)]
        self._old_ids = set(map(id, self._old))
        self._window = window

    def end(self) -> Trace:
        """Close the window."""
        self._window = ""
        new = dict(self._new)
        wrappers = {key: each for key, each in new.items() if refers_to_data(each, new)}
        carriers = {name for name, ids in self._handled.items() if not ids.isdisjoint(wrappers)}
        names = {f"{type(each).__module__}.{type(each).__qualname__}" for each in wrappers.values()}
        types = names - NOT_COUNTED.keys()
        return Trace(dict(self._files), self._carriers | carriers, types)

    def _profile(self, frame: FrameType, event: str, result: object) -> None:
        if not self._window or event not in {"call", "return"}:
            return
        code = frame.f_code
        if not find_file(code):
            return
        handled: Sequence[object] = (result,) if event == "return" else ()
        if event == "call" and self._calls[code] < MOST_CALLS:
            values = frame.f_locals
            arguments = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
            handled = [values.get(name) for name in arguments]
        self._record(code, code.co_qualname, handled)

    def _record(self, code: CodeType, function: str, handled: Sequence[object]) -> None:
        """Record that a function runs, and what it takes or returns."""
        name = find_file(code)
        if not name or self._is_background(name):
            return
        self._files[name].add(function)
        self._calls[code] += 1
        if self._calls[code] > 2 * MOST_CALLS:
            return
        lists = [each for each in handled if isinstance(each, list | tuple)]
        for value in chain(handled, *(each[:MOST_ITEMS] for each in lists)):
            if is_data(value, {}, 0):
                self._carriers.add(name)
            elif is_ours(value) and id(value) not in self._old_ids:
                self._new[id(value)] = value
                self._handled[name].add(id(value))

    def _is_background(self, name: str) -> bool:
        if threading.current_thread().name in BACKGROUND_THREADS.get(self._window, ()):
            return True
        if name.startswith(BACKGROUND_FILES.get(self._window, ())):
            BACKGROUND.set(True)  # threads that the task waits for copy its context
        return BACKGROUND.get()


def refers_to_data(value: object, new: dict[int, object], depth: int = 0) -> bool:
    """Whether an object of ours refers to data.

    Args:
        value: The object.
        new: Objects of ours that were made in the window, by identity.
        depth: Of references, so far.
    """
    slots = [name for kind in type(value).__mro__ for name in getattr(kind, "__slots__", ())]
    parts = [getattr(value, name, None) for name in slots if isinstance(name, str)]
    parts += getattr(value, "__dict__", {}).values()
    if isinstance(value, tuple | list):
        parts += value
    return any(is_data(part, new, depth) for part in parts)


def is_data(part: object, new: dict[int, object], depth: int) -> bool:
    """Whether a value is data, or refers to it; arguments as for `refers_to_data`."""
    if isinstance(part, bytes | bytearray | memoryview | np.ndarray | array.array):
        return True
    if depth > MOST_DEPTH:
        return False
    if isinstance(part, tuple | list) and not is_ours(part):
        return any(
            (isinstance(each, float | int) and not isinstance(each, bool))
            or is_data(each, new, depth + 1)
            for each in part[:MOST_ITEMS]
        )
    return id(part) in new and refers_to_data(part, new, depth + 1)


class Traced:
    """A process of the stack with a recorder in it: a fork, so that nothing is imported twice."""

    def __init__(self, name: str, run: Callable[[], object], log: Path) -> None:
        self._name, self._log = name, log
        self._pipe, pipe = multiprocessing.Pipe()
        self._pid = os.fork()
        if not self._pid:
            _become(run, pipe, log)

    def begin(self, window: str) -> None:
        """Open a window."""
        self._ask(window)

    def end(self) -> Trace:
        """Close the window."""
        found = self._ask("")
        assert isinstance(found, Trace)
        return found

    def _ask(self, window: str) -> object:
        self._pipe.send(window)
        assert self._pipe.poll(30), f"{self._name} does not answer:\n{self._log.read_text()}"
        return self._pipe.recv()

    def wait_for(self, text: str) -> None:
        """Wait until the log has a text, while the process lives."""

        def is_there() -> bool:
            if self._pid and os.waitpid(self._pid, os.WNOHANG)[0]:
                self._pid = 0
            assert self._pid, f"{self._name} ended:\n{self._log.read_text()}"
            return text in self._log.read_text()

        wait_until(is_there, f"{self._name}: {text}")

    def stop(self) -> None:
        """End it, unless it has ended."""
        if self._pid:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self._pid, signal.SIGTERM)
            os.waitpid(self._pid, 0)
            self._pid = 0


def _become(run: Callable[[], object], pipe: Connection, log: Path) -> NoReturn:
    """What the fork does."""
    status = 1
    try:
        output = log.open("w")
        for number in (1, 2):
            os.dup2(output.fileno(), number)
        sys.stdout = sys.stderr = output  # pytest has put others there
        start_logs("INFO")
        recorder = Recorder()
        control = threading.Thread(
            target=_control, args=(recorder, pipe), name="control", daemon=True
        )
        control.start()
        recorder.install()
        run()
        status = 0
    except BaseException:  # noqa: BLE001 - a traceback is for the log
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        os._exit(status)


def _control(recorder: Recorder, pipe: Connection) -> None:
    while True:
        window = pipe.recv()
        if window:
            recorder.begin(window)
        pipe.send(None if window else recorder.end())


class Stack:
    """Broker, cloud, gateway and two nodes.

    Args:
        folder: Takes all their files.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            self._start(stack)
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stack.__exit__(kind, error, trace)

    def _start(self, stack: ExitStack) -> None:
        pki = self._folder / "pki"
        identities = Identities(pki)
        server = identities.make(IdentityKind.SERVER, "server.cloud")
        for node in NODES:
            identities.make(IdentityKind.NODE, node)
        ingest, people = free_ports(2)
        store = self._folder / "store.sqlite"
        cloud = write_settings(self._folder / "cloud.toml", {
            "store": {"path": store},
            "people": {"port": people},
            "gateways": {"port": ingest, "identity": server.directory},
            "retention": {"every_s": 86_400},
            "compaction": {"every_s": 86_400},
        })  # fmt: skip
        broker = stack.enter_context(Mosquitto(self._folder / "broker", identities))
        gateway = write_settings(self._folder / "gateway.toml", {
            "broker": {"host": "127.0.0.1", "port": broker.gateway_port},
            "identity": {
                "directory": identities.gateway.directory, "site": identities.site.directory,
            },
            "cloud": {"url": f"https://127.0.0.1:{ingest}/api/v1/ingest"},
            "spool": {"path": self._folder / "spool.sqlite"},
            "commands": {"wait_s": 60},
            "http": {"port": free_port()},
        })  # fmt: skip
        with Store(store) as opened:
            scopes = [Scope.READ, Scope.OPERATE]
            lifetime = timedelta(hours=1)
            token = create_token(opened, scopes=scopes, name="path", lifetime=lifetime)
        self._people = stack.enter_context(
            httpx.Client(
                base_url=f"http://127.0.0.1:{people}/api/v1",
                headers={"Authorization": f"Bearer {token}"},
                timeout=60,
                verify=PLAIN,
                limits=httpx.Limits(keepalive_expiry=60),
            )
        )
        processes = {
            "cloud": lambda: eskin_cloud.service.run(CloudSettings.load(cloud)),
            "gateway": lambda: eskin_gateway.service.run(GatewaySettings.load(gateway)),
        }
        for name in NODES:
            config = self._write_node(name, pki, broker.node_port)
            processes[name] = partial(_run_node, config)
        self._traced: dict[str, Traced] = {}
        for name, run in processes.items():
            self._traced[name] = Traced(name, run, self._folder / f"{name}.log")
            stack.callback(self._traced[name].stop)
        self._traced["cloud"].wait_for("ready:")

    def _write_node(self, name: str, pki: Path, port: int) -> Path:
        folder, (sampling, stretch) = self._folder / name, NODES[name]
        config = write_settings(folder / "node.toml", {
            "node": {"name": name, "profile": "patch", "seed": 11},
            "sampling": {"overrun_s": 60.0, "stretch_ms": stretch},
            "broker": {"port": port, "status_s": 3600, "keepalive_s": 60, "drain_s": 0},
            "identity": {"directory": pki / name, "site": pki / "site.main" / "chain.pem"},
            "flash": {"path": folder / "flash.sqlite"},
            "truth": {"path": folder / "truth.sqlite"},
        })  # fmt: skip
        # No peak reaches such a prominence: a peak is a message of its own.
        taxel = TAXEL.replace("capacitance_prominence_F = 40e-12", "capacitance_prominence_F = 1.0")
        with config.open("a") as file:
            file.write(taxel.format(sampling=sampling, stimulus=sampling / 500))
        return config

    def trace_sample(self) -> Trace:
        """Trace while the node ``sample`` is read as a series and as a stream."""
        wait_until(self._has_channels, "the node's channels are stored")
        wait_until(self._knows_state, "the other node has reported its state")
        with self._people.stream("GET", "/live", params={"node": "sample"}) as answer:
            lines = answer.iter_lines()
            self._read_series(_next_frames(lines, 0, count=6))  # now all is warm
            with self._window("sample", ("cloud", "gateway", "sample")) as trace:
                begin = time.time_ns()
                _next_frames(lines, begin, count=4)
                self._read_series(begin)
        self._traced["sample"].stop()
        return trace

    def trace_command(self) -> Trace:
        """Trace while the node ``command`` takes a command."""
        for smoothing in (0.1, 0.2):  # now all is warm
            self._command(smoothing)
        with self._window("command", ("cloud", "gateway", "command")) as trace:
            self._command(0.3)
        return trace

    @contextlib.contextmanager
    def _window(self, window: str, names: Sequence[str]) -> Iterator[Trace]:
        trace = Trace()
        for name in names:
            self._traced[name].begin(window)
        yield trace
        for name in names:
            trace.add(self._traced[name].end())

    def _has_channels(self) -> bool:
        answer = self._people.get("/nodes/sample/channels")
        return answer.is_success and answer.json()["items"] != []

    def _knows_state(self) -> bool:
        answer = self._people.get("/nodes/command/state")
        return answer.is_success and bool(answer.json()["reported"])

    def _command(self, smoothing: float) -> None:
        order = {"name": "set", "arguments": {"smoothing": smoothing}}
        answer = self._people.post("/nodes/command/commands", json=order)
        answer.raise_for_status()
        path = f"/nodes/command/commands/{answer.json()['id']}"
        wait_until(lambda: self._people.get(path).json()["state"] == "done", "the answer is stored")

    def _read_series(self, begin: int) -> None:
        window = {"start": begin, "end": time.time_ns(), "points": 20_000}
        answer = self._people.get("/series/sample/t01.capacitance", params=window)
        answer.raise_for_status()
        assert any(low is not None for low in answer.json()["lo"])


def _run_node(config: Path) -> None:
    eskin_sensor_node.service.run(NodeSettings.load(config))


def _next_frames(lines: Iterator[str], begin: int, *, count: int) -> int:
    """Wait for so many live frames that begin after a time in ns; return the last one's begin."""
    event = ""
    for line in lines:
        if line.startswith("event:"):
            event = line[6:].strip()
        elif line.startswith("data:") and event == "frame":
            start = parse_timestamp(json.loads(line[5:])["t0"])
            count -= start >= begin
            if not count:
                return start
    raise AssertionError("the live stream ended")


def trace() -> tuple[Trace, Trace]:
    """Trace a sample and a command."""
    with tempfile.TemporaryDirectory() as folder, Stack(Path(folder)) as stack:
        return stack.trace_sample(), stack.trace_command()


def describe(sample: Trace, command: Trace) -> str:
    """Both paths as a section of the page."""
    extra = set(command.files) - set(sample.files)
    beside = set(sample.files) - sample.carriers
    types = sorted(sample.types, key=lambda name: (name.rpartition(".")[2], name))
    names = ", ".join(f"`{name.rpartition('.')[2]}` ({name.split('.')[0]})" for name in types)
    rooms: dict[str, tuple[list[str], list[str]]] = defaultdict(lambda: ([], []))
    for name in sorted(sample.files):
        path = Path(name)
        rooms[str(path.parent)][name in beside].append(path.stem)
    rows = [
        f"| `{room}` | {' '.join(carry)} | {' '.join(other)} |"
        for room, (carry, other) in rooms.items()
    ]
    lines = [
        f"\nA sample passes {len(sample.files)} files, of which {len(sample.carriers)} carry it.\n",
        "| room | carry the sample | run beside it |",
        "|---|---|---|",
        *rows,
        f"\nIt is wrapped in {len(types)} types: {names}.",
        f"\nA command passes {len(extra)} files beyond those of a sample:\n",
        *(f"- `{name}`" for name in sorted(extra)),
    ]
    return "\n".join(lines) + "\n\n"


def main() -> None:
    """Print both paths, or write them into the page."""
    section = describe(*trace())
    if "--update" not in sys.argv[1:]:
        print(section)
        return
    head, _, rest = PAGE.read_text().partition(BEGIN)
    PAGE.write_text(f"{head}{BEGIN}{section}{END}{rest.partition(END)[2]}")


if __name__ == "__main__":
    main()
