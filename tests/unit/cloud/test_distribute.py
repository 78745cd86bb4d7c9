"""What `eskin cloud distribute` would do, and what it refuses, on a PostgreSQL without Citus.

`tests/system/cluster` runs it on a cluster.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest
from eskin_cloud.store import Store
from eskin_cloud.store.distribute import (
    AT_COORDINATOR,
    check,
    distribute,
    distribution,
    is_of_slot,
    require_versions,
)
from eskin_cloud.store.schema.tables import feed, metadata
from eskin_cloud.store.shard_groups import read_groups
from sqlalchemy import create_engine, inspect

from eskin.errors import StoreError
from eskin.wire.slot import SLOTS
from tests.support.commands import run
from tests.support.files import write_settings
from tests.support.stores import write_place

if TYPE_CHECKING:
    from pathlib import Path

    from tests.support.postgresql import Cluster

CALL = re.compile(r"SELECT (\w+)\('(\w+)'(?:, 'slot', colocate_with => '(\w+)')?\)")
LIKE_CITUS = """
CREATE FUNCTION create_distributed_table(name regclass, by text, colocate_with text) RETURNS void
LANGUAGE plpgsql AS $$ BEGIN
  IF EXISTS (
    SELECT FROM pg_index i JOIN pg_attribute a ON (a.attrelid, a.attname) = (i.indrelid, by)
    WHERE i.indrelid = name AND i.indisunique AND a.attnum <> ALL (i.indkey::int2[])
  ) THEN RAISE EXCEPTION '%: a unique key lacks %', name, by; END IF;
  IF EXISTS (SELECT FROM pg_trigger t WHERE t.tgrelid = name AND NOT t.tgisinternal)
  THEN RAISE EXCEPTION '% has triggers', name; END IF;
END $$;
CREATE FUNCTION create_reference_table(name regclass) RETURNS void
LANGUAGE plpgsql AS $$ BEGIN
  IF EXISTS (SELECT FROM pg_trigger t WHERE t.tgrelid = name AND NOT t.tgisinternal)
  THEN RAISE EXCEPTION '% has triggers', name; END IF;
END $$;
CREATE FUNCTION truncate_local_data_after_distributing_table(name regclass) RETURNS void
LANGUAGE sql AS ''
"""
"""Refuses what Citus refuses."""


def calls() -> list[tuple[str, str, str]]:
    """Function, table, and with which table it is placed, of each statement that calls one."""
    found = [CALL.fullmatch(each) for each in distribution()]
    return [(each[1], each[2], each[3] or "") for each in found if each is not None]


def test_each_table_is_distributed_by_slot_copied_or_left_at_the_coordinator() -> None:
    made = [(name, table, near) for name, table, near in calls() if name.startswith("create_")]
    assert sorted([*(table for _, table, _ in made), *(each.name for each in AT_COORDINATOR)]) == (
        sorted(metadata.tables)
    )
    for name, table, near in made:
        if not is_of_slot(metadata.tables[table]):
            assert (name, near) == ("create_reference_table", "")
        else:
            other = "none" if table == feed.name else feed.name
            assert (name, near) == ("create_distributed_table", other)
    tables = [table for name, table, _ in made if name == "create_distributed_table"]
    assert tables[0] == feed.name, "the others are placed as it is"
    settings = [each for each in distribution() if CALL.fullmatch(each) is None]
    assert all(each.startswith("SET LOCAL citus.") for each in settings)


def test_statements_suit_the_tables(cluster: Cluster) -> None:
    place = cluster.fresh()
    cluster.execute(LIKE_CITUS, database=str(place.database))
    cluster.execute("; ".join(distribution()), database=str(place.database))


@pytest.mark.parametrize(
    ("postgresql", "citus", "remedy"),
    [
        (140_009, "Citus 13.0.5 on x86_64", "use PostgreSQL 15"),
        (160_001, "Citus 13.0.5 on x86_64", "use PostgreSQL 15"),
        (150_018, None, "shared_preload_libraries.*CREATE EXTENSION citus"),
        (150_018, "Citus 12.1.3 on x86_64", "build Citus 13.0"),
        (150_018, "Citus 13.2.0 on x86_64", "build Citus 13.0"),
        (150_018, "Citus 14.0.1 on x86_64", "build Citus 13.0"),
        (150_018, "Citus 13.01.1 on x86_64", "build Citus 13.0"),
        (150_018, "a fork of Citus 13.0.5", "build Citus 13.0"),
    ],
)
def test_other_versions_are_refused(postgresql: int, citus: str | None, remedy: str) -> None:
    with pytest.raises(StoreError, match=f"one.example.*{remedy}"):
        require_versions(postgresql, citus, server="one.example")


@pytest.mark.parametrize("patch", [0, 5, 12])
def test_tested_versions_are_taken(patch: int) -> None:
    require_versions(150_000 + patch, f"Citus 13.0.{patch} on x86_64", server="one.example")


def test_server_without_citus_is_refused_and_stays_as_it_is(cluster: Cluster) -> None:
    place = cluster.fresh(empty=True)
    with pytest.raises(StoreError, match="CREATE EXTENSION citus"):
        distribute(place, now=1)
    with pytest.raises(StoreError, match="CREATE EXTENSION citus"):
        check(place)
    engine = create_engine(place)
    with engine.begin() as connection:
        assert inspect(connection).get_table_names() == []
    engine.dispose()


def test_without_citus_all_slots_are_one_group(cluster: Cluster, tmp_path: Path) -> None:
    for place in (tmp_path / "store.sqlite", cluster.fresh()):
        with Store(place) as store, store.read() as connection:
            assert read_groups(connection) == [frozenset(range(SLOTS))]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "--url: is missing"),
        (("--url", "mysql://db.example/eskin"), "no PostgreSQL URL"),
        (("--url", "postgresql://eskin:word@127.0.0.1/eskin"), "must not hold a password"),
        (("--url", "postgresql://eskin@db.example/eskin"), "plaintext stays on loopback"),
        (("--url", "postgresql://eskin@127.0.0.1:1/eskin"), "does not answer"),
        (("--check", "--url", "postgresql://eskin@127.0.0.1:1/eskin"), "does not answer"),
    ],
)
def test_command_refuses_what_is_no_coordinator(words: tuple[str, ...], said: str) -> None:
    done = run("cloud", "distribute", *words)
    assert (done.returncode, done.stdout) == (2, "")
    assert said in done.stderr
    assert done.stderr.count("\n") == 1, "one clear line"


def test_command_refuses_a_file(tmp_path: Path) -> None:
    sections: dict[str, dict[str, object]] = {
        "store": write_place(tmp_path / "store.sqlite"),
        "gateways": {"identity": tmp_path},
    }
    settings = write_settings(tmp_path / "cloud.toml", sections)
    done = run("cloud", "distribute", "--config", str(settings))
    assert done.returncode == 2
    assert "is an SQLite file" in done.stderr
